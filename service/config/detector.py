"""The detector of a ROI: one of three kinds."""

from __future__ import annotations

from typing import Annotated

from pydantic import Discriminator, Tag

from lumpwatch.service.config.base import kind_or
from lumpwatch.service.config.jdt import JdtConfig
from lumpwatch.service.config.trackers import ImmPfConfig, JpdaConfig

DetectorConfig = Annotated[
    Annotated[JdtConfig, Tag("jdt")]
    | Annotated[ImmPfConfig, Tag("imm_pf")]
    | Annotated[JpdaConfig, Tag("jpda")],
    Discriminator(
        kind_or("jdt"),
        custom_error_type="detector_kind",
        custom_error_message="expected a mapping with kind jdt, imm_pf or jpda",
    ),
]
"""A mapping without a kind is a `jdt`."""
