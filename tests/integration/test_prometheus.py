"""A real Prometheus with the rules and dashboards of `deploy/`, scraping a real daemon."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
from pathlib import Path

import pytest

from deploy.grafana.make_dashboards import DASHBOARDS, FLEET, HERE, dashboard, text
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec
from tests.integration.conftest import PRIOR
from tests.integration.site import Daemon, wait_for
from tests.reproduction.difficulty.peers import calibration
from tests.servers.process import RtspServer
from tests.servers.prometheus import ALERTMANAGER, alertmanager, prometheus

STOPPED = 'rate(lumpwatch_frames_processed_total{camera="crusher-2"}[30s]) == 0'
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


def test_the_dashboards_are_those_that_the_program_makes() -> None:
    assert {file.stem for file in HERE.glob("*.json")} == set(DASHBOARDS)
    for name in DASHBOARDS:
        assert (HERE / f"{name}.json").read_text() == text(name)


@pytest.mark.parametrize("name", DASHBOARDS)
def test_panels_say_what_they_show(name: str) -> None:
    panels = dashboard(name)["panels"]
    places: set[tuple[int, int]] = set()
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
        for target in panel["targets"]:
            assert target["instant"] is not target["range"]
            if re.search("topk|sort", target["expr"]) and panel["type"] != "timeseries":
                assert target["instant"], "over a range these mean something else"


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
        region = ("--camera", "crusher-1", "--roi", "apron")
        imported = daemon.command("priors", "import", str(daemon.config), str(PRIOR), *region)
        assert imported.returncode == 0, imported.stderr
        stack.enter_context(daemon)
        manager = stack.enter_context(alertmanager(tmp_path)) if ALERTMANAGER else None
        target = {"targets": [f"127.0.0.1:{daemon.port}"], "labels": {"site": "test"}}
        asked = stack.enter_context(prometheus(tmp_path, [target], manager.url if manager else None))
        wait_for("ready", lambda: daemon.ready, 120)

        def all_answered() -> bool:
            queries.difference_update({one for one in queries if asked.query(one)})
            return not queries

        failures = {one for one in queries if "source_failures" in one}  # none has happened yet
        queries -= failures
        queries -= {one for one in queries if "proof_test_warning" in one}  # nor a proof test
        with contextlib.suppress(AssertionError):
            wait_for("data in every panel", all_answered, 60)
        assert queries == set()
        assert not {one for one in asked.firing() if one[0] in ("LumpwatchBlind", "LumpwatchSilent")}
        server.kill()
        wait_for("failures", lambda: all(asked.query(one) for one in failures), 60)
        wait_for("page", lambda: ("LumpwatchBlind", "crusher-2") in asked.firing(), 60)
        assert ("LumpwatchBlind", "crusher-1") not in asked.firing()
        # One row a region on the fleet's page, whichever of the two speaks.
        (rows,) = (one for panel in FLEET if panel.kind == "state-timeline" for one, _ in panel.queries)
        rows = rows.replace("$site", ".*")
        row = {one["metric"]["camera"]: float(one["value"][1]) for one in asked.query(rows)}
        assert len(asked.query(rows)) == 2
        assert row["crusher-2"] == 2.0
        assert row["crusher-1"] in (0.0, 1.0)
        # It says that it is blind, and is not reported as dead on top.
        wait_for("no frame for half a minute", lambda: asked.query(STOPPED), 60)
        with contextlib.suppress(AssertionError):
            wait_for("a second page", lambda: ("LumpwatchSilent", "crusher-2") in asked.firing(), 20)
        assert ("LumpwatchSilent", "crusher-2") not in asked.firing()
        if manager is not None:
            wait_for("page", lambda: ("LumpwatchBlind", "crusher-2") in manager.told("pages"), 30)
