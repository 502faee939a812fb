"""The IMM particle filter tracker (Madrigal and Hayet, paper 2): filter, observation, box sizes, tracker."""

from lumpwatch.models.trackers.imm_pf.filter import ImmBelief, ImmFilter, ImmOptions
from lumpwatch.models.trackers.imm_pf.observation import ObservationOptions, PictureGrids, Reference, reduced
from lumpwatch.models.trackers.imm_pf.options import TrackerOptions
from lumpwatch.models.trackers.imm_pf.size import BoxSize, CameraSize, LinearSize, ProfileSize, learn_linear
from lumpwatch.models.trackers.imm_pf.tracker import ImmPfTracker

__all__ = [
    "BoxSize",
    "CameraSize",
    "ImmBelief",
    "ImmFilter",
    "ImmOptions",
    "ImmPfTracker",
    "LinearSize",
    "ObservationOptions",
    "PictureGrids",
    "ProfileSize",
    "Reference",
    "TrackerOptions",
    "learn_linear",
    "reduced",
]
