"""What training chose for a region's detector, where the configuration leaves it open."""

from __future__ import annotations

from typing import Any

from lumpwatch.models.learning.learned import Learned
from lumpwatch.service.config import JdtConfig, MixtureConfig, RoiConfig, StatisticalConfig


def with_choices(config: RoiConfig, learned: Learned | None) -> RoiConfig:
    """The region with background model and working size as training chose them; what is configured stays."""
    detector, fit = config.detector, None if learned is None else learned.tracker
    if isinstance(detector, JdtConfig) or fit is None:
        return config
    chosen: dict[str, Any] = {}
    if fit.foreground is not None and detector.foreground is None:
        mixture = fit.foreground.kind == "mixture"
        chosen["foreground"] = (
            MixtureConfig(threshold=fit.foreground.threshold) if mixture else StatisticalConfig()
        )
    if fit.working_size_px is not None and "working_size_px" not in detector.model_fields_set:
        chosen["working_size_px"] = fit.working_size_px
    return config.model_copy(update={"detector": detector.model_copy(update=chosen)}) if chosen else config
