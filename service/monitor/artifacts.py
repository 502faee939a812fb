"""Polls the store for what is new for a camera while the daemon runs: priors, the reference, shadows.

All three lie in the store and are polled every `poll_s` in a thread of their own, so that a disk that
hangs holds up no decision: the monitor takes what was found, and never waits for it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from lumpwatch.service.protocol import ShadowState
from lumpwatch.service.storage import (
    Found,
    Prior,
    PriorStore,
    Reference,
    ReferenceStore,
    StoreError,
    read_state,
)
from lumpwatch.service.telemetry import MonitorMetrics

log = logging.getLogger(__name__)

HUNG_S = 10.0
"""A poll of the store that takes longer counts as hung."""


@dataclass(frozen=True, slots=True)
class NewPrior:
    """To be used from now on; None: the stated defaults."""

    roi: str
    prior: Prior | None


@dataclass(frozen=True, slots=True)
class NewReference:
    """What a fit picture of the camera looks like, from now on."""

    reference: Reference


@dataclass(frozen=True, slots=True)
class NewShadow:
    """To be run in shadow from now on; None: no longer."""

    roi: str
    prior: Prior | None
    kept: ShadowState | None = None
    """What had been counted of it before, or of another one."""


Artifact = NewPrior | NewReference | NewShadow


class ArtifactWatcher:
    """What is stored for one camera."""

    def __init__(
        self,
        *,
        camera: str,
        rois: Sequence[str],
        priors: PriorStore,
        references: ReferenceStore,
        poll_s: float,
        metrics: MonitorMetrics,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._camera = camera
        self._rois = tuple(rois)
        self._priors = priors
        self._references = references
        self._poll_s = poll_s
        self._metrics = metrics
        self._clock = clock
        self._prior: dict[str, int | None] = {}
        self._shadow: dict[str, int | None] = {}
        self._reference: int | None = None
        self._lock = threading.Lock()
        self._found: list[Artifact] = []
        self._poll_began_s: float | None = None
        self._hung_logged = False
        self._closed = threading.Event()

    def first(self) -> tuple[Artifact, ...]:
        """What to begin with, read here and now: a prior for each ROI, where there is one that can be used."""
        found: list[Artifact] = []
        for roi in self._rois:
            self._prior[roi] = self._priors.pointer(self._camera, roi)
            prior = self._read_prior(roi).prior
            if prior is not None:
                found.append(NewPrior(roi, prior))
        return (*found, *self.poll())

    def start(self) -> None:
        """Go on polling, in a thread."""
        threading.Thread(target=self._run, name="artifacts", daemon=True).start()

    def close(self) -> None:
        """Stop polling; does not wait for a poll that is under way."""
        self._closed.set()

    def take(self) -> tuple[Artifact, ...]:
        """What was found since the last call, in order; returns at once whatever the disk does."""
        with self._lock:
            found, self._found = tuple(self._found), []
            poll_began_s = self._poll_began_s
        hung = poll_began_s is not None and self._clock() - poll_began_s >= HUNG_S
        if hung and not self._hung_logged:
            log.error(
                "%s: the store has not answered for %.0f s; new priors, references and shadows must wait",
                self._camera,
                HUNG_S,
            )
        self._hung_logged = hung
        return found

    def poll(self) -> tuple[Artifact, ...]:
        """Poll everything once; what is new."""
        found: list[Artifact] = []
        for roi in self._rois:
            found += self._poll_prior(roi)
        found += self._poll_reference()
        for roi in self._rois:
            found += self._poll_shadow(roi)
        return tuple(found)

    def _run(self) -> None:
        while not self._closed.wait(self._poll_s):
            with self._lock:
                self._poll_began_s = self._clock()
            try:
                found = self.poll()
            except Exception:
                log.exception("%s: looking into the store failed", self._camera)
                found = ()
            with self._lock:
                self._found += found
                self._poll_began_s = None

    def _poll_prior(self, roi: str) -> Iterator[Artifact]:
        pointer = self._priors.pointer(self._camera, roi)
        if pointer is None or pointer == self._prior.get(roi):
            return
        self._prior[roi] = pointer
        found = self._read_prior(roi)
        if pointer == 0:
            log.info("%s/%s: uses the stated defaults", self._camera, roi)
        if pointer == 0 or found.prior is not None:
            yield NewPrior(roi, found.prior)

    def _read_prior(self, roi: str) -> Found:
        try:
            found = self._priors.current(self._camera, roi)
        except StoreError as error:
            log.error("%s/%s: %s", self._camera, roi, error)  # noqa: TRY400 - the line says it all
            self._metrics.prior_refused(roi, "unreadable")
            return Found(None)
        for problem in found.problems:
            log.error("%s/%s: prior refused: %s", self._camera, roi, problem)
            self._metrics.prior_refused(roi, "unreadable")
        if found.prior is not None:
            log.info("%s/%s: uses prior version %d", self._camera, roi, found.prior.version)
        return found

    def _poll_reference(self) -> Iterator[Artifact]:
        pointer = self._references.versions(self._camera).pointer
        if pointer is None or pointer == self._reference:
            return
        self._reference = pointer
        try:
            found = self._references.current(self._camera)
        except StoreError as error:
            log.error("%s: %s", self._camera, error)  # noqa: TRY400 - the line says it all
            self._metrics.picture.refused("unreadable")
            return
        for problem in found.problems:
            log.error("%s: reference refused: %s", self._camera, problem)
            self._metrics.picture.refused("unreadable")
        if found.reference is not None:
            log.info("%s: uses reference version %d", self._camera, found.reference.version)
            yield NewReference(found.reference)

    def _poll_shadow(self, roi: str) -> Iterator[Artifact]:
        pointer = self._priors.shadow_pointer(self._camera, roi)
        if pointer == self._shadow.get(roi):
            return
        self._shadow[roi] = pointer
        try:
            found = self._priors.shadow(self._camera, roi)
        except StoreError as error:
            found = Found(None, (str(error),))
        for problem in found.problems:
            log.error("%s/%s: shadow refused: %s", self._camera, roi, problem)
            self._metrics.shadows.shadow_failed(roi, "unreadable")
        kept = None if found.prior is None else read_state(self._priors, self._camera, roi)
        yield NewShadow(roi, found.prior, kept)
