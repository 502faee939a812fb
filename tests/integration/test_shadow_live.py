"""A real daemon with a prior in shadow: who raises alarms, what is counted, promoting and going back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lumpwatch.models.learning import HistogramFit
from lumpwatch.service.storage.atomic import replace_file
from lumpwatch.service.storage.prior_file import Prior
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.storage.shadow_store import read_state
from tests.integration.site import wait_for
from tests.integration.test_alarm_life import KEYS, Site, running
from tests.service_helpers import learned, prior

pytestmark = pytest.mark.slow

OF = ("cam", "apron")
WHERE = ("--camera", "cam", "--roi", "apron")


def believing(offset: float) -> Prior:
    """A prior whose likelihood says the same of every box."""
    fit = HistogramFit(np.full(16, 1 / 16), offset, 0.0, "luma")
    return prior(learned(likelihood=fit), source=f"offset {offset:g}")


SEES_NOTHING, SEES_ALWAYS = believing(-6.0), believing(6.0)


def priors(site: Site, action: str, *more: str, code: int = 0) -> str:
    """The output of `lumpwatch priors`, of the error where it is to fail."""
    done = site.daemon.command("priors", action, str(site.daemon.config), *more)
    assert done.returncode == code, done.stderr
    return done.stdout if code == 0 else done.stderr


def told(site: Site) -> dict[str, Any]:
    """What the daemon publishes of its shadow."""
    replies = [reply.payload for reply in site.bus.ask(KEYS.shadow(*OF)) if reply.payload is not None]
    return json.loads(replies[-1]) if replies else {}


def runs(site: Site, in_use: int, shadow: int) -> None:
    """Wait until the daemon has taken both."""

    def there() -> bool:
        metric = site.daemon.metric
        return (metric("lumpwatch_prior_version"), metric("lumpwatch_shadow_prior_version")) == (
            in_use,
            shadow,
        )

    wait_for(f"version {in_use} in use, {shadow} in shadow", there, 30)


def counts(site: Site, key: str, least: int) -> dict[str, Any]:
    found: dict[str, Any] = wait_for(
        f"{least} {key}", lambda: (state := told(site)).get(key, -1) >= least and state, 60
    )
    return found


def test_a_shadow_is_counted_promoted_and_gone_back_from(tmp_path: Path) -> None:
    alarm: dict[str, Any] = {"off_delay_s": 0.3, "latch": False, "blind": {"on_delay_s": 60.0}}
    with running(tmp_path, {"shadow_match_s": 1.0}, **alarm) as site:
        store = PriorStore(tmp_path / "var")
        assert "no prior runs in shadow" in priors(site, "shadow", *WHERE)

        # A shadow that sees a lump all the time, and nothing comes of it.
        store.save(SEES_ALWAYS, shadow=True)
        runs(site, 1, 2)
        state = counts(site, "only_shadow", 1)
        assert state["lump"]
        assert (state["version"], state["current"], state["only_current"]) == (2, 1, 0)
        assert (site.state()["state"], site.state()["alarm"], site.state()["prior"]) == ("CLEAR", "NORMAL", 1)
        assert site.follower.records(None) == []
        assert "version 2 no longer runs in shadow" in priors(site, "drop", *WHERE)
        runs(site, 1, 0)
        wait_for("nothing more told", lambda: told(site) == {}, 30)

        # One that sees nothing, and the alarm comes all the same.
        store.save(SEES_NOTHING, shadow=True)
        runs(site, 1, 3)
        counts(site, "frames", 5)
        site.feed.bright = True
        site.wait_alarm("UNACKNOWLEDGED")
        counts(site, "only_current", 1)
        # What the bus has said already comes to the metrics and to the follower on ways of their own.
        raised = "lumpwatch_shadow_raised_alarms_total"
        wait_for("counted", lambda: site.daemon.metric(raised, side="only_current") >= 1, 30)
        assert site.daemon.metric(raised, side="only_current") == 1
        (record,) = wait_for("a record", site.follower.records, 30)
        assert record["data"]["prior"] == 1
        wait_for("kept", lambda: (kept := read_state(store, *OF)) and kept.only_current == 1, 30)
        text = priors(site, "shadow", *WHERE)
        assert "version 3 in shadow of version 1" in text
        assert "only the one in use 1" in text

        # A restart goes on counting.
        before = told(site)
        site.kill_monitor()
        after = counts(site, "only_current", 1)
        assert after["since"] == before["since"]
        assert after["agree_s"] >= 0.0
        assert after["only_current_s"] > 1.0

        # Promoted by command while it runs: now it decides, and sees nothing.
        refused = priors(site, "promote", *WHERE, "--version", "2", code=1)
        assert "version 3 runs in shadow, not 2" in refused
        assert "rollback --version 1" in priors(site, "promote", *WHERE, "--version", "3")
        runs(site, 3, 0)
        site.wait_alarm("NORMAL")
        assert site.state()["prior"] == 3
        priors(site, "rollback", *WHERE, "--version", "1")
        runs(site, 1, 0)
        site.wait_alarm("UNACKNOWLEDGED")

        # A promotion that died between its first two writes: the new one is in use, nothing in shadow.
        store.set_shadow(*OF, 2)
        runs(site, 1, 2)
        replace_file(store.folder(*OF) / "current", b"2\n")
        runs(site, 2, 0)
        wait_for("decided by version 2", lambda: site.state().get("prior") == 2, 30)

        # A damaged shadow is refused, counted, and nothing stands in.
        path = store.path(*OF, 3)
        path.write_bytes(path.read_bytes()[:-1])
        replace_file(store.folder(*OF) / "shadow", b"3\n")
        wait_for(
            "refused",
            lambda: site.daemon.metric("lumpwatch_shadow_failures_total", reason="unreadable") == 1,
            30,
        )
        assert site.state()["prior"] == 2
