"""The page of the experiments: every figure in it is computed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tests.reproduction.paper1.measure import HELD, SETTLED, Measures
from tests.reproduction.paper1.methods import BIRTH, DEATH
from tests.reproduction.paper1.runner import Outcome, Result

TARGETS = {"adaptive": (">=", 95.0), "constant velocity": ("<=", 35.0), "random walk": ("<=", 5.0)}
"""Per cent of frames after frame 15, high-noise bouncing square."""


class Difference(NamedTuple):
    """Mean of a paired difference over the test seeds and its 95 % interval."""

    mean: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """What the interval allows to say."""
        if self.low > 0.0:
            return "better"
        return "worse" if self.high < 0.0 else "no difference"


def difference(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> Difference:
    """Paired difference by Student's t."""
    gap = ours - theirs
    gap = gap[~np.isnan(gap)]
    if len(gap) < 2:
        return Difference(float("nan"), float("-inf"), float("inf"))
    reach = float(stats.t.ppf(0.975, len(gap) - 1)) * float(gap.std(ddof=1)) / len(gap) ** 0.5
    return Difference(float(gap.mean()), float(gap.mean()) - reach, float(gap.mean()) + reach)


def net(outcome: Outcome) -> NDArray[np.float64]:
    """Detected less false alarms, per cent, of each test seed."""
    return 100.0 * np.array([m.detected - m.false_alarms for m in outcome.measures])


def write(results: list[Result], skipped: list[str], images: dict[str, str]) -> str:
    """The page as Markdown; `images` maps an experiment's key to the picture's path from the page."""
    first = results[0].prepared.experiment
    parts = [
        "<!-- Written by `make reproduce`. -->",
        "# Adaptive multi-motion-model joint detection and tracking: the experiments of paper 1",
        _method_text(first.particles),
        "## Summary",
        _summary(results),
    ]
    parts += skipped
    for result in results:
        parts += _section(result, images[result.prepared.experiment.key])
    return "\n\n".join(parts) + "\n"


def _method_text(particles: int) -> str:
    return f"""Every method is a configuration of the one filter in `models.jdt` with {particles} particles, and
sees the same pictures. *adaptive* switches by Eq. 12 and *fixed matrix* by Eq. 10 with the same learned matrix;
a single-model filter has one motion model. Unless it says otherwise a method draws the model first and
computes existence from the weights (`model_first`, `marginal`). With *state first* (Eq. 9 literally)
the label at t-1 moves x_t: the label that training pairs with x_t-1 is that of the step after, so that
Eq. 12 names the model before the object needs it. *sampled* keeps existence as a part of each particle.

What is the same for all methods of an experiment, and learned from its training scenes: the appearance
(a histogram's reference, offset and slope, or the lump likelihood), tempering and bound, where, how large
and how fast objects are born, and the chances of birth ({BIRTH:g} a frame) and death ({DEATH:g} a frame).
Rates of acceleration, transition matrix and densities are learned from the same training tracks with the
labels of the generator, or inferred from the boxes where there are none. The bandwidth of a density is chosen by
leave-one-out likelihood: Scott's rule blurs two places of bouncing into one. The one thing that each method
has for itself is its noise level, the best of a common list on the training seeds by the share of
detected frames less the share of false alarms; in a filter of several models the level is that of the
quietest and the others keep their learned proportion to it. Test seeds are never used in training.

How hard the scenes are (noise, tempering, speed, empty frames) and the rule for the bandwidth were set by hand,
with results of other seeds in view, so that the filters differ; the test seeds were first run after that. The
verdicts hold for these scenes and not for every scene of the kind. A slower slide with fewer empty frames gave no
difference between the adaptive filter and constant velocity; a lump at another frame rate or belt speed gave
next to none between the adaptive filter and one small acceleration; clean pictures level most differences. For
the real footage no part is fresh: its added noise, its tempering and its list of levels were set with results on
its second half in view.

A frame counts as *detected* when existence is above 0.5 while the object is there, and as a *false alarm*
when it is while the object is not, in the empty frames before and after it. *Held after a switch*: the
share of the {HELD} frames from each change of the motion model on in which existence is above 0.5 and
the estimate lies inside the object's box. Cells show the median over the test
seeds and in brackets the quartiles. A method that never detects has no first detection and no error.
The second table of each experiment gives the mean paired difference over seeds with its 95 % interval."""


def _summary(results: list[Result]) -> str:
    rows = [
        "| experiment | adaptive against the fixed matrix | against each single model "
        "| log probability of the next model, Eq. 12 | Eq. 10 |",
        "|---|---|---|---|---|",
    ]
    for result in results:
        ours, fixed, singles = _groups(result)
        against = "; ".join(
            f"{one.method.name}: {difference(net(ours), net(one)).verdict}" for one in singles
        )
        rows.append(
            f"| {result.prepared.experiment.title} | {difference(net(ours), net(fixed)).verdict} | {against} "
            f"| {result.prediction[0]:.3f} | {result.prediction[1]:.3f} |"
        )
    rows += [
        "",
        """By detected less false alarms; *no difference* where the 95 % interval holds zero. The last two columns
need no filter: the mean log probability that the learned prediction function gives to the true next model,
from the true state before it, over the test scenes (0 is best).""",
    ]
    for result in results:
        if result.prepared.experiment.key == "square_noisy":
            rows += ["", _targets(result)]
    return "\n".join(rows)


def _targets(result: Result) -> str:
    lines = [
        f"Noisy bouncing square, share of frames after frame {SETTLED} with existence above 0.5, "
        "mean over the test seeds:",
        "",
        "| method | goal | reached |",
        "|---|---|---|",
    ]
    for outcome in result.outcomes:
        if outcome.method.name in TARGETS:
            sign, goal = TARGETS[outcome.method.name]
            reached = 100.0 * float(np.mean([m.detected_late for m in outcome.measures]))
            met = reached >= goal if sign == ">=" else reached <= goal
            lines.append(
                f"| {outcome.method.name} | {sign} {goal:.0f} % | {reached:.1f} % ({'met' if met else 'missed'}) |"
            )
    return "\n".join(lines)


def _groups(result: Result) -> tuple[Outcome, Outcome, list[Outcome]]:
    """The adaptive filter, the fixed matrix and the single models."""
    fixed = next(o for o in result.outcomes if not o.method.adaptive and not o.method.single)
    return result.outcomes[0], fixed, [o for o in result.outcomes if o.method.single]


def _section(result: Result, image: str) -> list[str]:
    experiment = result.prepared.experiment
    seeds = f"{len(experiment.training_seeds)} training seeds, {len(experiment.test_seeds)} test seeds."
    return [
        f"## {experiment.title}",
        f"{experiment.about} {seeds}",
        f"![{experiment.title}]({image})",
        _table(result),
        _differences(result),
        _levels(result),
        *([experiment.remarks] if experiment.remarks else []),
    ]


def _levels(result: Result) -> str:
    levels = result.prepared.experiment.levels
    rows = [
        "Detected less false alarms on the training seeds (%), from which the noise level was chosen:",
        "",
        f"| noise (px/frame) | {' | '.join(f'{level:g}' for level in levels)} |",
        "|" + "---|" * (len(levels) + 1),
    ]
    for outcome in result.outcomes:
        cells = [
            f"**{100 * score:.1f}**" if level == outcome.level else f"{100 * score:.1f}"
            for level, score in zip(levels, outcome.scores, strict=True)
        ]
        rows.append(f"| {outcome.method.name} | {' | '.join(cells)} |")
    return "\n".join(rows)


_COLUMNS: tuple[tuple[str, Callable[[Measures], float], float, int], ...] = (
    ("detected (%)", lambda m: m.detected, 100.0, 1),
    (f"after frame {SETTLED} (%)", lambda m: m.detected_late, 100.0, 1),
    ("held after a switch (%)", lambda m: m.after_switch, 100.0, 1),
    ("false alarms (%)", lambda m: m.false_alarms, 100.0, 1),
    ("first detection (frames)", lambda m: m.first, 1.0, 0),
    ("error (px)", lambda m: m.error, 1.0, 1),
)


_COMPARED: tuple[tuple[Callable[[Measures], float], float], ...] = (
    (lambda m: m.detected, 100.0),
    (lambda m: m.false_alarms, 100.0),
    (lambda m: m.after_switch, 100.0),
    (lambda m: m.error, 1.0),
)


def _table(result: Result) -> str:
    heads = ["method", "noise (px/frame)", *(name for name, *_ in _COLUMNS)]
    rows = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for outcome in result.outcomes:
        cells = [
            spread(np.array([get(m) for m in outcome.measures]) * factor, digits)
            for _, get, factor, digits in _COLUMNS
        ]
        rows.append(f"| {outcome.method.name} | {outcome.level:g} | {' | '.join(cells)} |")
    return "\n".join(rows)


def spread(values: NDArray[np.float64], digits: int) -> str:
    """Median and quartiles, without what is not a number."""
    values = values[~np.isnan(values)]
    if len(values) == 0:
        return "-"
    low, middle, high = np.percentile(values, [25, 50, 75])
    return f"{middle:.{digits}f} ({low:.{digits}f}-{high:.{digits}f})"


def _differences(result: Result) -> str:
    ours = result.outcomes[0]
    rows = [
        "| adaptive less ... | detected (points) | false alarms (points) | held after a switch (points) "
        "| error (px) | detected less false alarms (points) | adaptive is |",
        "|---|---|---|---|---|---|---|",
    ]
    for other in result.outcomes[1:]:
        gaps = [
            difference(*(factor * np.array([get(m) for m in o.measures]) for o in (ours, other)))
            for get, factor in _COMPARED
        ]
        gain = difference(net(ours), net(other))
        cells = " | ".join(_interval(gap) for gap in (*gaps, gain))
        rows.append(f"| {other.method.name} | {cells} | {gain.verdict} |")
    return "\n".join(rows)


def _interval(one: Difference) -> str:
    if np.isnan(one.mean):
        return "-"
    return f"{one.mean:+.1f} ({one.low:+.1f} to {one.high:+.1f})"
