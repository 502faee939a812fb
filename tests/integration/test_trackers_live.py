from __future__ import annotations

from pathlib import Path

import pytest

from tests import street
from tests.integration.site import AlarmFollower, Daemon, wait_for
from tests.servers.process import RtspServer

pytestmark = pytest.mark.slow

DETECTORS = {
    "imm_pf": "{kind: imm_pf, size_h: [0.08, 0.4]}",
    "jpda": "{kind: jpda, size_h: [0.08, 0.4], one_way: {direction: [1, 0]}}",
}


@pytest.mark.parametrize("kind", DETECTORS)
def test_tracks_over_rtsp_raise_the_alarm(kind: str, tmp_path: Path) -> None:
    clip = street.write(tmp_path / "street.mp4", 30.0)
    camera = """\
  - id: gate
    source: {{url: "{url}"}}
    rois:
      - id: road
        polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]
        detector: {detector}
"""
    with RtspServer(clip) as server:
        text = camera.format(url=server.url, detector=DETECTORS[kind])
        with (
            Daemon(tmp_path, text) as daemon,
            AlarmFollower(daemon.config, tmp_path / "alarms.log") as follower,
        ):
            record = wait_for("alarm", follower.records, 90)[0]
            assert record["type"] == "io.lumpwatch.alarm.raised.v1"
            found = record["data"]["objects"]
            assert found
            assert all(0 <= one["x"] + one["w"] / 2 <= street.WIDTH for one in found)
            assert sum(found[0]["model_shares"].values()) == pytest.approx(1.0, abs=0.01)
            model = "velocity"
            wait_for(
                "model shares",
                lambda: daemon.metric("lumpwatch_model_share_ratio", model=model, roi="road") > 0,
                30,
            )
            if kind == "jpda":
                wait_for(
                    "wrong way",
                    lambda: daemon.metric("lumpwatch_wrong_way_objects_total", roi="road") >= 1,
                    60,
                )
            code, seconds = daemon.stop()
            assert code == 0
            assert seconds < 5.0
    assert "Traceback" not in daemon.log.read_text()
