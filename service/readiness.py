"""What can be known to be wrong before anything is started."""

from __future__ import annotations

from service.config import DetectorConfig, HistogramConfig, JdtConfig, SiteConfig
from service.errors import ConfigError
from service.store.priors import PriorStore


def _needs_prior(detector: DetectorConfig) -> str | None:
    """What of the detector cannot work on stated defaults."""
    if isinstance(detector, JdtConfig) and isinstance(detector.likelihood, HistogramConfig):
        return "likelihood kind histogram"
    if any(model.kind == "motion_prior" for model in detector.models):
        return "motion model kind motion_prior"
    return None


def check_priors(config: SiteConfig) -> dict[tuple[str, str], str]:
    """What each ROI (camera, roi) will run on, in words.

    Raises ConfigError for a ROI that cannot run without a prior and has none that can be read.
    """
    store = PriorStore(config.store.path, config.store.keep_priors)
    notes = {}
    for camera in config.cameras:
        for roi in camera.rois:
            found = store.current(camera.id, roi.id)
            if found.prior is None and (what := _needs_prior(roi.detector)):
                raise ConfigError(
                    f"camera {camera.id}, roi {roi.id}: {what} needs a prior; "
                    f"run lumpwatch train CONFIG VIDEO LABELS --camera {camera.id} --roi {roi.id}"
                )
            note = f"version {found.prior.version}" if found.prior else "none: stated defaults"
            if found.problems:
                note += f" (refused: {'; '.join(found.problems)})"
            notes[camera.id, roi.id] = note
    return notes
