"""A site's life on a real engine: rolled out, killed, rolled back by itself, upgraded, rolled back by hand."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path

import pytest

from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.deployment.engine import DockerEngine
from tests.container.engine import BARE, IMAGE, READY_S, ROOT, Beats, Site, build_bare
from tests.integration.site import AlarmFollower, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.system, pytest.mark.timeout(1500)]

NOWHERE = "rtsp://127.0.0.1:9/nothing"


def test_the_life_of_a_container(tmp_path: Path, site: Site, engine: DockerEngine) -> None:
    first = site.up()
    assert first.returncode == 0, first.stdout + first.stderr
    again = site.up()
    assert again.returncode == 0, again.stderr
    assert "nothing to do" in again.stdout
    found = engine.found(site.container)
    assert found is not None
    assert site.page("/readyz")[0] == 200

    # Alarms are read from outside; the daemon is killed, and the engine starts it again.
    with AlarmFollower(site.config, tmp_path / "alarms.log") as follower:
        wait_for("alarm from the container", follower.records, 120)
    os.kill(site.attrs["State"]["Pid"], signal.SIGKILL)
    wait_for("the engine restarts it", lambda: engine.health(found.name) == [], READY_S)
    assert site.attrs["RestartCount"] == 1

    beats = Beats()
    config = load_config(site.config)
    with open_client(as_client(config.bus)) as bus:
        bus.subscribe(Keys(config.site).heartbeats(), beats)
        wait_for("heartbeat", lambda: beats.times, 60)

        # A camera that is not there: valid, never ready, and back by itself.
        site.write(url=NOWHERE)
        bad = site.up(timeout_s=20)
        assert bad.returncode == 1
        assert "went back " in bad.stderr
        now = engine.found(found.name)
        assert now is not None
        assert (now.digest, now.running) == (found.digest, True)
        heard = len(beats.times)
        wait_for("heartbeats again", lambda: len(beats.times) > heard + 3, 60)
        assert 1.0 < beats.gaps_s()[0] < 30.0  # what docs/deployment.md states

    # What the image refuses, here for want of a prior in its store, does not even stop what runs.
    tree = json.loads(site.config.read_text())
    tree["cameras"][0]["rois"][0]["detector"] = {"kind": "jdt", "likelihood": {"kind": "histogram"}}
    site.config.write_text(json.dumps(tree))
    since = site.attrs["State"]["StartedAt"]
    refused = site.up()
    assert refused.returncode == 1
    assert "the image refuses the configuration" in refused.stderr
    assert "likelihood kind histogram needs a prior" in refused.stderr
    assert site.attrs["State"]["StartedAt"] == since

    # An upgrade to another image, one without a shell, and back.
    build_bare(engine, tmp_path)
    site.write(raise_above=0.8)
    upgraded = site.up(BARE)
    assert upgraded.returncode == 0, upgraded.stdout + upgraded.stderr
    now = engine.found(found.name)
    assert now is not None
    assert now.image == engine.image(BARE) != found.image
    assert now.digest != found.digest
    assert site.python("import os; print(os.path.lexists('/bin/sh'))") == "False"
    back = site.deploy("rollback", "--timeout", str(READY_S))
    assert back.returncode == 0, back.stderr
    now = engine.found(found.name)
    assert now is not None
    assert (now.image, now.digest) == (engine.image(IMAGE), found.digest)
    told = site.deploy("status")
    assert told.returncode == 0, told.stdout
    assert f"{site.container}-previous" in told.stdout
    assert now.since[:19] in told.stdout
    assert "alarm" in site.deploy("logs", "--tail", "200").stdout


def test_the_health_check_judges_decisions(site: Site, engine: DockerEngine) -> None:
    def check() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["podman", "healthcheck", "run", site.container], capture_output=True, text=True, timeout=60
        )

    secret = "geheim-4711"
    site.environment = {"CAM_PASSWORD": secret}
    site.write(url="rtsp://user:${CAM_PASSWORD}@127.0.0.1:9/nothing")
    blind = site.up(timeout_s=20)
    assert blind.returncode == 1
    assert "left as it is" in blind.stderr
    # It lives, and is not healthy; the engine's own check says the same as the page.
    assert site.page("/livez")[0] == 200
    assert site.page("/readyz")[0] == 503
    sick = check()
    assert sick.returncode == 1, sick.stdout + sick.stderr

    # The password is in a file of the daemon's alone, and nowhere else.
    assert secret not in json.dumps(site.attrs)
    assert secret not in site.deploy("logs", "--tail", "500").stdout
    inside = "import os; f = os.environ['CAM_PASSWORD_FILE']; print(oct(os.stat(f).st_mode), open(f).read())"
    assert site.python(inside) == f"0o100400 {secret}"

    site.write()
    assert site.up().returncode == 0
    well = check()
    assert well.returncode == 0, well.stdout + well.stderr
    assert site.page("/readyz")[0] == 200


def test_a_missing_image_and_a_source_that_cannot_be_built(site: Site, engine: DockerEngine) -> None:
    missing = site.deploy("plan", "--image", "localhost/no-such-image:1")
    assert missing.returncode == 1
    assert "localhost/no-such-image:1: " in missing.stderr
    assert len(missing.stderr.splitlines()) == 1
    build = ("--build", str(ROOT), "--build-arg", "BASE=localhost/no-such-base:1")
    failed = site.deploy("up", "--image", "localhost/lumpwatch:test-broken", *build)
    assert failed.returncode == 1
    assert "no-such-base" in failed.stderr
    assert len(failed.stderr.splitlines()) == 1
    site.config.write_text(site.config.read_text().replace('"latch"', '"lach"'))
    refused = site.up()
    assert refused.returncode == 2
    assert "lach: unknown key" in refused.stderr
    assert engine.found(site.container) is None
