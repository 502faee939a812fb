"""The camera process: sources of frames, reconnecting, and the synthetic lump of a proof test."""

from lumpwatch.service.capture.camera_process import run_camera
from lumpwatch.service.capture.recordings import open_recording, read_frames
from lumpwatch.service.capture.sources.simulated import spec_of

__all__ = [
    "open_recording",
    "read_frames",
    "run_camera",
    "spec_of",
]
