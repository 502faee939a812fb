"""A backtest: every configuration on every video, judged at every threshold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

from lumpwatch.service.batch import Failed, Finished, Progress, run_tasks
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.offline.backtest.archive import Clip
from lumpwatch.service.offline.backtest.curve import (
    Point,
    Recommendation,
    Terms,
    VideoRecord,
    curve,
    recommend,
)
from lumpwatch.service.offline.backtest.record import Recording, Setup, record_video, tasks_of
from lumpwatch.service.offline.backtest.truth import truth_of
from lumpwatch.service.storage import LabelError, check_frames


@dataclass(frozen=True, slots=True)
class Result:
    """What one configuration did."""

    setup: Setup
    judged: tuple[VideoRecord, ...]
    points: tuple[Point, ...]
    """The curve, by ascending threshold."""
    recommendation: Recommendation

    @property
    def configured(self) -> Point:
        """The point of the curve at the configured threshold."""
        return next(p for p in self.points if p.raise_above == self.setup.roi.alarm.raise_above)

    @property
    def chosen(self) -> Point:
        """The recommended point, or for want of one the configured one."""
        return self.recommendation.point or self.configured

    @property
    def refused(self) -> int:
        """Videos on which the prior did not fit and the stated defaults were used."""
        wanted = self.setup.prior.version if self.setup.prior else 0
        return sum(video.recording.prior != wanted for video in self.judged)


@dataclass(frozen=True, slots=True)
class Backtest:
    """All results, on the same videos."""

    terms: Terms
    results: tuple[Result, ...]
    failures: tuple[str, ...]
    """Why videos were left out, of all configurations alike."""

    @property
    def hours(self) -> float:
        """Length of the footage that was judged."""
        return sum(float(video.recording.intervals.sum()) for video in self.results[0].judged) / 3600


def run_backtest(
    setups: Sequence[Setup],
    clips: Sequence[Clip],
    terms: Terms,
    fall_model: str,
    executor: Executor,
    width: Callable[[], int] = lambda: 1,
    finished: Finished[Recording] | None = None,
    told: Callable[[Progress], None] = lambda _: None,
) -> Backtest:
    """Run all configurations on all videos, see `run_tasks`.

    The result does not depend on the executor. A video that fails under one configuration is left out
    of all, so that they stay comparable. Raises LumpwatchError where no video is left.
    """
    tasks = tasks_of(setups, [clip.video for clip in clips])
    done = run_tasks(tasks, record_video, executor, width, finished, told)
    table = [done[k * len(clips) : (k + 1) * len(clips)] for k in range(len(setups))]
    failures: list[str] = []
    kept: list[tuple[Clip, list[Recording]]] = []
    for k, clip in enumerate(clips):
        recordings, failure = _sort([row[k] for row in table], clip)
        if failure is None:
            kept.append((clip, recordings))
        else:
            failures.append(failure)
    if not kept:
        raise LumpwatchError(f"no video could be judged; the first: {failures[0]}")
    results = []
    for k, setup in enumerate(setups):
        judged = tuple(
            _judge(setup, clip, recordings[k], fall_model, terms.least_warning_s) for clip, recordings in kept
        )
        points = curve(judged, setup.roi.alarm, terms)
        results.append(Result(setup, judged, points, recommend(points, terms)))
    return Backtest(terms, tuple(results), tuple(failures))


def _sort(done: Sequence[Recording | Failed], clip: Clip) -> tuple[list[Recording], str | None]:
    """The recordings of one video, or why it cannot be used."""
    recordings: list[Recording] = []
    for outcome in done:
        if isinstance(outcome, Failed):
            return [], outcome.reason
        recordings.append(outcome)
    if clip.boxes and clip.labels is not None:
        try:
            check_frames(clip.boxes, recordings[0].length, clip.labels, clip.name)
        except LabelError as error:
            return [], str(error)
    return recordings, None


def _judge(
    setup: Setup, clip: Clip, recording: Recording, fall_model: str, least_warning_s: float
) -> VideoRecord:
    truth = truth_of(recording, clip.boxes, setup.roi.polygon, fall_model, least_warning_s)
    return VideoRecord(clip.name, recording, truth)
