"""What can be known to be wrong before anything is started."""

from __future__ import annotations

import os
from pathlib import Path

from lumpwatch.service.bus import SHARED_MEMORY_MIB
from lumpwatch.service.config import DetectorConfig, HistogramConfig, JdtConfig, NetworkConfig, SiteConfig
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.storage import PriorStore

SHARED_MEMORY = Path("/dev/shm")


def check_shared_memory(config: SiteConfig, folder: Path = SHARED_MEMORY) -> None:
    """Raises ConfigError where frames are to travel through shared memory and it is closed or too small.

    Containers have 64 MiB of it unless told otherwise.
    """
    if not config.bus.shared_memory or not folder.exists():
        return
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigError(
            f"bus.shared_memory: {folder} cannot be written by user {os.getuid()}; "
            "give it to that user (mode 1777), or set bus.shared_memory: false"
        )
    size = os.statvfs(folder)
    has, needs = (size.f_blocks * size.f_frsize) >> 20, SHARED_MEMORY_MIB * len(config.cameras)
    if has < needs:
        raise ConfigError(
            f"bus.shared_memory: {folder} has {has} MiB, {len(config.cameras)} cameras need {needs}; "
            f"start the container with --shm-size={needs}m, or set bus.shared_memory: false"
        )


def _needs_prior(detector: DetectorConfig) -> str | None:
    """What of the detector cannot work on stated defaults."""
    if isinstance(detector, JdtConfig) and isinstance(detector.likelihood, HistogramConfig):
        return "likelihood kind histogram"
    if any(model.kind == "motion_prior" for model in detector.models):
        return "motion model kind motion_prior"
    return None


def _check_network(detector: DetectorConfig, where: str) -> None:
    if isinstance(detector, JdtConfig) and isinstance(detector.likelihood, NetworkConfig):
        from lumpwatch.service.detection import make_network  # compiled code, which no other ROI needs here

        try:
            make_network(detector.likelihood, apart=True)
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from error


def check_simulations(config: SiteConfig) -> None:
    """Raises ConfigError for a simulated feed that asks for what there is not."""
    for camera in config.cameras:
        if camera.source.kind == "simulated":
            from lumpwatch.service.capture import spec_of  # the simulator, which no real site needs

            spec_of(camera.source, camera.id)


def check_priors(config: SiteConfig) -> dict[tuple[str, str], str]:
    """What each ROI (camera, roi) will run on, in words.

    Raises ConfigError for a ROI that cannot run without a prior and has none that can be read, or
    whose network cannot be used.
    """
    store = PriorStore(config.store.path, config.store.keep_priors)
    notes = {}
    for camera in config.cameras:
        for roi in camera.rois:
            if roi.watches_mouth:
                notes[camera.id, roi.id] = "a mouth needs no prior"
                continue
            _check_network(roi.detector, f"camera {camera.id}, roi {roi.id}")
            found = store.current(camera.id, roi.id)
            if found.prior is None and (what := _needs_prior(roi.detector)):
                raise ConfigError(
                    f"camera {camera.id}, roi {roi.id}: {what} needs a prior; "
                    f"run lumpwatch train CONFIG VIDEO LABELS --camera {camera.id} --roi {roi.id}"
                )
            note = (
                f"version {found.prior.version}" if found.prior else "none: untrained, on the stated defaults"
            )
            if found.problems:
                note += f" (refused: {'; '.join(found.problems)})"
            notes[camera.id, roi.id] = note
    return notes
