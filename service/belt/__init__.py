"""What a calibration says of a belt: its plane in a picture, how long a lump rides, how often to look."""

from lumpwatch.service.belt.geometry import check_geometry, make_plane, pixels_of, ride_s, to_lip_m
from lumpwatch.service.belt.rate import LEAST_HZ, camera_pace, decide_hz, make_pace, never_clear

__all__ = [
    "LEAST_HZ",
    "camera_pace",
    "check_geometry",
    "decide_hz",
    "make_pace",
    "make_plane",
    "never_clear",
    "pixels_of",
    "ride_s",
    "to_lip_m",
]
