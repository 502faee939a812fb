"""A real Prometheus with the rules and dashboards of `deploy/`, scraping a real daemon."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from deploy.grafana.make_dashboards import DASHBOARDS, HERE, dashboard, text
from service.feed.simulator import FeedSimulator
from service.feed.spec import FeedSpec
from tests.integration.conftest import PRIOR
from tests.integration.site import Daemon, free_port, wait_for
from tests.reproduction.difficulty.peers import calibration
from tests.servers.process import RtspServer

PROMETHEUS = Path(__file__).parents[2] / "deploy" / "prometheus"

CAMERAS = """\
  - id: crusher-1
    source: {{url: "sim:feed?lumps_per_minute=20&seed=5"}}
    rois:
      - id: apron
        polygon: {place}
        calibration: {calibration}
  - id: crusher-2
    source: {{url: "{url}", read_timeout_s: 1.0, open_timeout_s: 2.0, backoff: {{initial_s: 0.2, max_s: 1.0}}}}
    blind_after_s: 1.0
    rois:
      - id: apron
        polygon: {polygon}
        detector: {{working_size_px: 160}}
"""


class Prometheus:
    """Asks a running server."""

    def __init__(self, port: int) -> None:
        self._url = f"http://127.0.0.1:{port}/api/v1"

    def query(self, expression: str) -> list[dict[str, Any]]:
        text = urllib.parse.urlencode({"query": expression})
        with urllib.request.urlopen(f"{self._url}/query?{text}", timeout=10) as answer:
            found: list[dict[str, Any]] = json.load(answer)["data"]["result"]
            return found

    def firing(self) -> set[tuple[str, str]]:
        with urllib.request.urlopen(f"{self._url}/alerts", timeout=10) as answer:
            return {
                (one["labels"]["alertname"], one["labels"].get("camera", ""))
                for one in json.load(answer)["data"]["alerts"]
                if one["state"] == "firing"
            }


@contextmanager
def prometheus(folder: Path, target: int) -> Iterator[Prometheus]:
    """Prometheus with the configuration of `deploy/`, in a hurry: every period is two seconds."""
    config = YAML(typ="safe").load(PROMETHEUS / "prometheus.yml")
    config["global"] = {"scrape_interval": "2s", "evaluation_interval": "2s"}
    config["alerting"] = {}
    shutil.copytree(PROMETHEUS / "rules", folder / "rules")
    (folder / "targets").mkdir()
    (folder / "targets" / "site.yml").write_text(
        json.dumps([{"targets": [f"127.0.0.1:{target}"], "labels": {"site": "test"}}])
    )
    (folder / "prometheus.yml").write_text(json.dumps(config))
    port = free_port()
    with (folder / "prometheus.log").open("wb") as log:
        process = subprocess.Popen(
            [
                "prometheus",
                f"--config.file={folder}/prometheus.yml",
                f"--storage.tsdb.path={folder}/data",
                f"--web.listen-address=127.0.0.1:{port}",
            ],
            stdout=log,
            stderr=log,
        )
    try:
        yield Prometheus(port)
    finally:
        process.terminate()
        process.wait(timeout=20)


def test_the_dashboards_are_those_that_the_program_makes() -> None:
    assert {file.stem for file in HERE.glob("*.json")} == set(DASHBOARDS)
    for name in DASHBOARDS:
        assert (HERE / f"{name}.json").read_text() == text(name)


@pytest.mark.parametrize("name", DASHBOARDS)
def test_panels_say_what_they_show(name: str) -> None:
    panels = dashboard(name)["panels"]
    places = set()
    for panel in panels:
        assert panel["title"]
        assert panel["description"].endswith(".")
        assert panel["fieldConfig"]["defaults"]["unit"]
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert not cells & places, f"{panel['title']} lies on another panel"
        assert max(x for x, _ in cells) < 24
        places |= cells


@pytest.mark.slow
@pytest.mark.system
@pytest.mark.skipif(shutil.which("prometheus") is None, reason="Debian package prometheus is not installed")
def test_every_panel_has_data_and_a_dead_camera_is_paged(
    tmp_path: Path, feed_clip: Path, polygon: str
) -> None:
    queries = {
        target["expr"].replace("$site", ".*").replace("$camera", ".*")
        for name in DASHBOARDS
        for panel in dashboard(name)["panels"]
        for target in panel["targets"]
    }
    with RtspServer(feed_clip) as server, contextlib.ExitStack() as stack:
        cameras = CAMERAS.format(
            url=server.url,
            polygon=polygon,
            place=[[float(v) for v in point] for point in FeedSimulator(FeedSpec()).polygon],
            calibration=json.dumps(calibration(FeedSpec())),
        )
        daemon = Daemon(tmp_path, cameras)
        # Without a prior no speed is sure enough to tell the seconds to the lip.
        target = ("--camera", "crusher-1", "--roi", "apron")
        imported = daemon.command("priors", "import", str(daemon.config), str(PRIOR), *target)
        assert imported.returncode == 0, imported.stderr
        stack.enter_context(daemon)
        asked = stack.enter_context(prometheus(tmp_path, daemon.port))
        wait_for("ready", lambda: daemon.ready, 120)

        def all_answered() -> bool:
            queries.difference_update({one for one in queries if asked.query(one)})
            return not queries

        failures = {one for one in queries if "source_failures" in one}  # none has happened yet
        queries -= failures
        with contextlib.suppress(AssertionError):
            wait_for("data in every panel", all_answered, 60)
        assert queries == set()
        assert not {one for one in asked.firing() if one[0] in ("LumpwatchBlind", "LumpwatchSilent")}
        server.kill()
        wait_for("failures", lambda: all(asked.query(one) for one in failures), 60)
        wait_for("page", lambda: ("LumpwatchBlind", "crusher-2") in asked.firing(), 60)
        assert ("LumpwatchBlind", "crusher-1") not in asked.firing()
