"""Writes evidence in a thread of its own, so that neither encoding nor a disk holds up the filter.

What cannot be written is given up and counted, and logged once; the next clip is tried again.
The thread also keeps the store within its bounds.
"""

from __future__ import annotations

import errno
import logging
import os
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.config import CameraConfig, EvidenceConfig
from lumpwatch.service.evidence.files import write_files
from lumpwatch.service.evidence.recorder import Clip, EvidenceObserver
from lumpwatch.service.evidence.store import Entry, EvidenceStore
from lumpwatch.service.protocol import EvidenceMeta

log = logging.getLogger(__name__)

PRUNE_EVERY_S = 3600.0
_CLOSE_S = 2.0
_MIB = 1 << 20


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the evidence comes from."""

    site: str
    camera: CameraConfig
    software: str
    """Version of lumpwatch."""


class EvidenceWriter:
    """The evidence of one camera on its way to the disk."""

    def __init__(
        self,
        store: EvidenceStore,
        origin: Origin,
        config: EvidenceConfig,
        observer: EvidenceObserver,
        judged: Callable[[], Callable[[Entry], bool]],
        wall: Callable[[], float] = time.time,
        fill: Callable[[Path, Clip, str, CameraConfig, str], EvidenceMeta] = write_files,
    ) -> None:
        """`judged` gives, when called, a test of which evidence has a verdict; `fill` writes the files of a clip."""
        self._store = store
        self._origin = origin
        self._config = config
        self._observer = observer
        self._judged = judged
        self._wall = wall
        self._fill = fill
        self._last_problem = ""
        self._clips: deque[Clip] = deque()
        self._waiting = 0
        self._wake = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="evidence", daemon=True)
        if config.enabled:
            self._thread.start()

    def submit(self, clip: Clip) -> None:
        """Write a clip when there is time; the recorder bounds how much waits."""
        with self._wake:
            self._clips.append(clip)
            self._waiting += clip.size
            self._wake.notify()

    def waiting(self) -> int:
        """Bytes of the clips that are not written yet."""
        return self._waiting

    def close(self) -> None:
        """Write what waits, if that does not take long."""
        with self._wake:
            self._closed = True
            self._wake.notify()
        if self._config.enabled:
            self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        if self._config.encode_niceness:
            # Of this thread alone: Linux schedules threads as it does processes.
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), self._config.encode_niceness)
        removed = self._store.clean(self._origin.camera.id)
        if removed:
            log.info("evidence: %d unfinished folders of an earlier run removed", removed)
        self._attempt(self._tell_limit)
        self._attempt(self._prune)
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._clips or self._closed, PRUNE_EVERY_S)
                if not self._clips and self._closed:
                    return
                clip = self._clips[0] if self._clips else None
            if clip is not None:
                if self._attempt(lambda clip=clip: self._write(clip)):  # type: ignore[misc]
                    self._observer.evidence_written(clip.trigger.roi)
                with self._wake:
                    self._clips.popleft()
                    self._waiting -= clip.size
            self._attempt(self._prune)

    def _write(self, clip: Clip) -> None:
        self._store.root.mkdir(parents=True, exist_ok=True)
        if shutil.disk_usage(self._store.root).free < self._config.least_free_mb * _MIB:
            raise OSError(errno.ENOSPC, f"less than {self._config.least_free_mb} MiB are free")
        origin, trigger = self._origin, clip.trigger
        self._store.write(
            origin.camera.id,
            trigger.roi,
            trigger.id,
            lambda folder: self._fill(folder, clip, origin.site, origin.camera, origin.software),
        )
        if self._last_problem:
            log.info("evidence: written again")
        self._last_problem = ""

    def _tell_limit(self) -> None:
        limit, wanted = self._store.limit(self._config), self._config.max_mb * _MIB
        if limit < wanted:
            log.warning(
                "evidence: keeps at most %d MiB, %.0f %% of its disk (evidence.max_share), not max_mb, %d",
                limit // _MIB,
                100 * self._config.max_share,
                self._config.max_mb,
            )

    def _prune(self) -> None:
        removed = self._store.prune(self._config, self._wall(), self._judged())
        for reason, count in removed.items():
            if count:
                self._observer.evidence_removed(reason, count)
        self._observer.evidence_stored(
            sum(entry.size for entry in self._store.entries(self._origin.camera.id))
        )

    def _attempt(self, work: Callable[[], None]) -> bool:
        """Whether it went well; nothing that goes wrong here may reach the filter."""
        try:
            work()
        except Exception as error:
            full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
            reason = "disk_full" if full else "unwritable"
            self._observer.evidence_problem(reason)
            problem = f"{reason}: {error}"
            if reason != self._last_problem.partition(":")[0]:  # once, not with every clip
                log.error("evidence cannot be kept in %s, %s; detection goes on", self._store.root, problem)  # noqa: TRY400
            self._last_problem = problem
            return False
        return True
