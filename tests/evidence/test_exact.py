"""A replay of evidence decides as the live pipeline did, to the byte."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.models.roi import make_roi
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core.alarm import AlarmClass
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.detectors.base import FilterState, StateMismatchError
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.sizing import SizeTrack
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.evidence.clip import ClipError, read_frames, read_pictures
from lumpwatch.service.evidence.folder import EvidenceError, read_evidence
from lumpwatch.service.evidence.state_file import StateError, decode_state, encode_state
from lumpwatch.service.offline.evidence_replay import replay_evidence
from lumpwatch.service.protocol.evidence import CAMERA, CLIP, META, PRIOR, STATE, STATES
from tests.evidence.scene import Scene, moving, written
from tests.service_helpers import HEIGHT, POLYGON, WIDTH, camera, learned, prior, same, site, site_tree

CALIBRATION = {
    "points": [[0.2, 0.2], [0.8, 0.2], [0.9, 0.9], [0.1, 0.9]],
    "points_mm": [[0, 0], [1500, 0], [1500, 3000], [0, 3000]],
    "lip": [[0.1, 0.9], [0.9, 0.9]],
    "limit_mm": 150,
}


def made(objects: int, **more: Any) -> CameraConfig:
    tree = site_tree(objects=objects)
    tree["cameras"][0]["rois"][0] |= more
    return site(tree).cameras[0]


def shown(scene: Scene, **more: Any) -> None:
    """Nothing for a while, then a lump, then nothing."""
    scene.show(4.0, lambda k: moving(k, visible=False), **more)
    scene.show(2.5, lambda k: moving(k, visible=True), **more)


def judged(lines: bytes) -> list[str]:
    """Without what the feed did: that follows from pictures before the first that is kept."""
    return [json.dumps(json.loads(line) | {"feed": None}) for line in lines.splitlines()]


@pytest.mark.parametrize("objects", [1, 3])
def test_a_replay_from_the_stored_state_gives_the_same_lines(tmp_path: Path, objects: int) -> None:
    one = made(objects, calibration=CALIBRATION)
    scene = Scene(one, {"apron": prior(version=4)})
    shown(scene)
    (clip,) = scene.clips
    evidence = written(clip, one, tmp_path / "e")
    assert evidence.meta.exact
    assert evidence.meta.prior == 4
    found = replay_evidence(evidence, tmp_path / "out")
    assert found.frames == found.same == evidence.meta.frames == len(clip.kept)
    lines = (tmp_path / "e" / STATES).read_bytes()
    assert judged((tmp_path / "out" / "states.jsonl").read_bytes()) == judged(lines)
    told = [json.loads(line) for line in lines.splitlines()]
    assert {line["state"] for line in told} == {"CLEAR", "LUMP"}
    assert told[evidence.meta.decisive - 1]["state"] == "LUMP"
    assert told[evidence.meta.decisive - 2]["state"] == "CLEAR"
    assert any(found["size"] for line in told for found in line["objects"])
    # The clip begins in the middle of the scene: without the stored state the filter would differ.
    assert clip.kept[0].frame.seq > 10


def test_what_was_judged_of_the_picture_is_replayed_too(tmp_path: Path) -> None:
    """A picture that freezes with the lump in it: frozen is found from seconds that the clip does not hold."""
    tree = site_tree()
    tree["cameras"][0]["quality"] = {
        name: {"enabled": False}
        for name in ("dark", "glare", "blurred", "dusty", "hidden", "moved", "exposure")
    } | {"frozen": {"entry_s": 0.1}, "window_s": 0.5}
    one = site(tree).cameras[0]
    scene = Scene(one, {"apron": prior()})
    scene.show(4.0, lambda k: moving(k, visible=False))
    scene.show(0.1, lambda k: moving(k, visible=True))
    scene.show(6.0, lambda k: moving(41, visible=True))
    evidence = written(scene.clips[0], one, tmp_path / "e")
    told = [json.loads(line)["state"] for line in (tmp_path / "e" / STATES).read_bytes().splitlines()]
    assert {"LUMP", "BLIND"} <= set(told)
    assert replay_evidence(evidence, tmp_path / "out").equal


def test_without_the_stored_state_the_decisions_differ(tmp_path: Path) -> None:
    """Else the test above could not fail."""
    one = made(1)
    scene = Scene(one, {"apron": prior()})
    shown(scene)
    fresh = replace(scene.clips[0], start=Snapshot(None, None, None, {}, {}, prior()))
    found = replay_evidence(written(fresh, one, tmp_path / "e"), tmp_path / "out")
    assert not found.equal


def test_evidence_of_the_first_seconds_begins_with_a_fresh_filter(tmp_path: Path) -> None:
    one = made(1)
    scene = Scene(one, {"apron": prior()})
    scene.show(2.0, lambda k: moving(k, visible=True))
    evidence = written(scene.clips[0], one, tmp_path / "e")
    assert evidence.meta.exact
    assert scene.clips[0].kept[0].frame.seq == 0
    assert replay_evidence(evidence, tmp_path / "out").equal


@pytest.mark.parametrize("encoding", ["i420", "bgr8", "cropped"])
def test_every_kind_of_frame_comes_back_to_the_byte(tmp_path: Path, encoding: str) -> None:
    one = made(1)

    def of(k: int) -> np.ndarray[Any, Any]:
        luma = moving(k, visible=k >= 30)
        if encoding == "i420":
            chroma = np.random.default_rng(k).integers(0, 255, (HEIGHT // 2, WIDTH)).astype(np.uint8)
            return np.vstack((luma, chroma))
        if encoding == "bgr8":
            return np.dstack((luma, luma, np.roll(luma, 1)))
        return luma[6:61, 9:87]  # odd sides

    scene = Scene(one, {"apron": prior()})
    if encoding == "cropped":
        for k in range(50):
            scene.feed(
                Frame(k, 5 + k / 10, 5 + k / 10, 0.0, WIDTH, HEIGHT, "gray8", of(k), crop=(9, 6, 78, 55))
            )
    else:
        scene.show(5.0, of, encoding=encoding)
    (clip,) = scene.clips
    evidence = written(clip, one, tmp_path / "e")
    frames = list(read_frames(evidence.folder / CLIP, evidence.folder / "frames.jsonl"))
    assert len(frames) == len(clip.kept) > 20
    for (frame, now_s, _), kept in zip(frames, clip.kept, strict=True):
        assert same(frame, kept.frame)
        assert now_s == kept.now_s
    assert replay_evidence(evidence, tmp_path / "out").equal


def test_a_tracker_says_that_its_replay_is_not_exact(tmp_path: Path) -> None:
    one = _jpda()
    scene = Scene(one)
    scene.show(5.0, lambda k: np.dstack([moving(k, visible=False)] * 3), encoding="bgr8")
    assert scene.begin("apron", AlarmClass.LUMP, scene.live[-1].frame.received_s)  # type: ignore[union-attr]
    scene.show(1.5, lambda k: np.dstack([moving(k, visible=False)] * 3), encoding="bgr8")
    evidence = written(scene.clips[0], one, tmp_path / "e")
    assert not evidence.meta.exact
    assert replay_evidence(evidence, tmp_path / "out").frames == evidence.meta.frames


def _jpda() -> CameraConfig:
    tree = site_tree()
    tree["cameras"][0]["rois"][0]["detector"] = {"kind": "jpda"}
    return site(tree).cameras[0]


def test_no_password_gets_into_evidence(tmp_path: Path) -> None:
    tree = site_tree()
    tree["cameras"][0]["source"] = {"url": "rtsp://user:pa55word@10.0.0.5/stream?token=s3cret"}
    one = site(tree).cameras[0]
    scene = Scene(one, {"apron": prior()})
    shown(scene)
    evidence = written(scene.clips[0], one, tmp_path / "e")
    for path in evidence.folder.iterdir():
        content = path.read_bytes()
        assert b"pa55word" not in content
        assert b"s3cret" not in content
    assert replay_evidence(evidence, tmp_path / "out").equal


# States


def test_a_state_is_the_same_after_a_file() -> None:
    scene = Scene(made(3, calibration=CALIBRATION), {"apron": prior()})
    scene.show(4.0, lambda k: moving(k, visible=k > 10))
    state = scene.pipeline.snapshots()["apron"]
    assert state.filter is not None
    assert state.filter.plain["tracks"]
    assert state.sizes
    again = decode_state(encode_state(state), "state.npz", state.prior)
    assert again.filter is not None
    assert again.filter.plain == state.filter.plain
    assert again.filter.arrays.keys() == state.filter.arrays.keys()
    for name, array in state.filter.arrays.items():
        assert same(again.filter.arrays[name], array), name
    assert replace(again, filter=None) == replace(state, filter=None)
    assert all(isinstance(one, SizeTrack) for one in again.sizes.values())


def test_a_state_that_was_taken_does_not_change_with_the_filter() -> None:
    scene = Scene(made(1), {"apron": prior()})
    scene.show(2.0, lambda k: moving(k, visible=True))
    state = scene.pipeline.snapshots()["apron"]
    before = encode_state(state)
    scene.show(1.0, lambda k: moving(k, visible=True))
    assert encode_state(state) == before


def test_a_state_of_another_filter_is_refused() -> None:
    roi = make_roi(POLYGON, WIDTH, HEIGHT, 64)
    one = make_detector(camera(objects=1).rois[0].detector, roi, learned())
    several = make_detector(camera(objects=2).rois[0].detector, roi, learned())
    fewer = make_detector(camera(objects=1, particles=100).rois[0].detector, roi, learned())
    state = one.state()
    assert state is not None
    for other, told in ((several, "expected 'several'"), (fewer, "210 particles, expected 70")):
        with pytest.raises(StateMismatchError, match=told):
            other.restore(state)
    with pytest.raises(StateMismatchError, match="random generator"):
        one.restore(FilterState({**state.plain, "random": {"bit_generator": "MT19937"}}, state.arrays))


# Damage


@pytest.fixture(scope="module")
def evidence_bytes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    one = made(1)
    scene = Scene(one, {"apron": prior()})
    shown(scene)
    evidence = written(scene.clips[0], one, tmp_path_factory.mktemp("made") / "e")
    return {path.name: path.read_bytes() for path in evidence.folder.iterdir()}


def put(folder: Path, files: dict[str, bytes]) -> Path:
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.mark.parametrize("name", [CLIP, STATE, STATES, CAMERA, PRIOR, "still.jpg", "frames.jsonl"])
def test_a_damaged_file_is_named(tmp_path: Path, evidence_bytes: dict[str, bytes], name: str) -> None:
    content = evidence_bytes[name]
    for damaged, told in (
        (content[: len(content) // 2], rf"is damaged \({len(content) // 2} bytes, expected {len(content)}\)"),
        (content[:-5] + bytes([content[-5] ^ 1]) + content[-4:], "its checksum does not match"),
    ):
        folder = put(tmp_path / str(len(damaged)), {**evidence_bytes, name: damaged})
        with pytest.raises(EvidenceError, match=f"{folder / name}: .*{told}"):
            replay_evidence(read_evidence(folder), tmp_path / "out")


def test_what_is_no_evidence_is_told_so(tmp_path: Path, evidence_bytes: dict[str, bytes]) -> None:
    with pytest.raises(EvidenceError, match=r"meta\.json: cannot be read"):
        read_evidence(tmp_path)
    folder = put(tmp_path / "e", {**evidence_bytes, META: b'{"version": 7}'})
    with pytest.raises(EvidenceError, match=r"meta\.json: is not "):
        read_evidence(folder)
    (folder / META).write_bytes(evidence_bytes[META])
    (folder / CLIP).unlink()
    with pytest.raises(EvidenceError, match=r"clip\.mkv: cannot be read"):
        replay_evidence(read_evidence(folder), tmp_path / "out")
    with pytest.raises(StateError, match=r"^x: .*filter state"):
        decode_state(b"nonsense", "x", None)
    (folder / CLIP).write_bytes(b"nonsense" * 100)
    with pytest.raises(ClipError, match=r"clip\.mkv: cannot be decoded"):
        list(read_pictures(folder / CLIP))
