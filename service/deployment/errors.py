"""What goes wrong when a container is rolled out."""

from __future__ import annotations

from lumpwatch.service.errors import LumpwatchError


class DeployError(LumpwatchError):
    """The engine does not answer or refuses, or the container does not become ready; the text says which."""
