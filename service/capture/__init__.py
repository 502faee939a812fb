"""The camera process: sources of frames, reconnecting, and the synthetic lump of a proof test."""

from lumpwatch.service.capture.camera_process import Reducer, run_camera
from lumpwatch.service.capture.live import Sent, look_at, record, snapshot
from lumpwatch.service.capture.recordings import open_recording, read_frames
from lumpwatch.service.capture.sources.simulated import spec_of

__all__ = [
    "Reducer",
    "Sent",
    "look_at",
    "open_recording",
    "read_frames",
    "record",
    "run_camera",
    "snapshot",
    "spec_of",
]
