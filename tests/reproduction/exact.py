"""The filter of paper 1 beside the exact posterior: `python -m tests.reproduction exact`.

A lump enters at the top of a strip of pixels, moves slowly and falls from a lip on; where it switches was learned from
other lumps (Eq. 14), as in the paper's Fig. 5. State, model and existence are few enough to sum over a fine grid
(Eq. 9, Eq. 12, Eq. 15), so the posterior is known, and every difference is the particles'.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models import AdaptiveSwitching, ExistenceChain, JdtFilter, blank, learn_density, plot
from lumpwatch.models.jdt.filter import Form, Step
from lumpwatch.models.jdt.switching import conditional, joint_probabilities
from lumpwatch.models.state import States, Y
from tests.models.helpers import Drift, births_over, flat_profile
from tests.models.oracles import LineFilter
from tests.reproduction import exact_page
from tests.reproduction.exact_page import (
    CONTRAST,
    DT,
    EDGES,
    ENTERS,
    FORMS,
    FRAMES,
    KNOTS,
    ROWS,
    SHOWN,
    SIDE,
    Errors,
)

DOCS = Path(__file__).parents[2] / "docs"
Array = NDArray[np.float64]
LIP, BORN = 100.0, 60
SPEEDS, NOISES = (18.0, 75.0), (6.0, 15.0)
"""px/s, and px gathered in one second: on the belt, falling."""
NUMBERS = (100, 300, 1000, 3000, 10_000)
SEEDS = 20

MODELS = tuple(Drift(name, SPEEDS[k], NOISES[k], along=Y) for k, name in enumerate(("belt", "fall")))
CHAIN = ExistenceChain(birth_rate=0.3, death_rate=0.1)


def path(rng: np.random.Generator) -> tuple[Array, NDArray[np.intp]]:
    """Rows of a lump from its entry until it is out of sight, and the model of each step but the first."""
    rows, labels = [rng.uniform(10.0, 40.0)], [0]
    while rows[-1] < ROWS + SIDE:
        labels.append(int(rows[-1] > LIP + rng.normal(0.0, 4.0) or labels[-1] == 1))
        m = labels[-1]
        rows.append(rows[-1] + SPEEDS[m] * DT + NOISES[m] * np.sqrt(DT) * float(rng.standard_normal()))
    return np.array(rows), np.array(labels, dtype=np.intp)


def law() -> AdaptiveSwitching:
    """Eq. 12 from twenty other lumps."""
    rng = np.random.default_rng(100)
    before, pairs = [], []
    for _ in range(20):
        rows, labels = path(rng)
        before += list(zip(rows[:-1], labels[1:], strict=True))
        pairs += list(pairwise(labels))
    states = blank(len(before))
    states[:, Y] = [row for row, _ in before]
    density = learn_density(states, np.array([m for _, m in before], np.intp), 2, (Y,), 2.0)
    previous, following = np.array(pairs, dtype=np.intp).T
    matrix = conditional(joint_probabilities(previous, following, 2))
    return AdaptiveSwitching(matrix, DT, np.zeros(2, np.bool_), density)


def strips(rng: np.random.Generator) -> tuple[Array, Array]:
    """Grey values (FRAMES, ROWS) in standard deviations of the noise, and the lump's row, NaN where there is none."""
    rows, _ = path(rng)
    truth = np.full(FRAMES, np.nan)
    truth[ENTERS : ENTERS + len(rows)] = rows[: FRAMES - ENTERS]
    seen = rng.standard_normal((FRAMES, ROWS))
    pixels = np.arange(ROWS) + 0.5
    for strip, row in zip(seen, truth, strict=True):
        strip[np.abs(pixels - row) < SIDE / 2] += CONTRAST
    return seen, truth


PLACES = np.arange(-SIDE, ROWS + SIDE + 1.0)


def log_ratios(clip: Array) -> Array:
    """The log likelihood ratio (n, k) of a lump at each of `PLACES` (Eq. 15), exact for Gaussian noise.

    Between them it is linear for both filters, beyond them 0.
    """
    covered = np.abs(PLACES - np.arange(ROWS)[:, None] - 0.5) < SIDE / 2
    return (CONTRAST * clip - 0.5 * CONTRAST**2) @ covered


def exact(ratios: Array, switching: AdaptiveSwitching) -> tuple[Array, Array, Array]:
    """Existence (n,), probability of each cell between `EDGES` (n, k), and P(fall) (n,) given existence."""
    states = blank(len(KNOTS))
    states[:, Y] = KNOTS
    rows = np.stack([switching.rows(states, np.full(len(KNOTS), a, np.intp), DT)[0] for a in (0, 1)])
    birth = np.outer((1.0, 0.0), (KNOTS > 0) & (KNOTS < BORN)) / BORN
    p_birth, p_death = CHAIN.probabilities(DT)
    line = LineFilter(KNOTS, SPEEDS, NOISES, rows, birth, p_birth, p_death, DT, model_first=True)
    density, alive = birth, 0.0
    existence, shares, falls = [], [], []
    for ratio in ratios:
        density, alive, _ = line.step(density, alive, np.exp(np.interp(KNOTS, PLACES, ratio)))
        cells, _ = np.histogram(KNOTS, EDGES, weights=density.sum(axis=0) * line.cell)
        existence.append(alive)
        shares.append(alive * cells)
        falls.append(float(density[1].sum() * line.cell))
    return np.array(existence), np.array(shares), np.array(falls)


@dataclass(frozen=True)
class _Strip:
    """One picture as the filter asks it."""

    ratio: Array

    def log_ratio(self, states: States) -> Array:
        """(n,) of states (n, 8)."""
        return np.interp(states[:, Y], PLACES, self.ratio)


def particles(
    ratios: Array, switching: AdaptiveSwitching, number: int, form: Form, seed: int
) -> Iterator[Step]:
    """The filter that ships, over the same pictures."""
    jdt = JdtFilter(
        MODELS, switching, births_over(4, BORN, (1.0, 0.0)), flat_profile((0.0, 0.0, 2.0, 2.0)), CHAIN,
        particles=number, form=form,
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    belief = jdt.start(rng)
    for ratio in ratios:
        step = jdt.step(belief, _Strip(ratio), DT, rng)
        belief = step.belief
        yield step


def compare(
    ratios: Array,
    switching: AdaptiveSwitching,
    truth: tuple[Array, Array],
    number: int,
    form: Form,
    seeds: int,
) -> Errors:
    """Run with different seeds and compare with the exact `truth`: existence and cells."""
    existence, cells = truth
    found, variation = [], []
    for seed in range(seeds):
        beliefs = [step.belief for step in particles(ratios, switching, number, form, seed)]
        alive = np.array([belief.existence for belief in beliefs])
        shares = np.array([plot.share(belief, Y, EDGES) for belief in beliefs])
        found.append(alive)
        variation.append(0.5 * (np.abs(shares - cells).sum(axis=1) + np.abs(alive - existence)).mean())
    runs = np.array(found)
    return Errors(
        float(np.abs(runs - existence).mean()),
        float(np.mean(variation)),
        float(np.abs(runs.mean(axis=0) - existence).max()),
    )


def main(docs: Path = DOCS, numbers: tuple[int, ...] = NUMBERS, seeds: int = SEEDS) -> None:
    """Compare, and write the page and its pictures below `docs`."""
    switching = law()
    clip, rows = strips(np.random.default_rng(7))
    ratios = log_ratios(clip)
    existence, cells, falls = exact(ratios, switching)
    table = {
        (form, number): compare(ratios, switching, (existence, cells), number, form, seeds)
        for form in FORMS
        for number in numbers
    }
    for folder in ("images", "results"):
        (docs / folder).mkdir(parents=True, exist_ok=True)
    few, many = (list(particles(ratios, switching, number, "marginal", 0)) for number in SHOWN)
    exact_page.draw(
        docs / "images" / "exact.png", clip, rows, (existence, cells, falls), switching, (few, many)
    )
    exact_page.draw_errors(docs / "images" / "exact_errors.png", table)
    text = exact_page.write(__doc__ or "", table, seeds)
    (docs / "results" / "exact.md").write_text(text, encoding="utf-8")
