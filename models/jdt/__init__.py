"""Joint detection and tracking with adaptive multiple motion models (paper 1).

A particle is [state, motion model, existence]. `JdtFilter.step` is Fig. 6: existence by the chain of Eq. 5
(`ExistenceChain`), the next motion model by a `Switching` (Eq. 10 to 14) and the state by that `MotionModel`,
newborn particles from `Births`, the weight of Eq. 15 from an `Observation` of `likelihood`, and a `Resampler`,
which is a plain function. A step gives belief, estimate and log evidence. `MultiJdtFilter` runs one filter an object
and one that searches.

Further motion models are in `motion` and `motion_prior`, densities in `density`; `row_profile` says how large
and fast objects are at each row.
"""

from lumpwatch.models.jdt.births import Births, KernelBirths, PolygonBirths, polygon_births
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Diagnostics, JdtFilter, Step
from lumpwatch.models.jdt.motion import (
    Bounce,
    ConstantAcceleration,
    ConstantPosition,
    ConstantVelocity,
    FreeAcceleration,
    MotionModel,
    RandomWalk,
)
from lumpwatch.models.jdt.motion_prior import CellVelocities, MotionPrior
from lumpwatch.models.jdt.multi_object import Appearance, MultiBelief, MultiJdtFilter, MultiStep, Track
from lumpwatch.models.jdt.resampling import Resampler, multinomial, stratified, systematic
from lumpwatch.models.jdt.row_profile import RowProfile, default_profile, learn_profile
from lumpwatch.models.jdt.switching import AdaptiveSwitching, FixedSwitching, Switching

__all__ = [
    "AdaptiveSwitching",
    "Appearance",
    "Births",
    "Bounce",
    "CellVelocities",
    "ConstantAcceleration",
    "ConstantPosition",
    "ConstantVelocity",
    "Diagnostics",
    "ExistenceChain",
    "FixedSwitching",
    "FreeAcceleration",
    "JdtFilter",
    "KernelBirths",
    "MotionModel",
    "MotionPrior",
    "MultiBelief",
    "MultiJdtFilter",
    "MultiStep",
    "PolygonBirths",
    "RandomWalk",
    "Resampler",
    "RowProfile",
    "Step",
    "Switching",
    "Track",
    "default_profile",
    "learn_profile",
    "multinomial",
    "polygon_births",
    "stratified",
    "systematic",
]
