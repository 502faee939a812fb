"""Who does the work of a command on an archive: options, executors, and how far it is."""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass

from lumpwatch.service.batch import ClusterWorkers, LocalWorkers, Progress
from lumpwatch.service.cli.common import progress
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.threads import processor_count

log = logging.getLogger(__name__)

_EVERY_S = 30.0
_MOST_MB = 1_000_000
LEAST_MB = 512
"""What the libraries take before the first picture."""


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor, and how many tasks it does at a time."""

    executor: Executor
    width: Callable[[], int]


@contextmanager
def workers_of(arguments: argparse.Namespace, most: int) -> Iterator[Workers]:
    """What the options ask for, with at most so many processes. Raises ConfigError, LumpwatchError."""
    if arguments.dask is not None:
        with ClusterWorkers(arguments.dask) as cluster:
            yield Workers(cluster, cluster.width)
        return
    count = max(min(wanted_workers(arguments), most), 1)
    with LocalWorkers(count, arguments.worker_mb << 20) as local:
        yield Workers(local, lambda: count)


def wanted_workers(arguments: argparse.Namespace) -> int:
    """Processes of this machine. Raises ConfigError for numbers that cannot be."""
    if not LEAST_MB <= arguments.worker_mb <= _MOST_MB:
        raise ConfigError(f"--worker-mb {arguments.worker_mb}: expected {LEAST_MB} to {_MOST_MB}")
    wanted: int | None = arguments.workers
    if wanted is None:
        return processor_count()
    if wanted < 1:
        raise ConfigError(f"--workers {wanted}: must be at least 1")
    return wanted


@contextmanager
def batch_progress(
    title: str, total: int, clock: Callable[[], float] = time.monotonic
) -> Iterator[Callable[[Progress], None]]:
    """Like `progress`; what follows a run in a log gets a line every half minute, with an estimate."""
    told_s = clock()

    def tell(now: Progress) -> None:
        nonlocal told_s
        advance(now.done)
        if clock() - told_s >= _EVERY_S and now.done < now.total:
            told_s = clock()
            log.info("%s: %s", title, in_words(now))

    with progress(title, total) as advance:
        yield tell


def in_words(now: Progress) -> str:
    """How far a run is."""
    words = f"{now.done} of {now.total} done"
    if now.failed:
        words += f", {now.failed} failed"
    if now.left_s is not None:
        words += f", some {time_left(now.left_s)} left"
    return words


def time_left(seconds: float) -> str:
    """As people say it."""
    minutes = round(seconds / 60)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"
