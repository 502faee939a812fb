"""Fitting likelihoods: the logistic regression, and lumps told from rubble on fresh pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import expit

from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.learning import LabelledView, fit_histogram, fit_lump
from lumpwatch.models.learning.examples import misfits, mistaken, tempting
from lumpwatch.models.learning.logistic import logistic
from lumpwatch.models.likelihood import HistogramLikelihood, LumpLikelihood
from lumpwatch.models.likelihood.base import LEAST_INSIDE, box_inside
from lumpwatch.models.likelihood.histogram import Channel
from lumpwatch.models.roi import Image, make_roi
from lumpwatch.models.state import H, States, W, X, Y
from tests.models.helpers import area_under_roc, boxes, flat_profile, whole_picture
from tests.models.net_helpers import drawn

Array = NDArray[np.float64]
WIDTH, HEIGHT, RADIUS = 160, 120, 15.0


def test_logistic_recovers_its_coefficients() -> None:
    """Labels drawn from a logistic law: the slopes come back, and the offset less the log odds of the
    classes, because both weigh the same. 60,000 samples: standard errors near 0.02."""
    rng = np.random.default_rng(0)
    truth, offset = np.array([1.5, -0.8, 0.0]), -1.0
    x = rng.standard_normal((60_000, 3))
    y = rng.random(len(x)) < expit(x @ truth + offset)
    fit = logistic(x, y, ridge=1e-8)
    assert fit.weights == pytest.approx(truth, abs=0.1)
    assert fit.offset == pytest.approx(offset - np.log(y.mean() / (1 - y.mean())), abs=0.1)


@pytest.mark.parametrize("positives", [20_000, 2_000])
def test_logit_is_the_log_likelihood_ratio(positives: int) -> None:
    """Gaussians of unit spread around +1 and -0.5 along the first axis have log N(x; 1) - log N(x; -0.5)
    = 1.5 x - 0.375, however many samples each has."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal((positives + 20_000, 2))
    y = np.arange(len(x)) < positives
    x[:, 0] += np.where(y, 1.0, -0.5)
    fit = logistic(x, y, ridge=1e-8)
    assert fit.weights == pytest.approx([1.5, 0.0], abs=0.12)
    assert fit.offset == pytest.approx(-0.375, abs=0.12)


def test_ridge_keeps_separable_classes_finite() -> None:
    x = np.array([[-2.0], [-1.0], [1.0], [2.0]])
    y = x[:, 0] > 0
    loose, tight = logistic(x, y, ridge=1e-3), logistic(x, y, ridge=1.0)
    assert 0 < tight.weights[0] < loose.weights[0] < 100
    assert tight.offset == pytest.approx(0.0, abs=1e-4)
    # At the optimum the ridge's slope balances the mean of expit(-margin) |x|.
    w = tight.weights[0]
    assert w == pytest.approx(0.5 * (expit(-w) + 2 * expit(-2 * w)), abs=1e-4)


@pytest.mark.parametrize("value", [True, False])
def test_logistic_needs_both_classes(value: bool) -> None:
    with pytest.raises(ValueError, match="both"):
        logistic(np.zeros((5, 2)), np.full(5, value))


def as_bytes(picture: Array) -> Image:
    return np.clip(picture, 0, 255).astype(np.uint8)


def scene(rng: np.random.Generator, lump: bool) -> tuple[Image, Image, States]:
    """Rough ground, and a smooth bright bluish disc somewhere: luma, BGR, and the disc's state."""
    gray = 90 + 25 * rng.standard_normal((HEIGHT, WIDTH))
    colour = np.repeat(gray[..., None], 3, axis=2)
    objects = boxes(1 if lump else 0)
    if lump:
        x, y = rng.uniform(25, WIDTH - 25), rng.uniform(25, HEIGHT - 25)
        rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        disc = np.hypot(columns - x, rows - y) <= RADIUS
        smooth = 140 + 4 * rng.standard_normal(int(disc.sum()))
        gray[disc] = smooth
        colour[disc] = smooth[:, None] + np.array([60.0, 0.0, -40.0])
        objects[:, X], objects[:, Y] = x, y
        objects[:, W : H + 1] = 2 * RADIUS
    return as_bytes(gray), as_bytes(colour), objects


def discs(gray: Image) -> NDArray[np.float32]:
    """Maps of a net that knows a bright smooth disc when it sees one."""
    light = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), 3.0)
    count, _, found, _ = cv2.connectedComponentsWithStats((light > 115.0).astype(np.uint8))
    large = [found[k] for k in range(1, count) if found[k, cv2.CC_STAT_AREA] > 300]
    bodies = [(x // 4, y // 4, (x + w + 3) // 4, (y + h + 3) // 4) for x, y, w, h, _ in large]
    return drawn((HEIGHT // 4, WIDTH // 4), bodies)


def births() -> PolygonBirths:
    """Boxes as large as the disc, give or take a fifth, all over the picture."""
    size = np.log(2 * RADIUS)
    profile = flat_profile((0.0, 0.0, size, size), spread=0.2)
    return polygon_births(np.ones((HEIGHT, WIDTH), np.uint8), profile, np.ones(1))


def labelled(seed: int, pictures: int, coloured: bool = False) -> list[LabelledView]:
    """Pictures of which two in three hold a lump."""
    rng = np.random.default_rng(seed)
    views = []
    for i in range(pictures):
        gray, colour, objects = scene(rng, lump=i % 3 != 2)
        views.append(LabelledView(whole_picture(gray).view(gray, colour if coloured else None), objects))
    return views


def overlaps(state: Array, other: Array, share: float = 0.25) -> bool:
    """Whether two boxes have more than a share of their union in common, corner by corner."""
    low = [max(state[i] - state[i + 6] / 2, other[i] - other[i + 6] / 2) for i in (0, 1)]
    high = [min(state[i] + state[i + 6] / 2, other[i] + other[i + 6] / 2) for i in (0, 1)]
    common = max(high[0] - low[0], 0.0) * max(high[1] - low[1], 0.0)
    return bool(common > share * (state[6] * state[7] + other[6] * other[7] - common))


def scores(
    likelihood: LumpLikelihood | HistogramLikelihood, views: list[LabelledView]
) -> tuple[Array, Array]:
    """Log ratios of the labelled boxes, and of boxes elsewhere that lie in the polygon."""
    rng = np.random.default_rng(99)
    found, missed = [], []
    for item in views:
        seen = likelihood.observe(item.view)
        found.append(seen.log_ratio(item.objects))
        tried = births().draw(100, rng)[0]
        elsewhere = [
            state
            for state in tried
            if box_inside(item.view.inside, state)[1] >= LEAST_INSIDE
            and not any(overlaps(state, other) for other in item.objects)
        ]
        missed.append(seen.log_ratio(np.array(elsewhere)))
    return np.concatenate(found), np.concatenate(missed)


def test_fit_lump_separates_fresh_pictures() -> None:
    fit = fit_lump([(labelled(1, 18), births())], np.random.default_rng(0), discs)
    likelihood = LumpLikelihood(discs, fit.mean, fit.scale, fit.weights, fit.offset, 1.0, np.inf)
    found, missed = scores(likelihood, labelled(2, 18))
    assert len(found) == 12
    assert area_under_roc(found, missed) > 0.95
    assert np.median(found) > 0 > np.median(missed)


@pytest.mark.parametrize("channel", ["luma", "colour"])
def test_fit_histogram_separates_fresh_pictures(channel: Channel) -> None:
    coloured = channel == "colour"
    fit = fit_histogram(labelled(1, 18, coloured), births(), channel, np.random.default_rng(0))
    likelihood = HistogramLikelihood(fit.reference, fit.offset, fit.slope, 1.0, np.inf, channel)
    assert fit.reference.sum() == pytest.approx(1.0)
    assert fit.reference.min() > 0
    assert fit.slope > 0
    assert fit.channel == channel
    found, missed = scores(likelihood, labelled(2, 18, coloured))
    assert area_under_roc(found, missed) > 0.95
    assert np.median(found) > 0 > np.median(missed)


def test_histogram_reference_is_that_of_the_objects() -> None:
    """A box around a disc of 140 +- 4 holds pi/4 of bin 8 (128 to 143, below one sd) and a little of 9."""
    fit = fit_histogram(labelled(1, 18), births(), "luma", np.random.default_rng(0))
    assert fit.reference.argmax() == 8
    assert 0.5 < fit.reference[8] < 0.8


def test_same_seed_same_fit() -> None:
    views = labelled(1, 6)
    one, two = (fit_lump([(views, births())], np.random.default_rng(5), discs, rounds=1) for _ in range(2))
    assert one.weights.tobytes() == two.weights.tobytes()
    assert one.offset == two.offset


def test_no_usable_box_is_refused() -> None:
    """No object at all, or one outside the polygon."""
    empty = [item for item in labelled(1, 6) if len(item.objects) == 0]
    outside = [LabelledView(item.view, boxes(1, x=900.0, y=60.0, w=30.0, h=30.0)) for item in empty]
    for views in (empty, outside):
        with pytest.raises(ValueError, match="no labelled box"):
            fit_lump([(views, births())], np.random.default_rng(0), discs)
        with pytest.raises(ValueError, match="no labelled box"):
            fit_histogram(views, births(), "luma", np.random.default_rng(0))


def test_colour_histogram_needs_colour() -> None:
    with pytest.raises(ValueError, match="needs colour"):
        fit_histogram(labelled(1, 3), births(), "colour", np.random.default_rng(0))


def test_lump_at_the_edge_of_a_polygon_is_left_out() -> None:
    """Labelled boxes that lie mostly outside teach nothing; the others suffice."""
    views = labelled(1, 9)
    roi = make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], WIDTH, HEIGHT, WIDTH)
    far = boxes(1, x=-5.0, y=60.0, w=30.0, h=30.0)
    more = [LabelledView(roi.view(item.view.gray), np.concatenate([item.objects, far])) for item in views]
    fit = fit_lump([(more, births())], np.random.default_rng(0), discs, rounds=1)
    assert np.all(np.isfinite(fit.weights))


def test_a_handful_of_lumps_leaves_the_rest_to_what_is_known() -> None:
    """With hardly any evidence the weights stay near the known ones, without any near zero."""
    known = fit_lump([(labelled(1, 18), births())], np.random.default_rng(0), discs)
    few = [(labelled(7, 1), births())]
    told = fit_lump(few, np.random.default_rng(0), discs, known, rounds=1)
    untold = fit_lump(few, np.random.default_rng(0), discs, rounds=1)
    assert np.array_equal(told.mean, known.mean)
    apart = float(np.linalg.norm(told.weights - known.weights))
    assert apart < 0.5 * float(np.linalg.norm(untold.weights - known.weights))


def test_mistakes_are_the_best_scores_away_from_objects() -> None:
    """Climbing finds boxes that score higher than the best of as many drawn at random, none on an object."""
    fit = fit_lump([(labelled(1, 18), births())], np.random.default_rng(0), discs)
    model = LumpLikelihood(discs, fit.mean, fit.scale, fit.weights, fit.offset, 1.0, np.inf)
    leads = []
    for number, item in enumerate(labelled(3, 27)):
        seen = model.observe(item.view)
        found = mistaken(seen, births(), item.objects, np.random.default_rng(number))
        assert 0 < len(found) <= 3
        for state in found:
            for other in item.objects:
                sides = [
                    min(state[i] + state[i + 6] / 2, other[i] + other[i + 6] / 2)
                    - max(state[i] - state[i + 6] / 2, other[i] - other[i + 6] / 2)
                    for i in (0, 1)
                ]
                assert max(sides[0], 0.0) * max(sides[1], 0.0) <= 0.1 * state[6] * state[7] + 1e-9
        if len(item.objects) == 0:
            drawn = births().draw(712, np.random.default_rng(100 + number))[0]
            leads.append(seen.score(found).max() - seen.score(drawn).max())
    assert np.median(leads) > 0


def test_misfits_lie_on_the_object_and_are_much_too_small_or_too_large() -> None:
    objects = boxes(50, 80.0, 60.0, 30.0, 20.0)
    tried = misfits(objects, np.random.default_rng(0))
    scale = tried[:, W] / 30.0
    assert tried[:, H] / 20.0 == pytest.approx(scale)
    assert np.all((scale < np.exp(-0.4)) | (scale > np.exp(0.4)))
    assert (scale < 1).sum() == 50
    for axis, size in ((X, W), (Y, H)):
        apart = np.abs(tried[:, axis] - objects[0, axis])
        assert np.all(apart <= 0.5 * np.abs(tried[:, size] - objects[0, size]) + 1e-9)


def test_tempting_lies_badly_on_each_object_and_scores_well() -> None:
    """Less than 0.3 of the union in common with the object, and a better score than such boxes usually have."""
    fit = fit_lump([(labelled(1, 18), births())], np.random.default_rng(0), discs, rounds=1)
    model = LumpLikelihood(discs, fit.mean, fit.scale, fit.weights, fit.offset, 1.0, np.inf)
    alike = []
    for number, item in enumerate(labelled(3, 27)):
        seen = model.observe(item.view)
        found = tempting(seen, item.objects, np.random.default_rng(number))
        assert len(found) <= len(item.objects)
        for state in found:
            other = item.objects[0]
            sides = [
                min(state[i] + state[i + 6] / 2, other[i] + other[i + 6] / 2)
                - max(state[i] - state[i + 6] / 2, other[i] - other[i + 6] / 2)
                for i in (0, 1)
            ]
            common = max(sides[0], 0.0) * max(sides[1], 0.0)
            assert 0 < common < 0.3 * (state[W] * state[H] + other[W] * other[H] - common)
            usual = misfits(np.repeat(item.objects, 9, axis=0), np.random.default_rng(7))
            usual = usual[[not overlaps(one, other, 0.3) for one in usual]]
            alike.append(seen.score(found)[0] - np.median(seen.score(usual)))
    assert len(alike) > 10
    assert np.median(alike) > 0


def test_the_score_is_calibrated_against_ore_alone() -> None:
    """Boxes that lie badly on a lump teach its place, and do not make the lump doubtful: its box stays above zero."""
    fit = fit_lump([(labelled(1, 18), births())], np.random.default_rng(0), discs)
    model = LumpLikelihood(discs, fit.mean, fit.scale, fit.weights, fit.offset, 1.0, np.inf)
    whole, half = [], []
    for item in labelled(5, 18):
        seen = model.observe(item.view)
        whole.append(seen.score(item.objects))
        part = item.objects.copy()
        part[:, W : H + 1] *= 0.5
        half.append(seen.score(part))
    assert np.median(np.concatenate(whole)) > 0
    assert np.median(np.concatenate(whole) - np.concatenate(half)) > 1
