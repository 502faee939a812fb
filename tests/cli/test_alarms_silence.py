"""`lumpwatch alarms` on a real bus whose daemon falls silent and comes back."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from tests.bus.test_bus_support import eventually
from tests.console.plant import CONFIG, Plant
from tests.integration.site import LUMPWATCH

WITHIN_S = 40.0  # of a machine that does other things too


def test_silence_is_told_and_its_end_and_ends_a_script_that_asks_for_it(tmp_path: Path) -> None:
    plant = Plant()
    config, log = tmp_path / "site.yaml", tmp_path / "log"
    config.write_text(CONFIG.format(endpoint=plant.endpoint, console="{}"))
    follow = [*LUMPWATCH, "alarms", str(config)]
    with log.open("wb") as out, (tmp_path / "json").open("wb") as records:
        piped = subprocess.Popen(follow, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        person = subprocess.Popen(follow, stdout=out, stderr=out)
        script = subprocess.Popen([*follow, "--json", "--exit-on-silence"], stdout=records, stderr=records)
        try:
            plant.raise_alarm()
            eventually(lambda: "raised" in log.read_text(), WITHIN_S)
            eventually(lambda: "raised" in (tmp_path / "json").read_text(), WITHIN_S)
            assert "SILENT" not in log.read_text()
            # `lumpwatch alarms | head -1`: it ends with its reader, though it has nothing more to say.
            assert piped.stdout is not None
            assert piped.stdout.readline()
            piped.stdout.close()
            assert piped.wait(timeout=WITHIN_S) == 0
            assert piped.stderr is not None
            assert piped.stderr.read() == b""
            plant.beating.clear()
            eventually(lambda: "cam: SILENT, no heartbeat" in log.read_text(), WITHIN_S)
            assert script.wait(timeout=WITHIN_S) == 3
            plant.beating.set()
            eventually(lambda: "cam: heard again after" in log.read_text(), WITHIN_S)
            assert person.poll() is None
            lines = [json.loads(line) for line in (tmp_path / "json").read_text().splitlines()]
            assert [one["type"] for one in lines] == [
                "io.lumpwatch.alarm.raised.v1",
                "io.lumpwatch.silence.began.v1",
            ]
        finally:
            for process in (person, script, piped):
                process.terminate()
                process.wait(timeout=WITHIN_S)
            plant.close()
