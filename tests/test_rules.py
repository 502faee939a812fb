"""Prometheus rules by promtool: each alert in a case that fires and in one that stays silent."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from docs.generate import metrics_page

DEPLOY = Path(__file__).parents[1] / "deploy"
RULES = sorted((DEPLOY / "prometheus" / "rules").glob("*.yml"))
RUNBOOKS = Path(__file__).parents[1] / "docs" / "runbooks.md"

S = 'job="lumpwatch",instance="a:1",site="pit"'
L = f'{S},camera="cam"'
R = f'{L},roi="apron"'
LUMP, SYSTEM = f'{R},class="lump"', f'{R},class="system"'


@dataclass(frozen=True)
class Case:
    """Series of one sample every 15 s; `at_s` is when the alert is looked at."""

    fires: dict[str, str]
    silent: dict[str, str]
    at_s: int = 120


DECIDES = f"lumpwatch_frames_processed_total{{{R}}}"
SEES = f"lumpwatch_roi_blind{{{R}}}"
LIP_DECIDES, LIP_SEES = (one.replace('roi="apron"', 'roi="lip"') for one in (DECIDES, SEES))
PACED = f'lumpwatch_frames_paced_total{{{L},roi=""}}'
RECEIVED, DROPPED = (
    f"lumpwatch_frames_received_total{{{L}}}",
    f'lumpwatch_frames_dropped_total{{{L},reason="skipped"}}',
)

CASES = {
    "LumpwatchDown": Case({f"up{{{L}}}": "1 1 0x20"}, {f"up{{{L}}}": "1 0 1x20"}),
    "LumpwatchNotScraped": Case({'up{job="other"}': "1x20"}, {f"up{{{L}}}": "0x20"}),
    "LumpwatchBlind": Case({SEES: "0 0 1x20"}, {SEES: "0 1 0x20"}),
    # Who says that it is blind is not silent: the camera is gone, and LumpwatchBlind tells of it.
    "LumpwatchSilent": Case(
        {DECIDES: "0+150x3 450x20", SEES: "0x30"},
        {DECIDES: "0+150x30", SEES: "0x30", LIP_DECIDES: "450x30", LIP_SEES: "0 1x30"},
    ),
    "LumpwatchLumpUnacknowledged": Case(
        {f"lumpwatch_alarm_unacknowledged{{{LUMP}}}": "0 1x20"},
        {f"lumpwatch_alarm_unacknowledged{{{LUMP}}}": "0 1 1 0x20"},
    ),
    "LumpwatchSystemAlarm": Case(
        {f"lumpwatch_alarm_active{{{SYSTEM}}}": "0 1x20"},
        {f"lumpwatch_alarm_active{{{LUMP}}}": "0 1x20", f"lumpwatch_alarm_active{{{SYSTEM}}}": "0x20"},
    ),
    "LumpwatchLatencyBudget": Case(
        {f"lumpwatch_latency_budget_ratio{{{R}}}": "0.9x60"},
        {f"lumpwatch_latency_budget_ratio{{{R}}}": "0.9x8 0.2x60"},
        at_s=600,
    ),
    "LumpwatchFramesDropped": Case(
        # Of what is due: half of them were passed over by rule. A daemon of before counts none of those.
        {RECEIVED: "0+150x80", PACED: "0+75x80", DROPPED: "0+20x80"},
        {RECEIVED: "0+150x80", DROPPED: "0+20x80"},
        at_s=1200,
    ),
    "LumpwatchPriorMissing": Case(
        {f"lumpwatch_prior_version{{{R}}}": "0x400"},
        {f"lumpwatch_prior_version{{{R}}}": "0x20 1x380"},
        at_s=4500,
    ),
    "LumpwatchPriorOld": Case(
        {f"lumpwatch_prior_created_timestamp_seconds{{{R}}}": "-15600000x400"},
        {f"lumpwatch_prior_created_timestamp_seconds{{{R}}}": "-15000000x400"},
        at_s=4500,
    ),
    "LumpwatchPriorRefused": Case(
        {f'lumpwatch_prior_problems_total{{{R},reason="unfit"}}': "0 0 1x20"},
        {f'lumpwatch_prior_problems_total{{{R},reason="unfit"}}': "3x20"},
    ),
    "LumpwatchProofTestFailed": Case(
        {f"lumpwatch_proof_test_passed{{{R}}}": "1 0x20"}, {f"lumpwatch_proof_test_passed{{{R}}}": "1x20"}
    ),
    "LumpwatchStoreNearlyFull": Case(
        {f"lumpwatch_store_free_ratio{{{L}}}": "0.05x60"},
        {f"lumpwatch_store_free_ratio{{{L}}}": "0.2x60"},
        at_s=600,
    ),
    "LumpwatchEventLogTrouble": Case(
        {f'lumpwatch_event_log_problems_total{{{L},reason="unwritable"}}': "0 0 2x20"},
        {f'lumpwatch_event_log_problems_total{{{L},reason="late"}}': "0 0 2x20"},
    ),
    "LumpwatchRestarts": Case(
        {f'lumpwatch_worker_restarts_total{{{L},process="monitor",reason="exited"}}': "0 0+2x20"},
        {f'lumpwatch_worker_restarts_total{{{L},process="monitor",reason="exited"}}': "0 1x20"},
    ),
    "LumpwatchOutOfService": Case(
        {f"lumpwatch_alarm_out_of_service{{{LUMP}}}": "1x3000"},
        {f"lumpwatch_alarm_out_of_service{{{LUMP}}}": "1x2000 0x1000"},
        at_s=44000,
    ),
    # Time begins at 0 here.
    "LumpwatchCertificateEnds": Case(
        {f'lumpwatch_certificate_expiry_timestamp_seconds{{{S},certificate="ca"}}': f"{20 * 86400}x400"},
        {f'lumpwatch_certificate_expiry_timestamp_seconds{{{S},certificate="ca"}}': f"{40 * 86400}x400"},
        at_s=4500,
    ),
    "LumpwatchCertificateEndsSoon": Case(
        {f'lumpwatch_certificate_expiry_timestamp_seconds{{{S},certificate="ca"}}': "0x20"},
        {f'lumpwatch_certificate_expiry_timestamp_seconds{{{S},certificate="ca"}}': f"{20 * 86400}x20"},
    ),
    "LumpwatchReferenceMissing": Case(
        {f"lumpwatch_reference_version{{{L}}}": "0x400"},
        {f"lumpwatch_reference_version{{{L}}}": "0x20 1x380"},
        at_s=4500,
    ),
    "LumpwatchEvidenceTrouble": Case(
        {f'lumpwatch_evidence_problems_total{{{L},reason="memory"}}': "0 0 1x20"},
        {f'lumpwatch_evidence_problems_total{{{L},reason="memory"}}': "3x20"},
    ),
    "LumpwatchNeverProven": Case(
        {SEES: "0x400"},
        {SEES: "0x400", f"lumpwatch_proof_test_timestamp_seconds{{{R}}}": "0x400"},
        at_s=4500,
    ),
    "LumpwatchVersionSkew": Case(
        {f'lumpwatch_build_info{{{S},version="{one}"}}': "1x600" for one in ("0.1.0", "0.2.0")},
        {f'lumpwatch_build_info{{{S},version="0.1.0"}}': "1x600"},
        at_s=7500,
    ),
}


ALWAYS = "LumpwatchWatchdog"
"""Fires without a case: it is the proof that alerts arrive."""


def promtool(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    if (found := shutil.which("promtool")) is None:
        pytest.skip("promtool is not installed (Debian package prometheus)")
    return subprocess.run([found, *arguments], capture_output=True, text=True, timeout=120)


def alerts() -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for file in RULES:
        for group in YAML(typ="safe").load(file)["groups"]:
            found |= {rule["alert"]: rule for rule in group["rules"] if "alert" in rule}
    return found


def expressions() -> list[str]:
    found = [
        rule["expr"]
        for file in RULES
        for group in YAML(typ="safe").load(file)["groups"]
        for rule in group["rules"]
    ]
    for file in sorted((DEPLOY / "grafana" / "dashboards").glob("*.json")):
        found += [one["expr"] for panel in json.loads(file.read_text())["panels"] for one in panel["targets"]]
    return found


def test_the_rules_are_rules() -> None:
    done = promtool("check", "rules", *RULES)
    assert done.returncode == 0, done.stderr
    done = promtool("check", "config", DEPLOY / "prometheus" / "prometheus.yml")
    assert done.returncode == 0, done.stderr


def test_the_alerts_reach_somebody() -> None:
    if (amtool := shutil.which("amtool")) is None:
        pytest.skip("amtool is not installed (Debian package prometheus-alertmanager)")
    config = DEPLOY / "alertmanager" / "alertmanager.yml"

    def receiver(*labels: str) -> str:
        command = [amtool, "config", "routes", "test", f"--config.file={config}", *labels]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout.strip()

    assert receiver("severity=page", "alertname=LumpwatchBlind") == "pages"
    assert receiver("severity=ticket", "alertname=LumpwatchPriorOld") == "tickets"
    assert receiver("severity=none", "alertname=LumpwatchWatchdog") == "watchdog"
    assert {rule["labels"]["severity"] for rule in alerts().values()} == {"page", "ticket", "none"}


def test_every_alert_has_both_cases_and_a_runbook() -> None:
    assert {*CASES, ALWAYS} == set(alerts())
    headings = set(re.findall(r"^## (\w+)$", RUNBOOKS.read_text(), re.MULTILINE))
    assert headings == set(alerts())
    for name, rule in alerts().items():
        assert rule["annotations"]["runbook_url"] == f"{{{{ $externalLabels.runbooks }}}}#{name.lower()}"
        assert rule["annotations"]["summary"]
        assert rule["annotations"]["description"]


@pytest.mark.parametrize("fires", [True, False], ids=["fires", "silent"])
def test_every_alert_fires_when_it_should_and_only_then(tmp_path: Path, fires: bool) -> None:
    tests = []
    for name, case in CASES.items():
        series = case.fires if fires else case.silent
        tests.append(
            {
                "name": name,
                "interval": "15s",
                "input_series": [{"series": one, "values": values} for one, values in series.items()],
                "promql_expr_test": [
                    {
                        "expr": f'count(ALERTS{{alertname="{name}", alertstate="firing"}})',
                        "eval_time": f"{case.at_s}s",
                        "exp_samples": [{"labels": "{}", "value": 1}] if fires else [],
                    }
                ],
            }
        )
    file = tmp_path / "test.yml"
    rules = [str(rule) for rule in RULES]
    file.write_text(json.dumps({"rule_files": rules, "evaluation_interval": "15s", "tests": tests}))
    done = promtool("test", "rules", file)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_metric_that_is_asked_for_exists() -> None:
    known = set(re.findall(r"^\| `(\w+)` \| (\w+) \|", metrics_page(), re.MULTILINE))
    names = {
        f"{name}{suffix}"
        for name, kind in known
        for suffix in (("_bucket", "_sum", "_count") if kind == "histogram" else ("",))
    }
    recorded = {
        rule["record"]
        for file in RULES
        for group in YAML(typ="safe").load(file)["groups"]
        for rule in group["rules"]
        if "record" in rule
    }
    for expression in expressions():
        bare = re.sub(r'"[^"]*"', '""', expression)
        for name in re.findall(r"lumpwatch[_:][\w:]+", bare):
            assert name in names | recorded, f"{name} in {expression}"


def test_a_page_says_where_and_why_and_its_runbook_is_an_address(tmp_path: Path) -> None:
    file = tmp_path / "test.yml"
    where = {"instance": "a:1", "site": "pit", "camera": "cam", "roi": "apron"}
    test = {
        "interval": "15s",
        "external_labels": {"runbooks": "https://docs.test/runbooks.md"},
        "input_series": [
            {"series": f"{SEES}", "values": "1x20"},
            {"series": f'lumpwatch_roi_blind_reason{{{R},reason="no_stream"}}', "values": "1x20"},
            {"series": f'lumpwatch_roi_blind_reason{{{R},reason="hidden"}}', "values": "0x20"},
        ],
        "alert_rule_test": [
            {
                "alertname": "LumpwatchBlind",
                "eval_time": "2m",
                "exp_alerts": [
                    {
                        "exp_labels": {**where, "job": "lumpwatch", "severity": "page"},
                        "exp_annotations": {
                            "summary": "pit: cam/apron cannot see (no_stream)",
                            "description": alerts()["LumpwatchBlind"]["annotations"]["description"],
                            "runbook_url": "https://docs.test/runbooks.md#lumpwatchblind",
                        },
                    }
                ],
            }
        ],
    }
    file.write_text(
        json.dumps(
            {"rule_files": [str(rule) for rule in RULES], "evaluation_interval": "15s", "tests": [test]}
        )
    )
    done = promtool("test", "rules", file)
    assert done.returncode == 0, done.stdout + done.stderr
