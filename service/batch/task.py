"""A task, what comes of it, and how a worker does it."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import cv2

from lumpwatch.service.batch.code import code_digest
from lumpwatch.service.errors import LumpwatchError

log = logging.getLogger(__name__)

P = TypeVar("P")
R = TypeVar("R")


class MismatchError(LumpwatchError):
    """A worker runs other code than the machine that hands out the work."""


@dataclass(frozen=True, slots=True)
class Task(Generic[P]):
    """A piece of work that depends on no other."""

    name: str
    """For people."""
    payload: P
    """All that the work needs; it travels to the worker as a pickle."""
    key: str = ""
    """The same for the same result (see `key_of`); empty: its result is not kept."""
    weight: float = 1.0
    """How much work it is beside the others, for the estimate."""


@dataclass(frozen=True, slots=True)
class Failed:
    """A task that gave no result. Errors travel as text: not every exception survives a process."""

    name: str
    reason: str


def do(work: Callable[[P], R], task: Task[P], digest: str) -> R | Failed:
    """What a worker does: one task. Raises MismatchError where the worker's code is not that of `digest`."""
    if code_digest() != digest:
        raise MismatchError(
            f"a worker runs lumpwatch of other code ({code_digest()}) than this machine ({digest}): results would not "
            "be those of one version; install the same on both"
        )
    cv2.setNumThreads(1)
    try:
        return work(task.payload)
    except LumpwatchError as error:
        return Failed(task.name, str(error))
    except MemoryError:
        return Failed(task.name, f"{task.name}: takes more memory than a worker may have")
    except Exception as error:  # a bug that one recording meets does not take the others along
        log.exception("%s", task.name)
        where = traceback.extract_tb(error.__traceback__)[-1]
        said = " ".join(str(error).split())[:200]
        return Failed(
            task.name, f"{task.name}: {type(error).__name__}: {said} ({where.name}, line {where.lineno})"
        )
