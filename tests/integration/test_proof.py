"""Proof tests of a real daemon: frames, bus, filter and alarm, beside the chain that watches the belt."""

from __future__ import annotations

import json
import os
import signal
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.storage.prior_store import PriorStore, read_file
from tests.integration.conftest import PRIOR
from tests.integration.site import AlarmFollower, Daemon, wait_for

pytestmark = pytest.mark.slow

KEYS = Keys("test")


def test_by_command_and_on_a_schedule(tmp_path: Path, polygon: str) -> None:
    """One ROI is tested by itself and passes; the other asks for more warning than a belt has, and fails."""
    rois = "".join(
        f"      - {{id: {name}, polygon: {polygon}, alarm: {{latch: false}}, "
        f"proof_test: {{settle_s: 2, retry_s: 3, {more}}}}}\n"
        for name, more in (("apron", "every_s: 86400"), ("strict", "least_warning_s: 3600"))
    )
    daemon = Daemon(
        tmp_path,
        f'  - id: cam\n    source: {{url: "sim:feed?lumps_per_minute=0", seed: 3}}\n    rois:\n{rois}',
    )
    config = load_config(daemon.config)
    known = read_file(PRIOR)
    for roi in ("apron", "strict"):
        meta = known.meta.model_copy(update={"camera": "cam", "roi": roi})
        PriorStore(config.store.path).save(replace(known, meta=meta))
    with daemon, open_client(as_client(config.bus)) as bus:
        tests: list[dict[str, object]] = []
        bus.subscribe_alarms(KEYS.tests(), lambda _, payload: tests.append(json.loads(payload)))
        with AlarmFollower(daemon.config, tmp_path / "alarms.log") as follower:
            wait_for(
                "scheduled test",
                lambda: (
                    daemon.metric("lumpwatch_proof_test_outcomes_total", roi="apron", outcome="passed") == 1
                ),
                120,
            )
            warned = "lumpwatch_proof_test_warning_seconds"
            wait_for("its warning", lambda: daemon.metric(warned, roi="apron") > 1.0, 30)
            record = wait_for("test record", lambda: tests, 30)[0]
            assert record["subject"] == "cam/apron"
            assert record["data"]["test"] is True
            assert record["data"]["change"] == "raised"

            done = daemon.command("proof", str(daemon.config), "--camera", "cam", "--roi", "strict")
            assert (done.returncode, done.stderr) == (1, "")
            assert done.stdout.startswith("cam/strict: failed (too_late), ")
            assert "does not show that lumps like those of this site are found" in done.stdout
            raised = wait_for("system alarm", lambda: follower.records("system"), 20)
            assert [(one["data"]["roi"], one["data"]["reason"]) for one in raised] == [
                ("strict", "proof_test")
            ]

            # The chain that watches the belt has not noticed anything.
            assert follower.records("lump") == []
            assert daemon.metric("lumpwatch_roi_blind") == 0

            (camera,) = daemon.children()["camera"]
            os.kill(camera, signal.SIGSTOP)
            done = daemon.command("proof", str(daemon.config), "--camera", "cam", "--roi", "apron", "--json")
            # A camera process that hangs for long is killed by the daemon: it may be gone by now.
            with suppress(ProcessLookupError):
                os.kill(camera, signal.SIGCONT)
            told = json.loads(done.stdout)
            assert (done.returncode, told["outcome"] != "passed") == (1, True)
            assert told["reason"] in ("blind", "no_camera", "no_frames")
        assert daemon.stop()[0] == 0
    assert "Traceback" not in daemon.log.read_text()
