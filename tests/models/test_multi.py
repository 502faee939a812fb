"""Several objects at once, on generated pictures of textured squares with known positions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import polygon_births
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import JdtFilter
from lumpwatch.models.jdt.motion import ConstantVelocity
from lumpwatch.models.jdt.multi_object import MultiBelief, MultiJdtFilter
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.jdt.switching import FixedSwitching
from lumpwatch.models.roi import View, make_roi
from lumpwatch.models.state import H, States, W, X, Y
from lumpwatch.models.trackers.appearance import HistogramAppearance

WIDTH, HEIGHT, SIDE, DT = 240, 160, 30.0, 0.1
BRIGHT, LIGHT = 14, 12
"""Histogram bins of the two kinds of square; the background lies in bins 0 to 7."""


def scene(places: list[tuple[float, float, int]], seed: int) -> View:
    """A noisy dark picture with squares (centre x, y, bin)."""
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 8 * 16, (HEIGHT, WIDTH)).astype(np.uint8)
    for x, y, tone in places:
        left, top = round(x - SIDE / 2), round(y - SIDE / 2)
        rows, columns = slice(max(top, 0), top + int(SIDE)), slice(max(left, 0), left + int(SIDE))
        part = picture[rows, columns]
        picture[rows, columns] = rng.integers(16 * tone, 16 * tone + 16, part.shape)
    roi = make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], WIDTH, HEIGHT, max(WIDTH, HEIGHT))
    return roi.view(picture)


@dataclass(frozen=True)
class Squares:
    """Evidence for a bright square of any kind: bright inside and dark in the ring around it."""

    bright: NDArray[np.int32]

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        inside, whole = self._share(states, 1.0), self._share(states, 1.6)
        ring = (2.56 * whole - inside) / 1.56
        return np.clip(8.0 * (inside - ring) - 4.0, -3.0, 3.0)

    def _share(self, states: States, scale: float) -> NDArray[np.float64]:
        half = 0.5 * scale * states[:, W : H + 1]
        low = np.clip(np.round(states[:, X : Y + 1] - half), 0, (WIDTH, HEIGHT)).astype(int)
        high = np.clip(np.round(states[:, X : Y + 1] + half), 0, (WIDTH, HEIGHT)).astype(int)
        (x0, y0), (x1, y1), total = low.T, high.T, self.bright
        count = total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0]
        return count / np.prod(2 * half, axis=1)


def squares(view: View) -> Squares:
    return Squares(np.asarray(cv2.integral((view.gray >= 160).astype(np.uint8)), dtype=np.int32))


def tracker(most: int = 4) -> MultiJdtFilter:
    size = np.log(SIDE)
    mean, spread = np.array([[0.0, 0.0, size, size]] * 2), np.array([[30.0, 5.0, 0.03, 0.03]] * 2)
    profile = RowProfile(0.0, HEIGHT, mean, spread)
    single = JdtFilter(
        models=(ConstantVelocity("straight", 15.0),),
        switching=FixedSwitching(np.ones((1, 1)), DT, np.zeros(1, dtype=np.bool_)),
        births=polygon_births(np.ones((HEIGHT, WIDTH), np.uint8), profile, np.ones(1)),
        profile=profile,
        chain=ExistenceChain(0.3, 0.1),
    )
    return MultiJdtFilter(single, most=most)


def run(
    paths: list[list[tuple[float, float, int] | None]], most: int = 4, seed: int = 0
) -> list[MultiBelief]:
    """The belief after each frame; paths[k][t] is where object k is at frame t."""
    multi = tracker(most)
    appearance = HistogramAppearance()
    rng = np.random.default_rng(seed)
    belief, beliefs = multi.start(rng), []
    for t in range(len(paths[0])):
        view = scene([path[t] for path in paths if path[t] is not None], 1000 * seed + t)  # type: ignore[misc]
        looks = partial(appearance.observe, view)
        belief = multi.step(belief, squares(view), looks, DT, rng).belief
        beliefs.append(belief)
    return beliefs


def centres(belief: MultiBelief) -> NDArray[np.float64]:
    return np.array([track.estimate.mean[[X, Y]] for track in belief.tracks]).reshape(-1, 2)


def still(
    x: float, y: float, tone: int, frames: int, first: int = 0
) -> list[tuple[float, float, int] | None]:
    return [(x, y, tone) if t >= first else None for t in range(frames)]


@pytest.mark.parametrize("seed", range(3))
def test_four_objects_are_four_tracks_and_none_is_counted_twice(seed: int) -> None:
    places = [(40.0, 40.0), (120.0, 40.0), (200.0, 110.0), (60.0, 120.0)]
    beliefs = run([still(x, y, BRIGHT, 60) for x, y in places], seed=seed)
    for belief in beliefs[30:]:
        assert len(belief.tracks) == 4
    found = centres(beliefs[-1])
    for place in places:
        assert np.hypot(*(found - place).T).min() < 5.0
    assert len({track.id for track in beliefs[-1].tracks}) == 4
    assert max(track.id for track in beliefs[-1].tracks) == 4  # no track was made in vain
    assert all(belief.search.existence < 0.5 for belief in beliefs[30:])
    assert beliefs[-1].existence > 0.99


@pytest.mark.parametrize("seed", range(3))
def test_a_tracked_object_does_not_smother_the_birth_of_another(seed: int) -> None:
    """The second object comes at frame 25; alone, an object takes some ten frames to be found."""
    beliefs = run([still(60, 80, BRIGHT, 60), still(170, 80, BRIGHT, 60, first=25)], seed=seed)
    assert [len(belief.tracks) for belief in beliefs[15:25]] == [1] * 10
    assert all(len(belief.tracks) == 2 for belief in beliefs[45:])
    assert beliefs[-1].tracks[0].id == 1


@pytest.mark.parametrize("seed", range(6))
def test_identities_are_kept_through_a_crossing(seed: int) -> None:
    """Two squares of different brightness pass through one another, one above the other in the picture."""
    frames = 70
    right = [(30.0 + 2.6 * t, 78.0, BRIGHT) for t in range(frames)]
    left = [(210.0 - 2.6 * t, 84.0, LIGHT) for t in range(frames)]
    beliefs = run([right, left], seed=seed)  # type: ignore[list-item]
    before = beliefs[20]
    assert len(before.tracks) == 2
    first = {track.id: abs(track.estimate.mean[X] - right[20][0]) < 15 for track in before.tracks}
    after = {track.id: abs(track.estimate.mean[X] - right[-1][0]) < 15 for track in beliefs[-1].tracks}
    assert sorted(first.values()) == [False, True]
    assert after == first


def test_a_track_ends_when_its_object_leaves() -> None:
    path = [(60.0, 80.0, BRIGHT) if t < 30 else None for t in range(60)]
    beliefs = run([path])
    assert len(beliefs[25].tracks) == 1
    assert len(beliefs[-1].tracks) == 0
    assert beliefs[-1].existence < 0.2


def test_an_empty_picture_has_no_track() -> None:
    assert all(not belief.tracks for belief in run([[None] * 60]))


def test_one_object_as_by_the_single_filter() -> None:
    """With `most` 1 the track is where the single filter's estimate is."""
    beliefs = run([still(100, 70, BRIGHT, 40)], most=1)
    multi = tracker()
    rng = np.random.default_rng(5)
    single = multi.single.start(rng)
    for t in range(40):
        step = multi.single.step(single, squares(scene([(100, 70, BRIGHT)], t)), DT, rng)
        single = step.belief
    assert step.estimate is not None
    assert len(beliefs[-1].tracks) == 1
    assert centres(beliefs[-1])[0] == pytest.approx(step.estimate.mean[[X, Y]], abs=2.0)
    assert beliefs[-1].tracks[0].belief.existence == pytest.approx(single.existence, abs=0.02)


def test_existence_of_at_least_one_by_hand() -> None:
    """1 - (1 - 0.9) (1 - 0.5) (1 - 0.2) = 0.96."""
    multi = tracker()
    start = multi.start(np.random.default_rng(0))
    track = run([still(100, 70, BRIGHT, 30)])[-1].tracks[0]
    tracks = tuple(replace(track, belief=replace(track.belief, existence=r)) for r in (0.9, 0.5))
    belief = MultiBelief(tracks, replace(start.search, existence=0.2))
    assert belief.existence == pytest.approx(0.96)


def test_the_sampled_form_is_refused() -> None:
    multi = tracker()
    with pytest.raises(ValueError, match="marginal"):
        MultiJdtFilter(replace(multi.single, form="sampled"))


def test_same_seed_same_bytes() -> None:
    paths = [still(60, 80, BRIGHT, 20), still(170, 80, LIGHT, 20)]
    first, second = run(paths), run(paths)
    for a, b in zip(first, second, strict=True):
        assert [t.belief.states.tobytes() for t in a.tracks] == [t.belief.states.tobytes() for t in b.tracks]
        assert a.search.states.tobytes() == b.search.states.tobytes()
        assert all(np.isfinite(t.estimate.mean[[W, H]]).all() for t in a.tracks)
