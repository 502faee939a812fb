"""`--json`: the facts a command prints, for another program; standard output holds them alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import lumpwatch.service.deployment
from lumpwatch.service.config import UserRole
from lumpwatch.service.console import UserFile
from lumpwatch.service.storage.event_log import Entry, EventLog, event_file
from lumpwatch.service.storage.prior_store import PriorStore
from tests.cli.test_cli import Captured, done
from tests.engine_fake import FakeEngine
from tests.servers.clips import write_clip
from tests.service_helpers import prior, site_tree
from tests.storage.test_event_log import event


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A configuration file of the small camera; its users are in a file."""
    path = tmp_path / "site.yaml"
    path.write_text(
        json.dumps({**site_tree(likelihood={"kind": "lump"}), "console": {"users": "users.json"}}),
        encoding="utf-8",
    )
    return path


class DeployEngine(FakeEngine):
    """An engine in memory that has every image under its own name."""

    def image(self, name: str, pull: bool = False) -> str:
        return name


def told(capsys: Captured, *arguments: object) -> Any:
    """What a command that succeeds prints with `--json`."""
    return json.loads(done(capsys, *arguments, "--json"))


def test_priors(capsys: Captured, config: Path, tmp_path: Path) -> None:
    assert told(capsys, "priors", "list", config) == []
    store = PriorStore(tmp_path / "var")
    for source in ("a.mp4", "b.mp4", "c.mp4"):
        store.save(prior(source=source))
    store.path("cam", "apron", 3).write_bytes(b"nonsense")
    store.use("cam", "apron", 2)
    first, second, third = told(capsys, "priors", "list", config)
    stored = store.load("cam", "apron", 2)
    assert second == {
        "version": 2,
        "created": stored.meta.created.isoformat(),
        "source": "b.mp4",
        "objects": stored.learned.tracks,
        "models": list(stored.learned.models),
        "state": "in use",
    }
    assert (first["version"], first["state"]) == (1, None)
    assert third["version"] == 3
    assert "is not a lumpwatch prior" in third["refused"]
    did = told(capsys, "priors", "rollback", config, "--version", 1)
    assert (did["in_use"], did["in_shadow"], did["said"]) == (1, None, ["cam/apron: version 1 is in use"])
    assert store.pointer("cam", "apron") == 1
    assert told(capsys, "priors", "shadow", config, "--version", 2)["in_shadow"] == 2
    assert told(capsys, "priors", "promote", config)["in_use"] == 2


def test_users(capsys: Captured, config: Path, tmp_path: Path) -> None:
    UserFile(tmp_path / "users.json").put("anna", "correct horse", UserRole.named("operator"))
    assert told(capsys, "users", "list", config) == [{"name": "anna", "role": "operator"}]
    assert told(capsys, "users", "role", config, "anna", "--role", "viewer") == [
        {"name": "anna", "role": "viewer"}
    ]
    assert told(capsys, "users", "remove", config, "anna") == []


def test_events_are_one_a_line(capsys: Captured, config: Path, tmp_path: Path) -> None:
    log = EventLog(event_file(tmp_path / "var", "cam"))
    log.append([Entry(event(k), b"") for k in (1, 2)])
    log.close()
    lines = done(capsys, "events", config, "--json")
    assert [json.loads(line)["sequence"] for line in lines.splitlines()] == [1, 2]
    assert lines == done(capsys, "events", config, "--format", "jsonl")


def test_lens(capsys: Captured) -> None:
    edges = ("--edge", "80,40", "38,540", "80,1040", "--edge", "1840,40", "1882,540", "1840,1040")
    found = told(capsys, "lens", "1920x1080", *edges)
    assert found["off_px"] < found["off_before_px"]
    assert f"k1: {found['k1']:.4f}, k2: {found['k2']:.4f}" in done(capsys, "lens", "1920x1080", *edges)


def test_replay(capsys: Captured, config: Path, tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "clip.mp4", frames=12)
    summary = told(capsys, "replay", config, clip, "--out", tmp_path / "out")
    assert summary["frames"] == 12
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())


def test_reference(capsys: Captured, config: Path, tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "clip.mp4", frames=60)
    found = told(capsys, "reference", config, clip)
    assert (found["camera"], found["version"]) == ("cam", 1)
    assert found["warnings"]  # a clip of two seconds shows little
    assert set(found["lights"]) == {"day"}
    for threshold in found["lights"]["day"]["apron"].values():
        assert len(threshold.keys() & {"above", "below"}) == 1
        assert isinstance(threshold["usual"], float)
    again = told(capsys, "reference", config, "--use", 1)
    assert (again["version"], again["lights"]) == (1, found["lights"])


def test_init(capsys: Captured, tmp_path: Path) -> None:
    file = tmp_path / "new.yaml"
    written = told(capsys, "init", file, "--defaults", "--site", "pit")
    assert written == {
        "file": str(file), "site": "pit", "camera": "crusher-1", "source": "sim:feed", "roi": "apron",
        "limit_mm": None,
    }  # fmt: skip


def test_deploy(capsys: Captured, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = DeployEngine()
    monkeypatch.setattr(lumpwatch.service.deployment, "connect", lambda socket: engine)
    tree = site_tree()
    tree["cameras"][0]["source"]["url"] = "sim:feed"
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(tree), encoding="utf-8")
    planned = told(capsys, "deploy", "plan", config, "--image", "good")
    assert (planned["action"], planned["reasons"]) == ("create", ["no container of this site exists"])
    assert not engine.containers
    rolled_out = told(capsys, "deploy", "up", config, "--image", "good")
    assert (rolled_out["name"], rolled_out["ready"]) == (planned["name"], True)
    looked = told(capsys, "deploy", "status", config)
    assert (looked["ready"], looked["problems"]) == (True, [])
    assert [(one["name"], one["state"]) for one in looked["containers"]] == [(planned["name"], "running")]
    told(capsys, "deploy", "up", config, "--image", "good-2")
    back = told(capsys, "deploy", "rollback", config)
    assert [one["image"] for one in back["containers"]] == ["good", "good-2"]
