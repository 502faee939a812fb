"""What the ring holds, when clips begin and end, and that memory is bounded."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.service.config.evidence import EvidenceConfig
from lumpwatch.service.core.alarm import AlarmClass
from tests.evidence.scene import BEGAN_S, Scene, moving
from tests.service_helpers import camera, frame, prior


def dark(k: int) -> np.ndarray:
    return moving(k, visible=False)


def scene(**config: object) -> Scene:
    return Scene(camera(), {"apron": prior()}, EvidenceConfig.model_validate(config))


def test_the_ring_holds_the_pre_roll_and_at_most_a_second_more() -> None:
    one = scene(pre_roll_s=3.0)
    for _ in range(80):
        one.show(0.1, dark)
        held = one.recorder.ring_frames
        assert held == one.index or 30 <= held <= 42
        assert one.counting.pre_roll_s >= min(3.0, (one.index - 1) * 0.1) - 0.02


def test_a_clip_has_its_pre_roll_and_its_post_roll() -> None:
    one = scene(pre_roll_s=2.0, post_roll_s=1.0)
    one.show(5.0, dark)
    now = one.live[-1].frame.received_s + 0.01  # type: ignore[union-attr]
    assert one.begin("apron", AlarmClass.LUMP, now)
    one.show(3.0, dark)
    (clip,) = one.clips
    times = [kept.frame.capture_s for kept in clip.kept]
    assert clip.ended == "post_roll"
    assert times[clip.decisive] == pytest.approx(BEGAN_S + 4.9, abs=0.01)
    assert 2.0 <= times[clip.decisive] - times[0] <= 3.1
    assert times[-1] - times[clip.decisive] == pytest.approx(1.0, abs=0.11)
    # Frames are kept by reference: the ring costs no copy.
    assert clip.kept[3].frame is one.live[clip.kept[3].frame.seq].frame


@pytest.mark.parametrize("more_s", [0.0, 0.1, 0.2, 0.3])
def test_a_clip_begins_with_a_frame_that_was_decided_on(more_s: float) -> None:
    """Between such frames stands what was decided before, which the state of the filters does not hold."""
    config = camera()
    rois = tuple(roi.model_copy(update={"decide_hz": 4.0}) for roi in config.rois)
    paced = config.model_copy(update={"rois": rois})
    one = Scene(
        paced, {"apron": prior()}, EvidenceConfig.model_validate({"pre_roll_s": 2.0, "post_roll_s": 1.0})
    )
    one.show(5.0 + more_s, dark)
    assert one.begin("apron", AlarmClass.LUMP, one.live[-1].frame.received_s + 0.01)  # type: ignore[union-attr]
    one.show(3.0, dark)
    (clip,) = one.clips
    assert not all(kept.results[0].decided for kept in clip.kept)
    assert clip.kept[0].results[0].decided


def test_alarms_that_follow_each_other_get_a_clip_each() -> None:
    one = scene(pre_roll_s=1.0, post_roll_s=2.0)
    one.show(2.0, dark)
    for _ in range(3):
        one.begin("apron", AlarmClass.LUMP, one.live[-1].frame.received_s)  # type: ignore[union-attr]
        one.show(0.5, dark)
    one.show(3.0, dark)
    assert [clip.trigger.sequence for clip in one.clips] == [1, 2, 3]
    assert all(len(clip.kept) >= 30 for clip in one.clips)


def test_a_clip_ends_though_no_frames_come() -> None:
    one = scene(post_roll_s=1.0)
    one.show(1.0, dark)
    now = one.live[-1].frame.received_s  # type: ignore[union-attr]
    one.begin("apron", AlarmClass.LUMP, now)
    one.recorder.tick(now + 0.9)
    assert not one.clips
    one.recorder.tick(now + 1.0)
    assert one.clips[0].ended == "post_roll"
    assert one.clips[0].decisive == len(one.clips[0].kept) - 1


def test_a_new_prior_or_picture_ends_clips_and_begins_the_ring_anew() -> None:
    one = scene(pre_roll_s=5.0)
    one.show(2.0, dark)
    one.begin("apron", AlarmClass.LUMP, one.live[-1].frame.received_s)  # type: ignore[union-attr]
    one.pipeline.use_prior("apron", prior(version=9))
    one.recorder.restart()
    assert (one.clips[0].ended, len(one.clips[0].kept)) == ("changed", 20)
    one.show(1.0, dark)
    one.begin("apron", AlarmClass.LUMP, one.live[-1].frame.received_s)  # type: ignore[union-attr]
    k = one.index
    one.feed(frame(k, time_s=BEGAN_S + k * 0.1, data=np.zeros((128, 192), np.uint8), size=(192, 128)))
    assert (one.clips[1].ended, one.clips[1].kept[0].frame.seq, len(one.clips[1].kept)) == ("changed", 20, 10)
    assert one.clips[1].start.prior is not None
    assert one.clips[1].start.prior.version == 9


@pytest.mark.parametrize(
    ("classes", "enabled", "kept"),
    [
        (["lump"], True, {"lump"}),
        (["lump", "blind"], True, {"lump", "blind"}),
        ([], True, set()),
        (["lump"], False, set()),
    ],
)
def test_only_what_is_configured_is_recorded(classes: list[str], enabled: bool, kept: set[str]) -> None:
    one = scene(classes=classes, enabled=enabled)
    one.show(1.0, dark)
    for alarm_class in AlarmClass:
        assert one.begin("apron", alarm_class, 1001.0) == (alarm_class.value in kept)


def test_without_a_frame_there_is_no_evidence() -> None:
    assert not scene().begin("apron", AlarmClass.LUMP, 1000.0)


# Memory

SIZE = (624, 416)
BIG = 624 * 416


def big(k: int) -> np.ndarray:
    return np.full((416, 624), 20 + k % 3, np.uint8)


def test_a_ring_that_may_hold_little_holds_the_newest() -> None:
    one = scene(pre_roll_s=60.0, memory_mb=6)  # 24 pictures, a second has 10
    for _ in range(60):
        one.show(0.1, big, size=SIZE)
        assert one.recorder.ring_size == one.recorder.ring_frames * BIG <= 6 * 1024 * 1024
    assert 1.0 <= one.counting.pre_roll_s <= 2.4
    assert one.begin("apron", AlarmClass.LUMP, one.live[-1].frame.received_s)  # type: ignore[union-attr]


def test_clips_take_twice_the_ring_at_most() -> None:
    one = scene(pre_roll_s=60.0, post_roll_s=60.0, memory_mb=6)
    one.show(6.0, big, size=SIZE)
    assert one.begin("apron", AlarmClass.LUMP, 1006.0)
    assert one.begin("apron", AlarmClass.LUMP, 1006.0)
    assert not one.begin("apron", AlarmClass.LUMP, 1006.0)  # a third does not fit
    assert one.counting.problems == {"memory": 1}
    while not one.clips:
        one.show(0.1, big, size=SIZE)
        assert one.recorder.clips_size <= 12 << 20
    assert one.counting.problems == {"memory": 2}
    (cut,) = one.clips
    assert cut.ended == "memory"
    assert len(cut.kept) * BIG <= 12 * 1024 * 1024


def test_clips_that_wait_for_a_slow_disk_count_too() -> None:
    one = scene(memory_mb=6)
    one.show(2.0, big, size=SIZE)
    one.waiting = 12 * 1024 * 1024
    assert not one.begin("apron", AlarmClass.LUMP, 1002.0)
    assert one.counting.problems == {"memory": 1}
    one.waiting = 0
    assert one.begin("apron", AlarmClass.LUMP, 1002.0)


def test_a_picture_that_is_larger_than_the_memory_leaves_the_ring_empty() -> None:
    one = scene(memory_mb=1)
    one.show(1.0, lambda k: np.full((1000, 1500), k, np.uint8), size=(1500, 1000))
    assert one.recorder.ring_frames == 0
    assert one.counting.pre_roll_s == 0.0
    assert not one.begin("apron", AlarmClass.LUMP, 1001.0)
