"""The experiments of section 4."""

from __future__ import annotations

from functools import partial

from tests.reproduction.paper1.footage import feed, football
from tests.reproduction.paper1.methods import Experiment
from tests.reproduction.paper1.scenes import bouncing_square, juggling, slide, table_tennis

LEVELS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
SQUARE_CLEAN, SQUARE_NOISY = 8.0, 43.0

SQUARE = Experiment(
    key="square_clean",
    title="Bouncing square (4.1), clean",
    scene=partial(bouncing_square, noise=SQUARE_CLEAN),
    kinds=("constant_velocity", "bounce_x"),
    names=("velocity", "bounce x"),
    component="column",
    singles=("constant_velocity", "random_walk"),
    levels=LEVELS,
)
NOISY_SQUARE = Experiment(
    key="square_noisy",
    title="Bouncing square (4.1), high noise",
    scene=partial(bouncing_square, noise=SQUARE_NOISY),
    kinds=SQUARE.kinds,
    names=SQUARE.names,
    component="column",
    singles=SQUARE.singles,
    levels=LEVELS,
)
PING_PONG = Experiment(
    key="ping_pong",
    title="Ping-pong (4.1)",
    scene=partial(table_tennis, noise=40.0),
    evidence=0.45,
    kinds=("constant_velocity", "bounce_y", "bounce_x"),
    names=("velocity", "bounce y", "bounce x"),
    component="position",
    singles=("constant_velocity", "constant_acceleration", "random_walk"),
    levels=LEVELS,
)
JUGGLING = Experiment(
    key="juggling",
    title="Football juggling (4.2), generated",
    scene=partial(juggling, noise=42.0),
    kinds=("constant_acceleration", "bounce_y"),
    names=("acceleration", "bounce y"),
    component="vertical_velocity",
    singles=("constant_acceleration", "constant_velocity", "random_walk"),
    levels=LEVELS,
)
FOOTBALL = Experiment(
    key="football",
    title="Football juggling (4.2), real footage",
    scene=partial(football, noise=10.0, training=False),
    training_scene=partial(football, noise=10.0, training=True),
    needs_footage=True,
    kinds=JUGGLING.kinds,
    names=JUGGLING.names,
    component="vertical_velocity",
    singles=JUGGLING.singles,
    levels=LEVELS,
    likelihood="colour",
    evidence=0.3,
    bound=3.0,
)
SLIDE = Experiment(
    key="slide",
    title="Slide (4.3)",
    scene=partial(slide, noise=56.0),
    kinds=("constant_acceleration", "random_walk"),
    names=("acceleration", "random walk"),
    component="row",
    singles=("constant_velocity", "constant_acceleration", "random_walk"),
    levels=LEVELS,
    training_seeds=tuple(range(1000, 1012)),
)
LUMP = Experiment(
    key="lump",
    title="Large lump (4.4)",
    scene=partial(feed, noise=8.0),
    kinds=("constant_acceleration", "constant_acceleration"),
    names=("belt", "fall"),
    component="row",
    singles=("constant_acceleration", "constant_velocity", "constant_position"),
    levels=LEVELS,
    likelihood="lump",
    evidence=0.5,
    bound=3.0,
    training_seeds=tuple(range(1000, 1008)),
)
EXPERIMENTS = (SQUARE, NOISY_SQUARE, PING_PONG, JUGGLING, FOOTBALL, SLIDE, LUMP)
