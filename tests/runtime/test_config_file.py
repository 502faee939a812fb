from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lumpwatch.service.config import load_config
from lumpwatch.service.runtime import ConfigFile
from lumpwatch.service.runtime.config_file import changed_cameras
from tests.service_helpers import site, site_tree


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        self.now_s += 2.0
        return self.now_s


def two(**more: Any) -> dict[str, Any]:
    tree = site_tree()
    tree["cameras"] += [{**tree["cameras"][0], "id": "other"}]
    return tree | more


def test_a_file_that_changes_is_read_once_and_a_wrong_one_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(json.dumps(site_tree()))
    file = ConfigFile(path, Clock())
    assert file.changed() is None
    path.write_text(json.dumps(two()))
    assert file.changed() == load_config(path)
    assert file.changed() is None
    path.write_text("site: [")
    assert file.changed() is None
    path.unlink()
    assert file.changed() is None


def test_cameras_that_differ_are_named() -> None:
    tree = two()
    tree["cameras"][1]["blind_after_s"] = 9.0
    assert changed_cameras(site(two()), site(tree)) == ["other"]
    assert changed_cameras(site(two()), site(two())) == []
    assert changed_cameras(site(two()), site(site_tree())) == [], "cameras that go need a restart"


def test_only_the_changed_camera_starts_anew() -> None:
    from lumpwatch.service.runtime.daemon import DaemonHealth, _take_over, tasks_of
    from lumpwatch.service.runtime.supervisor import Supervisor
    from lumpwatch.service.telemetry import Relay

    before = site(two())
    tree = two()
    tree["cameras"][1]["blind_after_s"] = 9.0
    tasks = [task for camera in before.cameras for task in tasks_of(before, camera)]
    supervisor = Supervisor(tasks, Relay(), lambda *_: None)
    replaced: list[str] = []
    supervisor.replace = lambda task: replaced.append(task.name)  # type: ignore[method-assign]
    health = DaemonHealth(before, supervisor)
    after = _take_over(before, site(tree), before, supervisor, health, ("camera", "monitor"))
    assert replaced == ["monitor:other", "camera:other"]
    assert after.camera("other").blind_after_s == 9.0
