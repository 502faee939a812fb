"""The evidence of one camera as its monitor sees it: recorder, writer, store and the answers on the bus."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from typing import TYPE_CHECKING

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.core import Frame, RoiResult
from lumpwatch.service.evidence.recorder import EvidenceObserver, Moment, Recorder, Trigger
from lumpwatch.service.evidence.serve import serve_evidence
from lumpwatch.service.evidence.store import EvidenceStore
from lumpwatch.service.evidence.verdicts import judged, verdicts_by_id
from lumpwatch.service.evidence.writer import EvidenceWriter, Origin
from lumpwatch.service.protocol import EvidenceRequest
from lumpwatch.service.storage import event_file

if TYPE_CHECKING:
    from lumpwatch.service.detection import CameraPipeline, Snapshot


class EvidenceKeeper:
    """Used under the monitor's lock, but for the handlers."""

    def __init__(self, config: SiteConfig, camera: str, observer: EvidenceObserver) -> None:
        self._root = config.store.path
        self._camera = camera
        self._store = EvidenceStore(config.store.path)
        origin = Origin(config.site, config.camera(camera), version("lumpwatch"))
        self._writer = EvidenceWriter(
            self._store, origin, config.evidence, observer, lambda: judged(config.store.path)
        )
        self._recorder = Recorder(config.evidence, observer, self._writer.submit, self._writer.waiting)
        self._before: dict[str, Snapshot] | None = None

    def before(self, frame: Frame, pipeline: CameraPipeline) -> None:
        """The pipeline is about to process a frame."""
        self._before = pipeline.snapshots() if self._recorder.wants_state(frame) else None

    def after(self, frame: Frame, now_s: float, results: tuple[RoiResult, ...]) -> None:
        """It has; to be called before the results are announced."""
        if results:
            self._recorder.add(Moment(frame, now_s, results), self._before)

    def wants(self, trigger: Trigger) -> bool:
        """Whether there will be evidence of an alarm that is raised now."""
        return self._recorder.wants(trigger)

    def begin(self, trigger: Trigger) -> bool:
        """An alarm was raised; whether there will be evidence of it."""
        return self._recorder.begin(trigger)

    def tick(self, now_s: float) -> None:
        """Time goes by without frames."""
        self._recorder.tick(now_s)

    def restart(self) -> None:
        """Another prior is used from now on."""
        self._recorder.restart()

    def handler(self, roi: str) -> Callable[[EvidenceRequest], bytes]:
        """Answers the evidence requests of a ROI."""
        return serve_evidence(
            self._store, self._camera, roi, lambda: verdicts_by_id(event_file(self._root, self._camera))
        )

    def close(self) -> None:
        """Write what there is."""
        self._recorder.restart("stopped")
        self._writer.close()
