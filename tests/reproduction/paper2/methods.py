"""The rows of Table 1: which motion models, with which noise."""

from __future__ import annotations

from dataclasses import dataclass

from lumpwatch.models.jdt.motion import ConstantPosition, ConstantVelocity, FreeAcceleration, MotionModel
from lumpwatch.models.jdt.motion_prior import MotionPrior
from lumpwatch.models.trackers.imm_pf import TrackerOptions
from tests.reproduction.paper2.footage import Knowledge

POSITION_NOISE, VELOCITY_NOISE, ACCELERATION_NOISE = 6.0, 30.0, 50.0
"""px, px/s and px/s^2 gathered in one second; chosen on the first half, as all of `OPTIONS`."""
OPTIONS = TrackerOptions()


@dataclass(frozen=True, slots=True)
class Method:
    """One row of Table 1 and what the paper has in it."""

    name: str
    sfda: float
    ata: float
    n_modp: float
    motp: float

    @property
    def kinds(self) -> tuple[str, ...]:
        """CP, CV, CA or MP."""
        return tuple(self.name.split("_"))


METHODS = (
    Method("CA", 0.49, 0.36, 0.53, 0.53),
    Method("CV", 0.51, 0.36, 0.56, 0.55),
    Method("MP", 0.47, 0.40, 0.53, 0.53),
    Method("CV_CA", 0.50, 0.47, 0.56, 0.56),
    Method("CV_CA_MP", 0.48, 0.49, 0.56, 0.55),
    Method("CP_CV_CA", 0.45, 0.46, 0.53, 0.53),
    Method("CP_CV_CA_MP", 0.45, 0.45, 0.53, 0.52),
)


def make_models(kinds: tuple[str, ...], knowledge: Knowledge) -> tuple[MotionModel, ...]:
    """The motion models of a row."""
    known: dict[str, MotionModel] = {
        "CP": ConstantPosition("CP", POSITION_NOISE),
        "CV": ConstantVelocity("CV", VELOCITY_NOISE),
        "CA": FreeAcceleration("CA", ACCELERATION_NOISE),
        "MP": MotionPrior("MP", knowledge.cells, VELOCITY_NOISE),
    }
    return tuple(known[kind] for kind in kinds)
