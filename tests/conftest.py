from __future__ import annotations

from hypothesis import settings

# Examples are not timed: a machine that is busy, or a kernel that compiles, is no failure.
settings.register_profile("lumpwatch", deadline=None)
settings.load_profile("lumpwatch")
