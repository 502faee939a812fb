"""The experiments of section 4: what is seen, by which models, and what it shows.

The noise of each scene is chosen so that one frame does not decide: a filter has to gather evidence
along the path, and a wrong motion model costs it. Tempering and bound are the same for all methods.
"""

from __future__ import annotations

from functools import partial

from tests.reproduction.paper1.footage import FEED_FPS, REAL_TRAINING, feed, football
from tests.reproduction.paper1.methods import Experiment
from tests.reproduction.paper1.scenes import (
    SLIDE_FRAMES,
    SQUARE_STEPS,
    bouncing_square,
    juggling,
    slide,
    table_tennis,
)

LEVELS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
SQUARE_CLEAN, SQUARE_NOISY = 8.0, 43.0
TABLE_NOISE, JUGGLING_NOISE, FOOTBALL_NOISE, SLIDE_NOISE, FEED_NOISE = 40.0, 42.0, 10.0, 56.0, 8.0
_GREY = "grey levels of noise"

SQUARE = Experiment(
    key="square_clean",
    title="Bouncing square (4.1), clean",
    scene=partial(bouncing_square, noise=SQUARE_CLEAN),
    kinds=("constant_velocity", "bounce_x"),
    names=("velocity", "bounce x"),
    component="column",
    singles=("constant_velocity", "random_walk"),
    levels=LEVELS,
    about=f"A textured square crosses in {SQUARE_STEPS} frames and bounces; {SQUARE_CLEAN:g} {_GREY}.",
    remarks="""With a clear picture one frame nearly suffices, so that a single model with enough noise follows the
square through its bounce: the filters differ in how much noise they need for it, which the last table shows.
At the low levels of noise, the case of the paper's Fig. 9, the single models lose the square at every bounce.""",
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
    about=f"The same square in {SQUARE_NOISY:g} {_GREY}.",
    remarks="""A crossing is about as long as it takes to gather the evidence for a detection. Constant velocity throws
the evidence away at every bounce, and noise wide enough to follow it spreads the particles over more than
the evidence of a frame can make good. The false alarms of the filters that see the square are the few
frames for which they still expect it after it has gone.""",
)
PING_PONG = Experiment(
    key="ping_pong",
    title="Ping-pong (4.1)",
    scene=partial(table_tennis, noise=TABLE_NOISE),
    kinds=("constant_velocity", "bounce_y", "bounce_x"),
    names=("velocity", "bounce y", "bounce x"),
    component="position",
    singles=("constant_velocity", "constant_acceleration", "random_walk"),
    levels=LEVELS,
    evidence=0.45,
    about=f"""A table-tennis rally under gravity with exact positions; {TABLE_NOISE:g} {_GREY}. Flight is
constant velocity with noise, as in the paper; a bounce falls between two frames.""",
    remarks="""Here the prior has most to say: a switch is rare everywhere and nearly certain above the table's ends and
at the bats. The `sampled` form has only the birth probability's share of its particles newborn at each frame,
too few to hit a small fast ball; the `marginal` form spends a fixed share on them.""",
)
JUGGLING = Experiment(
    key="juggling",
    title="Football juggling (4.2), generated",
    scene=partial(juggling, noise=JUGGLING_NOISE),
    kinds=("constant_acceleration", "bounce_y"),
    names=("acceleration", "bounce y"),
    component="vertical_velocity",
    singles=("constant_acceleration", "constant_velocity", "random_walk"),
    levels=LEVELS,
    about=f"A ball falls, is kicked up before it lands, and falls again; {JUGGLING_NOISE:g} {_GREY}.",
    remarks="""The prior over the vertical velocity helps at the kick, where the adaptive filter keeps the ball more
often than the fixed matrix. Between kicks the two are alike: kicks are rare, so that the fixed matrix spends
few particles on them.""",
)
FOOTBALL = Experiment(
    key="football",
    title="Football juggling (4.2), real footage",
    scene=partial(football, noise=FOOTBALL_NOISE, training=False),
    training_scene=partial(football, noise=FOOTBALL_NOISE, training=True),
    needs_footage=True,
    kinds=JUGGLING.kinds,
    names=JUGGLING.names,
    component="vertical_velocity",
    singles=JUGGLING.singles,
    levels=(0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 8.0),
    training_seeds=tuple(range(1000, 1008)),
    likelihood="colour",
    evidence=0.3,
    bound=3.0,
    about=f"""A person juggles a football, filmed by a fixed camera: the first {REAL_TRAINING} frames train and
the rest test. Colour histogram as in the paper; {FOOTBALL_NOISE:g} {_GREY} are added, by which (and by its
particles) one seed differs from another. Empty frames show the median picture. Motion models are inferred
from the boxes, so that there are no true switches to measure at.""",
    remarks="""Whether the adaptive filter is as good as the fixed matrix here, the table says. Where it is not, the
learned densities are not the cause: without the filter, Eq. 12 predicts the models of the second half better than
Eq. 10 does (last columns of the summary). Nor does it lose the ball later: after frame 15 both hold it. The
difference lies in the first detection, some frames later with the higher noise level that the few kicks of the
training half choose for the adaptive filter. Some kicks last two frames, with a velocity between them that is
that of neither model. The
interval speaks of the seeds (noise and particles), not of other footage.""",
)
SLIDE = Experiment(
    key="slide",
    title="Slide (4.3)",
    scene=partial(slide, noise=SLIDE_NOISE),
    kinds=("constant_acceleration", "random_walk"),
    names=("acceleration", "random walk"),
    component="row",
    singles=("constant_velocity", "constant_acceleration", "random_walk"),
    levels=LEVELS,
    training_seeds=tuple(range(1000, 1012)),
    about=f"""A person slides down and wanders about at the end, {SLIDE_FRAMES} frames; {SLIDE_NOISE:g}
{_GREY}.""",
    remarks="""Constant acceleration is right on the slide and wrong after it; constant velocity lags behind and then
runs off. The filters that hold the person to the last frame expect it for a few frames more, which counts as false
alarms; those that had lost it before have none.""",
)
LUMP = Experiment(
    key="lump",
    title="Large lump (4.4)",
    scene=partial(feed, noise=FEED_NOISE),
    kinds=("constant_acceleration", "constant_acceleration"),
    names=("belt", "fall"),
    component="row",
    singles=("constant_acceleration", "constant_velocity", "constant_position"),
    levels=LEVELS,
    likelihood="lump",
    evidence=0.5,
    bound=3.0,
    training_seeds=tuple(range(1000, 1008)),
    about=f"""One large lump of the simulated feed at {FEED_FPS:g} frames a second, on the belt and in its fall,
with the lump likelihood of the service; {FEED_NOISE:g} {_GREY}.""",
    remarks="""The lump is on the belt for nearly all of its frames, where one small acceleration is the right model;
the fall lasts two or three frames. The share of detected frames can therefore differ little. What the second
model gives is the fall itself: the lump is held where the single models leave their estimate behind on the belt.
The error in position is larger than in the other scenes because the lump likelihood is broad for a large lump.""",
)
EXPERIMENTS = (SQUARE, NOISY_SQUARE, PING_PONG, JUGGLING, FOOTBALL, SLIDE, LUMP)
