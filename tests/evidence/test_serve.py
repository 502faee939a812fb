"""Evidence over the bus in pieces; the bus itself is a fake here, and real in tests/integration."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.bus.endpoints import Reply
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence.files import write_files
from lumpwatch.service.evidence.folder import EvidenceError
from lumpwatch.service.evidence.serve import PIECE, fetch_evidence, serve_evidence
from lumpwatch.service.evidence.store import EvidenceStore
from lumpwatch.service.protocol import EvidenceRequest, read_request
from tests.evidence.scene import Scene, moving
from tests.service_helpers import camera, prior

KEY = "lumpwatch/v1/pit/cam/apron/evidence"


class FakeBus:
    """Asks the handler directly."""

    def __init__(
        self, do: Callable[[EvidenceRequest], bytes], change: Callable[[bytes], bytes] = lambda answer: answer
    ) -> None:
        self.do = do
        self.change = change
        self.asked: list[dict[str, str]] = []

    def handler(self, parameters: dict[str, str]) -> bytes:
        return self.do(read_request(EvidenceRequest, parameters))

    def ask(self, key: str, parameters: dict[str, str], timeout_s: float) -> list[Reply]:
        self.asked.append(parameters)
        try:
            return [Reply(key, self.change(self.handler(parameters)))]
        except LumpwatchError as error:
            return [Reply(key, error=str(error))]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> EvidenceStore:
    one = camera()
    scene = Scene(one, {"apron": prior()})
    scene.show(2.0, lambda k: moving(k, visible=True))
    (clip,) = scene.clips
    made = EvidenceStore(tmp_path_factory.mktemp("store"))
    made.write("cam", "apron", clip.trigger.id, lambda folder: write_files(folder, clip, "pit", one, "1"))
    return made


def bus_of(store: EvidenceStore, piece: int = PIECE, **more: Any) -> FakeBus:
    verdicts = {("apron", name_of(store)): "true"}
    return FakeBus(serve_evidence(store, "cam", "apron", lambda: verdicts, piece), **more)


def name_of(store: EvidenceStore) -> str:
    return store.entries()[0].id


def test_evidence_comes_in_pieces_and_is_checked(store: EvidenceStore, tmp_path: Path) -> None:
    bus: Any = bus_of(store, piece=5000)
    got = fetch_evidence(bus, KEY, name_of(store), tmp_path)
    got.check()
    assert got.folder == tmp_path / f"cam.apron.{name_of(store)}"
    original = store.entries()[0].folder
    for path in original.iterdir():
        if path.name != "meta.json":
            assert (got.folder / path.name).read_bytes() == path.read_bytes()
    assert sum("offset" in one for one in bus.asked) == sum(
        -(-told.size // 5000) for told in got.meta.files.values()
    )
    assert [path.name for path in tmp_path.iterdir()] == [got.folder.name]


def test_the_list_carries_the_verdict(store: EvidenceStore) -> None:
    bus = bus_of(store)
    (one,) = json.loads(bus.handler({}))
    assert (one["id"], one["verdict"], one["class"]) == (name_of(store), "true", "lump")
    assert json.loads(bus.handler({"newest": "0"})) == []
    assert json.loads(bus.handler({"id": name_of(store)})) == one


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"id": "../../../etc"}, "is not the id of evidence"),
        ({"id": "000000000000001-000001"}, "cannot be read"),
        ({"file": "../meta.json"}, "is none of"),
        ({"file": "/etc/passwd"}, "is none of"),
        ({"file": "clip.mkv", "offset": "-1"}, "offset: "),
        ({"file": "clip.mkv", "length": "all"}, "length: "),
    ],
)
def test_what_is_asked_wrongly_is_told_so(
    store: EvidenceStore, parameters: dict[str, str], told: str
) -> None:
    with pytest.raises(LumpwatchError) as caught:
        bus_of(store).handler({"id": name_of(store)} | parameters)
    assert told in str(caught.value)


def test_no_answer_is_longer_than_a_piece(store: EvidenceStore) -> None:
    bus = bus_of(store, piece=100)
    asked = {"id": name_of(store), "file": "clip.mkv", "length": "1000000"}
    assert len(bus.handler(asked)) == 100
    assert bus.handler(asked | {"offset": "999999999"}) == b""


def test_bytes_that_changed_on_the_way_are_no_evidence(store: EvidenceStore, tmp_path: Path) -> None:
    def flip(answer: bytes) -> bytes:
        return answer if answer[:1] in b"{[" else answer[:-1] + bytes([answer[-1] ^ 1])

    bus: Any = bus_of(store, change=flip)
    with pytest.raises(EvidenceError, match="checksum"):
        fetch_evidence(bus, KEY, name_of(store), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_foreign_answer_writes_nothing_elsewhere(store: EvidenceStore, tmp_path: Path) -> None:
    def named(answer: bytes) -> bytes:
        told = json.loads(answer)
        told["files"] = {"../../escaped": {"size": 1, "sha256": "00"}}
        return json.dumps(told).encode()

    bus: Any = bus_of(store, change=named)
    with pytest.raises(EvidenceError, match="no file of evidence"):
        fetch_evidence(bus, KEY, name_of(store), tmp_path / "a" / "b")
    bus = bus_of(store, change=lambda _: b"nonsense")
    with pytest.raises(EvidenceError, match="no evidence"):
        fetch_evidence(bus, KEY, name_of(store), tmp_path / "a" / "b")
    assert not (tmp_path / "escaped").exists()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"camera": "../../escaped"}, "of other evidence"),
        ({"roi": "x/../../.."}, "of other evidence"),
        ({"id": "../../../escaped"}, "of other evidence"),
        ({"files": {"clip.mkv": {"size": 1 << 50, "sha256": "00"}}}, "no evidence takes"),
        ({"files": {"clip.mkv": {"size": -5, "sha256": "00"}}}, "no evidence takes"),
        ({"files": {"authorized_keys": {"size": 1, "sha256": "00"}}}, "no file of evidence"),
    ],
)
def test_a_forged_answer_names_no_place_of_its_own(
    store: EvidenceStore, tmp_path: Path, changed: dict[str, Any], told: str
) -> None:
    bus: Any = bus_of(store, change=lambda answer: json.dumps(json.loads(answer) | changed).encode())
    out = tmp_path / "a" / "b"
    with pytest.raises(EvidenceError, match=told):
        fetch_evidence(bus, KEY, name_of(store), out)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_piece_longer_than_its_file_is_refused(store: EvidenceStore, tmp_path: Path) -> None:
    def longer(answer: bytes) -> bytes:
        return answer if answer[:1] == b"{" else answer + bytes(1000)

    bus: Any = bus_of(store, change=longer)
    with pytest.raises(EvidenceError, match="does not end as it should"):
        fetch_evidence(bus, KEY, name_of(store), tmp_path)
