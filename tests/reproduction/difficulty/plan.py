"""Which feeds are watched, and in what order: what matters most comes first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, zip_longest

from lumpwatch.service.simulator.spec import FeedSpec
from tests.reproduction import matrix
from tests.reproduction.difficulty.peers import OURS, PEERS
from tests.reproduction.difficulty.work import SECONDS, Task
from tests.reproduction.matrix import Scene

PARTS = ("curves", "long", "matrix", "sizes")
STYLES = ("a", "b")
LONG_S = 600.0


@dataclass(frozen=True, slots=True)
class Plan:
    """How much is watched. A style's standard scene is trained on its first training seed."""

    choose_lumps: int = 3
    """Training feeds with lumps, from the second seed on, on which thresholds are chosen; for each style."""
    choose_empty: int = 4
    """The same without lumps."""
    choose_more: int = 5
    """Further ones with lumps that only ours watches."""
    choose_long: int = 2
    """Further ones without lumps, of LONG_S, that only ours watches."""
    test_lumps: int = 20
    """Test feeds of a standard scene with lumps."""
    peer_lumps: int = 4
    """Of these, those that all methods watch; the others are watched by ours only."""
    test_empty: int = 2
    long_feeds: int = 30
    """Lump-free feeds of LONG_S for each style."""
    matrix_lumps: int = 1
    """Test feeds of every other scene."""
    matrix_empty: int = 0
    matrix_empty_s: float = 20.0
    scenes: tuple[str, ...] = ()
    """Scenes of the matrix; none: all."""
    seconds: float = SECONDS
    long_s: float = LONG_S
    peers: tuple[str, ...] = tuple(PEERS)

    def standard(self, style: str) -> Scene:
        """The style's standard scene."""
        return matrix.scene("standard" if style == "a" else "b-standard")

    def choosing(self, style: str) -> list[Task]:
        """What a style's thresholds are chosen on."""
        scene = self.standard(style)
        lumps = list(islice(scene.train(), 1, 1 + self.choose_lumps + self.choose_more))
        empty = list(islice(scene.train_empty(), 1, 1 + self.choose_empty + self.choose_long))
        by_all = [*lumps[: self.choose_lumps], *empty[: self.choose_empty]]
        return [
            *self._tasks(scene, by_all),
            *self._tasks(scene, lumps[self.choose_lumps :], peers=(OURS,)),
            *self._tasks(scene, empty[self.choose_empty :], self.long_s, (OURS,)),
        ]

    def testing(self, scene: Scene) -> list[Task]:
        """The test feeds of a scene, those with lumps first."""
        return [*self.with_lumps(scene), *self.without(scene)]

    def with_lumps(self, scene: Scene) -> list[Task]:
        """The test feeds of a scene with lumps."""
        if scene.axis != "standard":
            return self._tasks(scene, islice(scene.test(), self.matrix_lumps))
        specs = list(islice(scene.test(), self.test_lumps))
        by_all, by_ours = specs[: self.peer_lumps], specs[self.peer_lumps :]
        return self._tasks(scene, by_all) + self._tasks(scene, by_ours, peers=(OURS,))

    def without(self, scene: Scene) -> list[Task]:
        """The test feeds of a scene without lumps."""
        if scene.axis == "standard":
            return self._tasks(scene, islice(scene.test_empty(), self.test_empty))
        return self._tasks(scene, islice(scene.test_empty(), self.matrix_empty), self.matrix_empty_s)

    def long(self, style: str) -> list[Task]:
        """The long run without lumps."""
        scene = self.standard(style)
        seeds = islice(matrix.LONG_SEEDS, STYLES.index(style), None, len(STYLES))
        specs = (
            scene.spec.model_copy(update={"seed": seed, "lumps_per_minute": 0.0})
            for seed in islice(seeds, self.long_feeds)
        )
        return self._tasks(scene, specs, self.long_s, (OURS,))

    def matrix(self) -> list[Scene]:
        """The scenes of the matrix."""
        return [scene for scene in matrix.scenes() if not self.scenes or scene.name in self.scenes]

    def tasks(self, part: str) -> list[Task]:
        """The feeds of a part in their order. Sizes are those that were stated on the test feeds of `curves`."""
        if part in ("curves", "sizes"):
            choose = _in_turn(self.choosing(style) for style in STYLES)
            return choose + _in_turn(self.testing(self.standard(style)) for style in STYLES)
        if part == "long":
            return _in_turn(self.long(style) for style in STYLES)
        others = [scene for scene in self.matrix() if scene.axis != "standard"]
        lumps, empty = [self.with_lumps(s) for s in others], [self.without(s) for s in others]
        return _in_turn(lumps) + _in_turn(empty)

    def _tasks(
        self,
        scene: Scene,
        specs: Iterable[FeedSpec],
        seconds: float | None = None,
        peers: tuple[str, ...] | None = None,
    ) -> list[Task]:
        return [Task(scene.name, spec, seconds or self.seconds, peers or self.peers) for spec in specs]


SMALL = Plan(
    choose_lumps=1, choose_empty=1, choose_more=0, choose_long=0, test_lumps=1, test_empty=1, long_feeds=1,
    seconds=30.0, long_s=60.0,
    scenes=("standard", "dust-heavy", "night-1", "b-standard"),
)  # fmt: skip
"""To see that everything works, not to learn anything from."""


def _in_turn(lists: Iterable[Sequence[Task]]) -> list[Task]:
    """The first of each list, then the second of each, and so on."""
    return [task for row in zip_longest(*lists) for task in row if task is not None]


def every_task(plan: Plan, parts: Sequence[str]) -> Iterator[Task]:
    """The feeds of several parts, each once."""
    seen = set()
    for part in parts:
        for task in plan.tasks(part):
            if task.name not in seen:
                seen.add(task.name)
                yield task
