"""Tasks in, results out, in their order: whatever does the work, and whatever happened to a run before."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from itertools import islice
from typing import Any, Generic, TypeVar

from lumpwatch.service.batch.code import code_digest
from lumpwatch.service.batch.finished import Finished
from lumpwatch.service.batch.task import Failed, MismatchError, Task, do
from lumpwatch.service.errors import LumpwatchError

log = logging.getLogger(__name__)

P = TypeVar("P")
R = TypeVar("R")
AHEAD = 2
"""Tasks handed out for each that is being done: no worker waits, and what is handed out takes little memory."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is."""

    done: int
    """Tasks with a result or a failure, those of earlier runs included."""
    total: int
    failed: int
    left_s: float | None
    """Estimate of what is left, by the weight of what this run has done; None before its first task is done."""


def run_tasks(
    tasks: Sequence[Task[P]],
    work: Callable[[P], R],
    executor: Executor,
    width: Callable[[], int],
    finished: Finished[R] | None = None,
    told: Callable[[Progress], None] = lambda _: None,
    clock: Callable[[], float] = time.monotonic,
) -> list[R | Failed]:
    """Do the tasks that are not finished; results and failures in the order of the tasks.

    `work` is a function of a module, `width` says how many tasks the executor does at a time. Results are kept as they
    come. A task that fails, or costs its workers, is a failure and the others go on. Raises LumpwatchError where
    a worker's code is another, the cluster is gone or a result cannot be kept; what is finished stays kept.
    """
    run = _Run(tasks, finished, told, clock)
    waiting: dict[Future[R | Failed], int] = {}
    left = iter(run.left())
    digest = code_digest()
    try:
        while True:
            room = max(AHEAD * width() - len(waiting), 0)
            for index in islice(left, room):
                waiting[executor.submit(do, work, tasks[index], digest)] = index
            if not waiting:
                return run.outcomes()
            ready, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in sorted(ready, key=waiting.__getitem__):
                index = waiting.pop(future)
                run.add(index, _outcome(future, tasks[index].name))
    finally:
        for future in waiting:
            future.cancel()


class _Run(Generic[R]):
    """What is known of the tasks."""

    def __init__(
        self,
        tasks: Sequence[Task[Any]],
        finished: Finished[R] | None,
        told: Callable[[Progress], None],
        clock: Callable[[], float],
    ) -> None:
        self._tasks, self._finished, self._told, self._clock = tasks, finished, told, clock
        self._began_s = clock()
        self._found: dict[int, R | Failed] = {}
        self._failed = 0
        if finished is not None:
            for index, task in enumerate(tasks):
                if task.key and (kept := finished.load(task.key)) is not None:
                    self._found[index] = kept
        self._weight_left = sum(tasks[index].weight for index in self.left())
        self._weight_done = 0.0
        if self._found:
            log.info("%d of %d tasks were finished before", len(self._found), len(tasks))
            self._tell()

    def left(self) -> list[int]:
        """Which tasks have no result yet."""
        return [index for index in range(len(self._tasks)) if index not in self._found]

    def add(self, index: int, outcome: R | Failed) -> None:
        """What came of a task."""
        task = self._tasks[index]
        if isinstance(outcome, Failed):
            self._failed += 1
            log.info("%s: failed: %s", task.name, outcome.reason)
        elif self._finished is not None and task.key:
            self._finished.keep(task.key, outcome)
        self._found[index] = outcome
        self._weight_left -= task.weight
        self._weight_done += task.weight
        self._tell()

    def outcomes(self) -> list[R | Failed]:
        """All of them, in order."""
        return [self._found[index] for index in range(len(self._tasks))]

    def _tell(self) -> None:
        left_s = None
        if self._weight_done > 0:
            left_s = (self._clock() - self._began_s) * max(self._weight_left, 0.0) / self._weight_done
        self._told(Progress(len(self._found), len(self._tasks), self._failed, left_s))


def _outcome(future: Future[R | Failed], name: str) -> R | Failed:
    try:
        return future.result()
    except MismatchError:
        raise
    except CancelledError as error:
        raise LumpwatchError(
            f"{name}: the cluster dropped it, or is gone; what is finished is kept"
        ) from error
    except Exception as error:  # what executors say of workers that are lost has no common kind
        said = " ".join(str(error).split())[:300]
        return Failed(name, f"{name}: {said or type(error).__name__}")
