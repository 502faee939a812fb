"""A real daemon: from an alarm to its evidence, its exact replay, a verdict and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.integration.site import wait_for
from tests.integration.test_alarm_life import KEYS, Site, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

WHERE = ("--camera", "cam", "--roi", "apron")
SHORT = "evidence: {pre_roll_s: 2.0, post_roll_s: 1.0, least_free_mb: 0}\n"


def ask(site: Site, key: str, parameters: dict[str, str]) -> Any:
    (reply,) = site.bus.ask(key, parameters, timeout_s=20)
    assert reply.payload is not None, reply.error
    return json.loads(reply.payload)


def raise_alarm(site: Site, number: int) -> dict[str, Any]:
    """The record of the alarm once its evidence is on the disk."""
    site.feed.bright = True
    site.wait_alarm("UNACKNOWLEDGED")
    wait_for("written", lambda: site.daemon.metric("lumpwatch_evidence_written_total") == number, 60)
    ask(site, KEYS.command("cam", "apron", "ack"), {"actor": "Ada"})
    site.feed.bright = False
    site.wait_alarm("NORMAL")

    def raised() -> list[dict[str, Any]]:
        """The follower is a process of its own and may lag behind."""
        found = [one for one in site.follower.records() if one["data"]["change"] == "raised"]
        return found[number - 1 :]

    return dict(wait_for("the record", raised, 30)[0])


def test_from_the_alarm_to_the_report(tmp_path: Path) -> None:
    live: dict[int, tuple[str, float, list[Any]]] = {}

    def on_state(key: str, payload: bytes) -> None:
        told = json.loads(payload)
        live.setdefault(told["frame"], (told["state"], told["existence"], told["objects"]))

    with running(tmp_path, more=SHORT, off_delay_s=0.5, blind={"on_delay_s": 60.0}) as site:
        site.bus.subscribe(KEYS.state("cam", "apron"), on_state)
        wait_for("pre-roll", lambda: site.daemon.metric("lumpwatch_evidence_pre_roll_seconds") >= 2.0, 60)
        first, second = raise_alarm(site, 1), raise_alarm(site, 2)
        name = first["data"]["evidence"]
        assert name == first["id"]

        # Fetched by another process, over the bus.
        listed = [
            json.loads(line) for line in site.command("evidence", "list", "--bus", "--json").splitlines()
        ]
        assert [one["id"] for one in listed] == [first["id"], second["id"]]
        assert listed[0]["exact"]
        folder = Path(
            site.command("evidence", "fetch", name, "--bus", "--out", str(tmp_path / "got")).strip()
        )
        # Replayed by another process, without the site's configuration or store.
        done = site.daemon.command("replay", "--evidence", str(folder), "--out", str(tmp_path / "again"))
        assert done.returncode == 0, done.stderr
        assert "the same decisions as live on all" in done.stdout
        # And these are the decisions that were published.
        again = [json.loads(line) for line in (tmp_path / "again" / "states.jsonl").read_text().splitlines()]
        assert {one["state"] for one in again} == {"CLEAR", "LUMP"}
        seen = [one for one in again if one["frame"] in live]
        assert len(seen) > len(again) / 2
        for one in seen:
            assert (one["state"], one["existence"], one["objects"]) == live[one["frame"]]

        # Verdicts, changed once, one by evidence and one by the sequence of a later record of the alarm.
        said = {"actor": "Ada", "verdict": "false"}
        ask(site, KEYS.command("cam", "apron", "verdict"), said | {"evidence": name})
        told = site.command("verdict true", *WHERE, "--by", "Ada", "--evidence", name, "--note", "it was")
        assert told == f"cam/apron alarm {first['data']['sequence']}: true\n"
        later = str(second["data"]["sequence"] + 1)
        judged = ask(site, KEYS.command("cam", "apron", "verdict"), said | {"alarm": later})
        assert judged == {
            "verdict": "false",
            "sequence": second["data"]["sequence"],
            "alarm": second["id"],
            "written": True,
        }
        (refused,) = site.bus.ask(KEYS.command("cam", "apron", "verdict"), said | {"alarm": "999"})
        assert refused.error == "alarm: the event log knows no lump alarm 999"
        assert site.daemon.metric("lumpwatch_evidence_problems_total") == 0
    # The daemon is down: what it watched, and what was said, is in the log.
    page = tmp_path / "shift.html"
    told = site.command("report", "--shift", "current", "--json", "--out", str(page))
    report = json.loads(told)
    assert report["total"]["lumps"] == 2
    assert report["total"]["verdicts"] == {"true": 1, "false": 1, "unsure": 0, "none": 0}
    assert report["total"]["precision"] == 0.5
    assert report["total"]["acknowledge_s"]["count"] == 2
    assert [one["verdict"] for one in report["alarms"]] == ["true", "false"]
    assert report["alarms"][0]["note"] == "it was"
    assert report["rois"][0]["availability"] > 0
    assert report["rois"][0]["unknown_minutes"] >= 0
    assert page.read_text().count("data:image/jpeg;base64,") == 2
