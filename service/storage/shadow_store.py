"""Keeps what was counted of a shadow in the store, so that a restart does not begin anew.

    <store>/priors/<camera>/<roi>/shadow.json      a `ShadowState`, a few seconds old

A thread writes, so that no disk can hold up the filter; of what waits only the latest is written.
"""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from pydantic import ValidationError

from lumpwatch.service.protocol import ShadowState
from lumpwatch.service.storage.atomic import replace_file
from lumpwatch.service.storage.prior_store import PriorStore

log = logging.getLogger(__name__)

_CLOSE_S = 1.0


def state_file(store: PriorStore, camera: str, roi: str) -> Path:
    """Where the state of a ROI's shadow is kept."""
    return store.folder(camera, roi) / "shadow.json"


def read_state(store: PriorStore, camera: str, roi: str) -> ShadowState | None:
    """What was kept last, None where there is nothing that can be read."""
    path = state_file(store, camera, roi)
    try:
        found = ShadowState.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValidationError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not what was written"
        log.warning("%s: cannot be used (%s); counting begins anew", path, reason)
        return None
    return found if (found.camera, found.roi) == (camera, roi) else None


class StateKeeper:
    """Writes states in a thread of its own."""

    def __init__(self, store: PriorStore) -> None:
        self._store = store
        self._wake = threading.Condition()
        self._waiting: dict[str, ShadowState] = {}
        self._closed = False
        self._thread: threading.Thread | None = None

    def keep(self, state: ShadowState) -> None:
        """Write this some time soon."""
        with self._wake:
            self._waiting[state.roi] = state
            if self._thread is None:  # most cameras never have a shadow
                self._thread = threading.Thread(target=self._run, name="shadow state", daemon=True)
                self._thread.start()
            self._wake.notify()

    def close(self) -> None:
        """Write what waits, if that does not take long."""
        with self._wake:
            self._closed = True
            self._wake.notify()
        if self._thread is not None:
            self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        logged = False
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._waiting or self._closed)
                if not self._waiting:
                    return
                _, state = self._waiting.popitem()
            path = state_file(self._store, state.camera, state.roi)
            try:
                replace_file(path, state.line() + b"\n")
                logged = False
            except OSError as error:
                if not logged:
                    log.warning("%s: cannot be written (%s)", path, error.strerror)
                logged = True
