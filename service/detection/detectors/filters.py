"""From configuration and prior to the filter and likelihood of a ROI, in working pixels."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import Births, KernelBirths, PolygonBirths, polygon_births
from lumpwatch.models.jdt.density import bandwidth_of
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import JdtFilter
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
from lumpwatch.models.jdt.row_profile import RowProfile, around_limit, untrained_profile
from lumpwatch.models.jdt.switching import AdaptiveSwitching, FixedSwitching, Switching, conditional
from lumpwatch.models.learning import Noise
from lumpwatch.models.learning.learned import HistogramFit, Learned, LumpFit
from lumpwatch.models.likelihood import HistogramLikelihood, Likelihood, LumpLikelihood
from lumpwatch.models.likelihood.lump import Maps
from lumpwatch.models.roi import Roi
from lumpwatch.service.config import JdtConfig, LumpConfig, MotionConfig, NetworkConfig
from lumpwatch.service.detection.network import make_network
from lumpwatch.service.detection.shipped_likelihood import default_likelihood, make_net
from lumpwatch.service.errors import ConfigError

# Stated defaults of a filter without a prior; lengths in ROI heights.
DEFAULT_INTERVAL_S = 1 / 15
DEFAULT_STAY = 0.97
DEFAULT_SPEED_H_S = 0.5
DEFAULT_RATES_H_S2 = (0.03, 3.0)
DEFAULT_VELOCITY_NOISE_H_S = 0.15
DEFAULT_FAST_NOISE_H_S = 0.6
DEFAULT_POSITION_NOISE_H = 0.1
LEAST_BIRTH_BANDWIDTH_H = 0.03
DEFAULT_ACCELERATION_NOISE_H_S2 = 1.0


class PriorMismatchError(ConfigError):
    """A prior does not fit the configuration of its ROI."""


def make_filter(config: JdtConfig, roi: Roi, learned: Learned | None) -> JdtFilter:
    """The JDT filter in working pixels of the ROI; raises PriorMismatchError."""
    height = float(roi.shape[0])
    models = make_models(config.models, learned, height)
    profile = make_profile(config.size_h, learned, roi)
    searched = roi.mask if roi.entry is None else roi.entry
    if learned is None:
        births = np.array([0.0 if model.momentary else 1.0 for model in models])
        births = births / births.sum() if births.any() else np.full(len(models), 1 / len(models))
    else:
        births = learned.births
    return JdtFilter(
        models=models,
        switching=_switching(config, models, learned, height),
        births=_births(config, learned, polygon_births(searched, profile, births), height),
        profile=profile,
        chain=ExistenceChain(config.existence.birth_rate_hz, 1.0 / config.existence.mean_life_s),
        particles=config.particles,
        born_share=config.existence.born_share,
        form=config.form,
        order=config.order,
        least_share=config.least_model_share,
    )


def make_profile(size_h: tuple[float, float], learned: Learned | None, roi: Roi) -> RowProfile:
    """Sizes and velocities by row in working pixels: learned or by default; sizes by the limit where one is known."""
    if learned is not None:
        profile = learned.profile.scaled(float(roi.shape[0]))
    else:
        profile = untrained_profile(roi.mask, size_h, DEFAULT_SPEED_H_S)
    return around_limit(profile, roi.limit_px)


def _births(config: JdtConfig, learned: Learned | None, anywhere: PolygonBirths, height: float) -> Births:
    """Births over the polygon, or where training saw them."""
    if config.existence.births == "uniform" or learned is None:
        return anywhere
    if learned.birth_places is None:
        raise PriorMismatchError("the prior holds no birth places: train again")
    places = learned.birth_places * height
    return KernelBirths(places, bandwidth_of(places, "scott", LEAST_BIRTH_BANDWIDTH_H * height), anywhere)


def make_likelihood(
    config: JdtConfig, learned: Learned | None, roi: Roi | None = None, maps: Maps | None = None
) -> Likelihood:
    """The likelihood with learned or default numbers; raises PriorMismatchError.

    `maps` stands for the net that ships. Without its region a lump's likelihood expects the same size everywhere.
    """
    wanted = config.likelihood
    if isinstance(wanted, NetworkConfig):
        return make_network(wanted)
    fit = learned.likelihood if learned is not None else default_likelihood()
    if isinstance(wanted, LumpConfig):
        if not isinstance(fit, LumpFit):
            raise PriorMismatchError(
                "the prior holds a histogram, the configuration asks for likelihood kind lump"
            )
        if fit.net != default_likelihood().net:
            raise PriorMismatchError(
                "the prior was trained for another net than the one that ships: train again"
            )
        return LumpLikelihood(
            maps or make_net(),
            fit.mean,
            fit.scale,
            fit.weights,
            fit.offset,
            wanted.evidence or 1.0,
            wanted.bound,
            looks_per_s=fit.looks_per_s if wanted.evidence is None else None,
            patterns=fit.patterns,
            margin=fit.margin if wanted.margin is None else wanted.margin,
            expected=None
            if roi is None
            else make_profile(config.size_h, learned, roi).log_size(roi.shape[0]),
        )
    if not isinstance(fit, HistogramFit):
        raise PriorMismatchError("likelihood kind histogram needs a trained prior: run lumpwatch train")
    if fit.channel != wanted.channel:
        raise PriorMismatchError(
            f"the prior's histogram is of {fit.channel}, the configuration asks for {wanted.channel}"
        )
    return HistogramLikelihood(
        fit.reference,
        fit.offset,
        fit.slope,
        wanted.evidence or fit.evidence,
        wanted.bound,
        fit.channel,
        interval_s=None if wanted.evidence or learned is None else learned.interval_s,
    )


def _check_names(entries: Sequence[MotionConfig], learned: Learned) -> None:
    names = tuple(entry.name for entry in entries)
    if names != learned.models:
        raise PriorMismatchError(
            f"the prior was trained for the models {', '.join(learned.models)}, "
            f"the configuration names {', '.join(names)}: train again"
        )


def make_models(
    entries: Sequence[MotionConfig], learned: Learned | None, height: float
) -> tuple[MotionModel, ...]:
    """The motion models in working pixels of a ROI of that height; raises PriorMismatchError."""
    if learned is not None:
        _check_names(entries, learned)
    if learned is not None and learned.cells is None:
        for entry in entries:
            if entry.kind == "motion_prior":
                raise PriorMismatchError(
                    f"the prior holds no flow for the motion prior {entry.name}: train again"
                )
    models: list[MotionModel] = []
    default_rates = iter((*DEFAULT_RATES_H_S2, *[DEFAULT_RATES_H_S2[-1]] * len(entries)))
    for m, entry in enumerate(entries):
        rate, noise = entry.acceleration_h_s2, entry.velocity_noise_h_s
        if learned is not None:
            rate = rate or (float(learned.rates[m, 0]), float(learned.rates[m, 1]))
            noise = noise or float(learned.velocity_noise[m])
        elif rate is None and entry.kind == "constant_acceleration":
            rate = (0.0, next(default_rates))
        cells = learned.cells.scaled(height) if learned is not None and learned.cells is not None else None
        tracked = learned.tracker.noise if learned is not None and learned.tracker is not None else None
        if tracked is not None:
            noise = entry.velocity_noise_h_s or tracked.velocity
        models.append(_motion_model(entry, rate or (0.0, 0.0), noise, height, cells, tracked))
    return tuple(models)


def _motion_model(
    entry: MotionConfig,
    rate: tuple[float, float],
    noise: float | None,
    height: float,
    cells: CellVelocities | None,
    tracked: Noise | None = None,
) -> MotionModel:
    """One motion model in working pixels."""
    if entry.custom:
        return _own_model(entry, height)
    still = entry.position_noise_h or (DEFAULT_POSITION_NOISE_H if tracked is None else tracked.position)
    still *= height
    fast = rate[1] > 1.0 or entry.kind.startswith("bounce")
    moving = height * (noise or (DEFAULT_FAST_NOISE_H_S if fast else DEFAULT_VELOCITY_NOISE_H_S))
    match entry.kind:
        case "constant_position":
            return ConstantPosition(entry.name, still)
        case "random_walk":
            return RandomWalk(entry.name, still)
        case "constant_velocity":
            return ConstantVelocity(entry.name, moving)
        case "constant_acceleration":
            return ConstantAcceleration(entry.name, (rate[0] * height, rate[1] * height), moving)
        case "bounce_x" | "bounce_y" | "bounce":
            return Bounce(entry.name, moving, entry.kind != "bounce_y", entry.kind != "bounce_x")
        case "free_acceleration":
            usual = DEFAULT_ACCELERATION_NOISE_H_S2 if tracked is None else tracked.acceleration
            jerk = entry.acceleration_noise_h_s2 or usual
            return FreeAcceleration(entry.name, height * jerk)
        case "motion_prior" if cells is not None:
            return MotionPrior(entry.name, cells, moving)
    raise PriorMismatchError(
        f"motion model {entry.name}: kind {entry.kind} needs a prior; run lumpwatch train"
    )


def _own_model(entry: MotionConfig, height: float) -> MotionModel:
    """A model of the user's own: the class named `package.module:Class`."""
    module, _, name = entry.kind.partition(":")
    where = f"motion model {entry.name}: kind {entry.kind}"
    try:
        made = getattr(importlib.import_module(module), name)(
            name=entry.name, height=height, **entry.parameters
        )
    except Exception as error:
        raise ConfigError(f"{where}: cannot be made ({type(error).__name__}: {error})") from error
    if not callable(getattr(made, "move", None)) or not isinstance(getattr(made, "momentary", None), bool):
        raise ConfigError(f"{where}: has no method move or no attribute momentary")
    return cast("MotionModel", made)


def _switching(
    config: JdtConfig, models: tuple[MotionModel, ...], learned: Learned | None, height: float
) -> Switching:
    momentary = np.array([model.momentary for model in models])
    if learned is None:
        return FixedSwitching(_default_matrix(momentary), DEFAULT_INTERVAL_S, momentary)
    matrix = conditional(learned.joint)
    if config.switching == "fixed":
        return FixedSwitching(matrix, learned.interval_s, momentary)
    return AdaptiveSwitching(matrix, learned.interval_s, momentary, learned.density.scaled(height))


def _default_matrix(momentary: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Regimes stay with 0.97, momentary models leave; the rest is spread evenly over the others."""
    m = len(momentary)
    if m == 1:
        return np.ones((1, 1))
    matrix = np.full((m, m), (1 - DEFAULT_STAY) / (m - 1))
    np.fill_diagonal(matrix, DEFAULT_STAY)
    if not momentary.all():
        for row in np.flatnonzero(momentary):
            matrix[row] = np.where(momentary, 0.0, 1.0 / (~momentary).sum())
    return matrix
