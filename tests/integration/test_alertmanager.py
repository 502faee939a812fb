"""A real Alertmanager with the routes of `deploy/`: who is told of what, and what is held back."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from tests.integration.site import wait_for
from tests.servers.prometheus import ALERTMANAGER, alertmanager

pytestmark = [
    pytest.mark.slow,
    pytest.mark.system,
    pytest.mark.skipif(
        ALERTMANAGER is None, reason="Debian package prometheus-alertmanager is not installed"
    ),
]


def alert(name: str, instance: str, camera: str = "", severity: str = "page", **more: str) -> dict[str, Any]:
    labels = {"alertname": name, "severity": severity, "site": "pit", "instance": instance, "camera": camera}
    return {"labels": labels | {"roi": "apron"}, "annotations": {"summary": "-"}} | more


def test_pages_and_tickets_go_to_their_receivers_and_what_follows_is_held_back(tmp_path: Path) -> None:
    with alertmanager(tmp_path) as manager:
        # A daemon that is down explains everything else of its own, and nothing of another.
        manager.post([alert("LumpwatchDown", "a:1")])
        wait_for("first page", lambda: manager.told("pages"), 20)
        manager.post(
            [
                alert("LumpwatchBlind", "a:1", "of-a"),
                alert("LumpwatchPriorOld", "a:1", "of-a", "ticket"),
                alert("LumpwatchBlind", "b:1", "of-b"),
                alert("LumpwatchPriorOld", "b:1", "of-b", "ticket"),
            ]
        )
        wait_for("ticket", lambda: manager.told("tickets"), 20)
        time.sleep(3.0)  # three times what tickets wait
        assert manager.told("pages") == {("LumpwatchDown", ""), ("LumpwatchBlind", "of-b")}
        assert manager.told("tickets") == {("LumpwatchPriorOld", "of-b")}

        # The end is told as well.
        manager.post([alert("LumpwatchBlind", "b:1", "of-b", endsAt="2020-01-01T00:00:00Z")])
        wait_for("all clear", lambda: ("LumpwatchBlind", "of-b") in manager.told("pages", "resolved"), 30)
