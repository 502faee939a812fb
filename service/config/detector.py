"""The detector of a ROI: one of three kinds."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from lumpwatch.service.config.jdt import JdtConfig
from lumpwatch.service.config.trackers import ImmPfConfig, JpdaConfig


def _kind(value: Any) -> Any:
    return value.get("kind", "jdt") if isinstance(value, dict) else getattr(value, "kind", None)


DetectorConfig = Annotated[
    Annotated[JdtConfig, Tag("jdt")]
    | Annotated[ImmPfConfig, Tag("imm_pf")]
    | Annotated[JpdaConfig, Tag("jpda")],
    Discriminator(
        _kind,
        custom_error_type="detector_kind",
        custom_error_message="expected a mapping with kind jdt, imm_pf or jpda",
    ),
]
"""A mapping without a kind is a `jdt`."""
