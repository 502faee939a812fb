"""The IMM particle filter tracker (Madrigal and Hayet, paper 2): filter, observation, box sizes, tracker."""

from models.imm_pf.filter import ImmBelief, ImmFilter, ImmOptions
from models.imm_pf.observation import Look, ObservationOptions, Reference, look
from models.imm_pf.options import TrackerOptions
from models.imm_pf.size import BoxSize, CameraSize, LinearSize, ProfileSize, learn_linear
from models.imm_pf.tracker import ImmPfTracker

__all__ = [
    "BoxSize",
    "CameraSize",
    "ImmBelief",
    "ImmFilter",
    "ImmOptions",
    "ImmPfTracker",
    "LinearSize",
    "Look",
    "ObservationOptions",
    "ProfileSize",
    "Reference",
    "TrackerOptions",
    "learn_linear",
    "look",
]
