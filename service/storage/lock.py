"""One daemon a store and camera: two would use the sequence numbers of alarms twice, and end each other's files.

The lock is the kernel's (flock on `<store>/locks/CAMERA.lock`), so it goes with its process, whatever ends that. On a
file system that knows no locks there is none, and that is said in the log.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from lumpwatch.service.storage.versions import StoreError

log = logging.getLogger(__name__)

_POLL_S = 0.1


@contextlib.contextmanager
def lock_cameras(root: Path, cameras: Iterable[str], patience_s: float = 5.0) -> Iterator[None]:
    """Hold the cameras' places in a store. Raises StoreError where another process holds one for `patience_s`.

    That long a predecessor may take to end.
    """
    deadline = time.monotonic() + patience_s
    with contextlib.ExitStack() as held:
        for camera in sorted(cameras):
            path = root / "locks" / f"{camera}.lock"
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
            except OSError as error:
                log.warning("%s: the store cannot be locked (%s)", path, error.strerror)
                continue
            held.callback(os.close, descriptor)
            _take(descriptor, path, camera, deadline)
        yield


def _take(descriptor: int, path: Path, camera: str, deadline: float) -> None:
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= deadline:
                holder = os.pread(descriptor, 20, 0).decode("ascii", "replace").strip()
                who = f"process {holder}" if holder.isdigit() else "another process"
                raise StoreError(
                    f"{path}: camera {camera} is watched by {who} with the same store; give each its own store.path"
                ) from None
            time.sleep(_POLL_S)
        except OSError as error:
            log.warning("%s: the store cannot be locked (%s)", path, error.strerror)
            return
        else:
            with contextlib.suppress(OSError):  # who holds it is told for people; the lock itself is held
                os.ftruncate(descriptor, 0)
                os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
            return
