"""The matrix of difficulty: scenes of the simulated feed, and the seeds to train and to test on.

A scene changes one thing of the standard scene (an axis, in steps), or combines some; both styles of the
feed are in it. At the same seed all scenes of one style and one rate have the same traffic, so steps compare
pair by pair. Seeds for training and for testing, with lumps and without, have no number in common.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lumpwatch.service.simulator.spec import FeedSpec

TRAIN_SEEDS, TEST_SEEDS = range(1000, 1010), range(5000, 5020)
TRAIN_EMPTY_SEEDS, TEST_EMPTY_SEEDS = range(2000, 2010), range(6000, 6040)
LONG_SEEDS = range(7000, 7200)
"""Of the long run without lumps: even ones for style a, odd ones for style b."""

# Lumps of 1.2 to 2 times the limit, eight a minute, in moderate dust.
STANDARD = FeedSpec(smallest_lump=1.2, largest_lump=2.0, lumps_per_minute=8.0, dust=0.4)


@dataclass(frozen=True)
class Scene:
    """One cell of the matrix. `axis` names what is changed; steps of an axis come from easy to hard."""

    name: str
    axis: str
    spec: FeedSpec
    """Its seed means nothing: take the specs below."""

    def train(self) -> Iterator[FeedSpec]:
        """Feeds with lumps to learn from."""
        return self._seeded(TRAIN_SEEDS)

    def test(self) -> Iterator[FeedSpec]:
        """Feeds with lumps to measure on."""
        return self._seeded(TEST_SEEDS)

    def train_empty(self) -> Iterator[FeedSpec]:
        """Feeds without lumps to learn from."""
        return self._seeded(TRAIN_EMPTY_SEEDS, lumps_per_minute=0.0)

    def test_empty(self) -> Iterator[FeedSpec]:
        """Feeds without lumps to count false alarms on; medium and near-limit rocks remain."""
        return self._seeded(TEST_EMPTY_SEEDS, lumps_per_minute=0.0)

    def _seeded(self, seeds: range, **changes: object) -> Iterator[FeedSpec]:
        return (self.spec.model_copy(update={"seed": seed, **changes}) for seed in seeds)


# Axis -> step -> what differs from the standard scene.
_AXES: dict[str, dict[str, dict[str, object]]] = {
    "standard": {"": {}},
    "size": {
        f"{size:.2f}": {"smallest_lump": size, "largest_lump": size}
        for size in (2.0, 1.5, 1.2, 1.1, 1.0, 0.85, 0.7)
    },
    "near-limit": {f"{rate:g}": {"near_limit_rocks_per_minute": rate} for rate in (4.0, 12.0)},
    "contrast": {f"{share:.2f}": {"lump_contrast": share} for share in (0.7, 0.5, 0.3, 0.15)},
    "kind": {kind: {f"{kind}_share": 1.0} for kind in ("smooth", "slab", "frozen", "buried")},
    "company": {
        "cluster": {"cluster_share": 1.0},
        "touching": {"touching_share": 0.6},
        "roll": {"roll_share": 1.0},
    },
    "dust": {
        "0": {"dust": 0.0},
        "0.7": {"dust": 0.7},
        "1": {"dust": 1.0},
        "bursts": {"dust_burst": 2.0, "dust_burst_every_s": 12.0},
        "heavy": {"dust": 1.0, "dust_burst": 2.5, "dust_burst_every_s": 6.0},
    },
    "night": {f"{share:g}": {"night": share} for share in (0.4, 0.7, 1.0)},
    "rain": {
        "light": {"rain": 0.3, "lens_drops": 4},
        "heavy": {"rain": 0.7, "lens_drops": 10},
        "storm": {"rain": 1.0, "lens_drops": 25, "shake_px": 2.0},
    },
    "snow": {f"{share:g}": {"snow": share} for share in (0.4, 1.0)},
    "steam": {f"{share:g}": {"steam": share} for share in (0.3, 0.7)},
    "exposure": {
        f"{factor:g}": {"exposure_jump": factor, "exposure_every_s": 8.0} for factor in (1.5, 2.5, 4.0)
    },
    "light": {
        "drift": {"light_drift": 0.4},
        "shadow": {"shadow_edges": 0.6, "shadow_every_s": 8.0},
        "sun": {"sun_patches": 1.0},
    },
    "shake": {f"{shake:g}": {"shake_px": shake} for shake in (2.0, 5.0, 10.0)},
    "knock": {
        "small": {"camera_shift_x_px": 6.0, "camera_shift_y_px": -4.0, "camera_shift_at_s": 20.0},
        "large": {"camera_shift_x_px": 24.0, "camera_shift_y_px": 12.0, "camera_shift_at_s": 20.0},
    },
    "belt": {
        "stops": {"stop_every_s": 12.0, "stop_duration_s": 4.0},
        "speed": {"speed_change": 0.5},
        "both": {"speed_change": 0.5, "stop_every_s": 12.0},
    },
    "fps": {f"{fps:g}": {"fps": fps} for fps in (30.0, 10.0, 5.0)},
    "h264": {f"{crf}": {"h264_crf": crf} for crf in (30, 36, 42)},
    "mixed": {
        "bad-day": {
            "dust": 0.6, "lump_contrast": 0.6, "shake_px": 2.0, "h264_crf": 34, "exposure_jump": 1.5,
            "near_limit_rocks_per_minute": 6.0, "frozen_share": 0.3, "slab_share": 0.2, "buried_share": 0.2,
        },
        "bad-night": {
            "night": 0.6, "rain": 0.4, "lens_drops": 5, "h264_crf": 36, "fps": 10.0, "stop_every_s": 15.0,
            "near_limit_rocks_per_minute": 6.0, "frozen_share": 0.5,
        },
    },
}  # fmt: skip

# What is shown in the other style too.
_ALSO_B = (
    ("standard", ""), ("size", "1.00"), ("contrast", "0.50"), ("kind", "frozen"), ("kind", "buried"),
    ("company", "cluster"), ("dust", "1"), ("night", "0.7"), ("exposure", "2.5"), ("light", "shadow"),
    ("shake", "5"), ("h264", "36"), ("mixed", "bad-day"),
)  # fmt: skip


def scenes() -> Iterator[Scene]:
    """All scenes, the standard one first, those of style b last."""
    for axis, steps in _AXES.items():
        for step, changes in steps.items():
            yield _scene(axis, step, changes)
    for axis, step in _ALSO_B:
        yield _scene(axis, step, {**_AXES[axis][step], "style": "b"})


def scene(name: str) -> Scene:
    """The scene of that name. Raises KeyError."""
    return {one.name: one for one in scenes()}[name]


def _scene(axis: str, step: str, changes: dict[str, object]) -> Scene:
    name = "-".join(part for part in ("b" if changes.get("style") == "b" else "", axis, step) if part)
    given = {**STANDARD.model_dump(exclude_unset=True), **changes}
    return Scene(name, axis, FeedSpec.model_validate(given))
