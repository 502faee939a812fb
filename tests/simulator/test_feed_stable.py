"""Specs that name none of the later options show what they always showed."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec

# Query, frame, every 2400th pixel value (7200th in colour), and the lumps: id, x, y, w, h, size, visibility,
# seconds to the lip.
KEPT: list[tuple[str, int, list[int], list[float]]] = [
    (
        "",
        0,
        [
            54,
            34,
            57,
            87,
            55,
            91,
            41,
            104,
            41,
            39,
            44,
            94,
            49,
            89,
            42,
            128,
            34,
            86,
            48,
            96,
            50,
            96,
            38,
            105,
            43,
            72,
            21,
            79,
            13,
            16,
            12,
            64,
        ],
        [],
    ),
    (
        "",
        25,
        [
            61,
            43,
            60,
            43,
            62,
            89,
            48,
            90,
            46,
            95,
            47,
            97,
            50,
            62,
            50,
            94,
            43,
            114,
            48,
            74,
            45,
            57,
            27,
            104,
            38,
            102,
            23,
            63,
            14,
            20,
            7,
            58,
        ],
        [1, 114.82, 0.0, 58.52, 28.77, 1192.79, 0.62, 8.29],
    ),
    (
        "seed=7&gray=false&fps=30",
        40,
        [
            83,
            92,
            75,
            75,
            81,
            95,
            71,
            67,
            79,
            87,
            77,
            79,
            72,
            89,
            75,
            114,
            81,
            76,
            89,
            79,
            91,
            77,
            85,
            108,
            84,
            52,
            79,
            80,
            65,
            59,
            46,
            79,
        ],
        [],
    ),
    (
        "seed=3&stop_every_s=6&fps=5&shake_px=6&dust=0.8&lumps_per_minute=20",
        31,
        [
            47,
            167,
            60,
            114,
            53,
            48,
            58,
            145,
            42,
            213,
            55,
            114,
            62,
            90,
            81,
            109,
            69,
            101,
            75,
            123,
            68,
            133,
            73,
            145,
            77,
            110,
            74,
            93,
            74,
            73,
            57,
            101,
        ],
        [1, 160.7, 9.77, 46.73, 35.24, 788.78, 1.0, 6.45],
    ),
    (
        "seed=2&dust=0&noise=0&light_step=0.5&light_step_at_s=2&fps=4&smallest_lump=0.8&largest_lump=1.1&lumps_per_minute=40",
        50,
        [
            31,
            45,
            24,
            35,
            25,
            70,
            24,
            95,
            24,
            20,
            21,
            65,
            22,
            42,
            25,
            80,
            24,
            54,
            20,
            29,
            22,
            61,
            16,
            51,
            21,
            62,
            11,
            13,
            7,
            3,
            4,
            38,
        ],
        [
            7,
            122.66,
            0.0,
            34.41,
            20.63,
            653.55,
            0.83,
            8.55,
            6,
            161.63,
            10.3,
            31.51,
            28.47,
            572.49,
            1.0,
            6.96,
            5,
            153.88,
            23.45,
            39.02,
            31.82,
            626.95,
            1.0,
            5.75,
            4,
            154.07,
            43.55,
            34.93,
            31.4,
            532.78,
            1.0,
            4.47,
            3,
            187.19,
            122.89,
            46.33,
            38.6,
            519.28,
            1.0,
            0.71,
            2,
            195.12,
            199.25,
            51.67,
            28.91,
            528.23,
            0.9,
            -0.31,
        ],
    ),
]


@pytest.mark.parametrize(("query", "frame", "pixels", "lumps"), KEPT)
def test_a_feed_stays_what_it_was(query: str, frame: int, pixels: list[int], lumps: list[float]) -> None:
    simulator = FeedSimulator(FeedSpec.from_query(query, width=320, height=240))
    simulator.skip(frame)
    picture, truths = simulator.render()
    shown = picture.ravel()[:: picture.size // 32][:32].astype(int)
    # A grey level or two of room for processors that round in another order; another noise differs by more.
    assert np.abs(shown - pixels).max() <= 2
    found = [
        value
        for t in truths
        for value in (t.id, t.x, t.y, t.w, t.h, t.size_mm, t.visibility, t.seconds_to_lip)
    ]
    assert found == pytest.approx(lumps, abs=0.011)


def test_every_option_of_difficulty_is_off_by_default() -> None:
    neutral = {
        "style": "a", "h264_crf": None, "speed_change": 0, "near_limit_rocks_per_minute": 0,
        "lump_contrast": 1, "frozen_share": 0, "smooth_share": 0, "slab_share": 0, "buried_share": 0,
        "touching_share": 0, "cluster_share": 0, "roll_share": 0, "dust_burst": 0, "steam": 0, "rain": 0,
        "snow": 0, "lens_drops": 0, "night": 0, "sun_patches": 0, "shadow_edges": 0, "exposure_jump": 1,
        "camera_shift_at_s": None,
    }  # fmt: skip
    assert {key: getattr(FeedSpec(), key) for key in neutral} == neutral


def test_options_do_not_shift_what_else_is_drawn() -> None:
    """Weather and camera leave the traffic alone; each has a generator of its own."""
    plain = FeedSpec.from_query("width=320&height=240&lumps_per_minute=20&shake_px=0&fps=2")
    rough = {"night": 1.0, "rain": 1.0, "snow": 1.0, "lens_drops": 5, "dust_burst": 2.0, "exposure_jump": 3.0}
    one = FeedSimulator(plain)
    other = FeedSimulator(FeedSpec.model_validate({**plain.model_dump(), **rough, "shadow_edges": 0.5}))
    for _ in range(20):
        (picture, found), (changed, found_too) = one.render(), other.render()
        assert found == found_too
        assert picture.tobytes() != changed.tobytes()
    assert found
