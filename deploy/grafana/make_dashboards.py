"""Writes the Grafana dashboards beside this file; run it after a change, the tests compare.

python deploy/grafana/make_dashboards.py
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent / "dashboards"
SOURCE = {"type": "prometheus", "uid": "prometheus"}
SITE = 'site=~"$site"'
ROI = 'site=~"$site", camera=~"$camera"'
RAISED = 'lumpwatch_alarm_changes_total{class="lump", change="raised"'
LATENCY = "sum by (le, site, camera) (rate(lumpwatch_frame_to_decision_seconds_bucket{" + ROI + "}[5m]))"
STAGE = "lumpwatch_stage_duration_seconds"


@dataclass(frozen=True)
class Panel:
    """One panel; `queries` are pairs of PromQL and legend."""

    title: str
    description: str
    queries: tuple[tuple[str, str], ...]
    unit: str = "short"
    kind: str = "timeseries"
    width: int = 12
    height: int = 7
    steps: tuple[tuple[float | None, str], ...] = ((None, "green"),)
    names: tuple[tuple[float, str, str], ...] = ()
    """Values that are shown as words: value, word, colour."""
    most: float | None = None


NOW = ("stat", "bargauge")
"""Kinds of panel that show what is, and no course."""
BLIND_STEPS = ((None, "green"), (1.0, "purple"))
ALARM_STEPS = ((None, "green"), (1.0, "red"))
YES_NO = ((0.0, "no", "green"), (1.0, "yes", "red"))
SEES = ((0.0, "sees", "green"), (1.0, "BLIND", "purple"))

OPERATIONS = (
    Panel(
        "Can it see?", "BLIND regions cannot say whether a lump is coming. No value means that nothing decides.",
        ((f"lumpwatch_roi_blind{{{ROI}}}", "{{camera}}/{{roi}}"),), kind="stat", width=8, steps=BLIND_STEPS, names=SEES,
    ),
    Panel(
        "Lump now?", "1 while the alarm condition holds, announced or not.",
        ((f'lumpwatch_alarm_active{{{ROI}, class="lump"}}', "{{camera}}/{{roi}}"),),
        kind="stat", width=8, steps=ALARM_STEPS, names=((0.0, "none", "green"), (1.0, "LUMP", "red")),
    ),
    Panel(
        "Waiting for acknowledgement", "Alarms that nobody has acknowledged, of every class.",
        ((f"lumpwatch_alarm_unacknowledged{{{ROI}}}", "{{camera}}/{{roi}} {{class}}"),),
        kind="stat", width=8, steps=ALARM_STEPS, names=YES_NO,
    ),
    Panel(
        "Probability of a lump", "Existence as the filter sees it; the alarm goes by its threshold.",
        ((f"lumpwatch_existence_ratio{{{ROI}}}", "{{camera}}/{{roi}}"),), unit="percentunit", most=1.0,
    ),
    Panel(
        "Lumps an hour", "Lump alarms raised in the hour before.",
        ((f"increase({RAISED}, {ROI}}}[1h])", "{{camera}}/{{roi}}"),),
    ),
    Panel(
        "Seconds to the lip", "Until the first lump reaches the lip; nothing is shown while none is on its way.",
        ((f"lumpwatch_lip_seconds{{{ROI}}} < +Inf", "{{camera}}/{{roi}}"),), unit="s",
    ),
    Panel(
        "Largest lump", "Longest diameter of the largest lump in view, on calibrated belts.",
        ((f"lumpwatch_largest_meters{{{ROI}}}", "{{camera}}/{{roi}}"),), unit="lengthm",
    ),
    Panel(
        "Blind share of the last hour", "Share of time in which the region could not judge.",
        ((f"avg_over_time(lumpwatch_roi_blind{{{ROI}}}[1h])", "{{camera}}/{{roi}}"),), unit="percentunit", most=1.0,
    ),
    Panel(
        "Kept quiet", "Alarms that are shelved, suppressed by the plant, or out of service.",
        (
            (f"lumpwatch_alarm_shelved{{{ROI}}}", "{{camera}}/{{roi}} {{class}} shelved"),
            (f"lumpwatch_alarm_suppressed{{{ROI}}}", "{{camera}}/{{roi}} {{class}} suppressed"),
            (f"lumpwatch_alarm_out_of_service{{{ROI}}}", "{{camera}}/{{roi}} {{class}} out of service"),
        ),
    ),
)  # fmt: skip

ENGINEERING = (
    Panel(
        "Frames a second", "From the camera, passed over by rule (decide_hz), and those that each region decided on.",
        (
            (f"rate(lumpwatch_frames_received_total{{{ROI}}}[1m])", "{{camera}} received"),
            (f"sum by (camera) (rate(lumpwatch_frames_paced_total{{{ROI},roi=\"\"}}[1m]))", "{{camera}} paced"),
            (f"rate(lumpwatch_frames_processed_total{{{ROI}}}[1m])", "{{camera}}/{{roi}} decided"),
        ),
        unit="hertz",
    ),
    Panel(
        "Dropped frames a second", "By reason: skipped means that the monitor is slower than the camera.",
        ((f"rate(lumpwatch_frames_dropped_total{{{ROI}}}[5m])", "{{camera}} {{reason}}"),), unit="hertz",
    ),
    Panel(
        "From frame to decision", "Median and 99th percentile, from the decoded frame to the decision.",
        (
            (f"histogram_quantile(0.5, {LATENCY})", "{{camera}} median"),
            (f"histogram_quantile(0.99, {LATENCY})", "{{camera}} 99 %"),
        ),
        unit="s",
    ),
    Panel(
        "Where the time goes", "Mean time of each stage of the work on a frame.",
        (
            (f"rate({STAGE}_sum{{{ROI}}}[5m]) / rate({STAGE}_count{{{ROI}}}[5m])", "{{camera}} {{roi}} {{stage}}"),
        ),
        unit="s",
    ),
    Panel(
        "Effective particles", "How many particles carry the belief; near 1 the filter has lost its footing.",
        ((f"lumpwatch_effective_particles{{{ROI}}}", "{{camera}}/{{roi}}"),),
    ),
    Panel(
        "Motion models", "Probability of each motion model over the objects that are there.",
        ((f"lumpwatch_model_share_ratio{{{ROI}}}", "{{camera}}/{{roi}} {{model}}"),), unit="percentunit", most=1.0,
    ),
    Panel(
        "Switching outside the training data", "Share of particles for which switching fell back on the matrix.",
        ((f"lumpwatch_switching_fallback_ratio{{{ROI}}}", "{{camera}}/{{roi}}"),), unit="percentunit", most=1.0,
    ),
    Panel(
        "Prior in use", "Its version; 0 means stated defaults.",
        ((f"lumpwatch_prior_version{{{ROI}}}", "{{camera}}/{{roi}}"),),
        kind="stat", steps=((None, "orange"), (1.0, "green")),
    ),
    Panel(
        "Connected to the camera", "Whether the source delivers frames.",
        ((f"lumpwatch_source_connected{{{ROI}}}", "{{camera}}"),), kind="state-timeline",
        steps=((None, "red"), (1.0, "green")), names=((0.0, "no", "red"), (1.0, "yes", "green")),
    ),
    Panel(
        "Failures of the connection", "Ended connections and failed attempts in five minutes, by reason.",
        ((f"increase(lumpwatch_source_failures_total{{{ROI}}}[5m])", "{{camera}} {{reason}}"),),
    ),
    Panel(
        "Restarts of processes", "Worker processes that were started again in five minutes.",
        ((f"increase(lumpwatch_worker_restarts_total{{{ROI}}}[5m])", "{{camera}} {{process}} {{reason}}"),),
    ),
    Panel(
        "Event log", "Events that wait for the disk, and trouble by reason.",
        (
            (f"lumpwatch_events_waiting{{{ROI}}}", "{{camera}} waiting"),
            (f"increase(lumpwatch_event_log_problems_total{{{ROI}}}[5m])", "{{camera}} {{reason}}"),
        ),
    ),
    Panel(
        "Free disk of the store", "Share of the disk that is free.",
        (('lumpwatch_store_free_ratio{site=~"$site"}', "{{site}}"),), unit="percentunit", most=1.0,
        steps=((None, "red"), (0.1, "green")),
    ),
    Panel(
        "Latency budget", "Share of the budget that the last decision took; above 1 the system alarm follows.",
        ((f"lumpwatch_latency_budget_ratio{{{ROI}}}", "{{camera}}/{{roi}}"),), unit="percentunit",
    ),
    Panel(
        "Picture quality", "Each measure over its threshold; at 1 the picture begins to be unfit.",
        (
            (
                f"lumpwatch_quality_value{{{ROI}}} / lumpwatch_quality_threshold{{{ROI}}} < +Inf",
                "{{camera}}/{{roi}} {{measure}}",
            ),
        ),
    ),
    Panel(
        "Why it cannot see", "The reason of each BLIND region; nothing while all see.",
        ((f"lumpwatch_roi_blind_reason{{{ROI}}} == 1", "{{camera}}/{{roi}} {{reason}}"),), kind="state-timeline",
        steps=((None, "purple"),), names=((1.0, "BLIND", "purple"),),
    ),
    Panel(
        "Proof tests", "Seconds of warning that the last one left, and how many failed in a day.",
        (
            (f"lumpwatch_proof_test_warning_seconds{{{ROI}}}", "{{camera}}/{{roi}} warning"),
            (
                f'increase(lumpwatch_proof_test_outcomes_total{{{ROI}, outcome="failed"}}[1d])',
                "{{camera}}/{{roi}} failed",
            ),
        ),
    ),
    Panel(
        "Evidence", "What it takes of the disk.",
        ((f"lumpwatch_evidence_stored_bytes{{{ROI}}}", "{{camera}}"),), unit="bytes",
    ),
    Panel(
        "Evidence that was not kept, or had to go", "In an hour, by reason.",
        (
            (f"increase(lumpwatch_evidence_problems_total{{{ROI}}}[1h])", "{{camera}} not kept: {{reason}}"),
            (f"increase(lumpwatch_evidence_removed_total{{{ROI}}}[1h])", "{{camera}} removed: {{reason}}"),
        ),
    ),
    Panel(
        "Prior in shadow", "Alarms in a day by who raised them; version 0 means that none runs.",
        (
            (f"increase(lumpwatch_shadow_raised_alarms_total{{{ROI}}}[1d])", "{{camera}}/{{roi}} {{side}}"),
            (f"lumpwatch_shadow_prior_version{{{ROI}}}", "{{camera}}/{{roi}} version"),
        ),
    ),
    Panel(
        "Processor time", "Cores that each process takes.",
        (
            (f"rate(lumpwatch_process_cpu_seconds_total{{{ROI}}}[1m])", "{{camera}} {{process}}"),
            (f'rate(process_cpu_seconds_total{{job="lumpwatch", {SITE}}}[1m])', "{{site}} daemon"),
        ),
    ),
    Panel(
        "Memory", "In RAM; what processes share counts in each.",
        (
            (f"lumpwatch_process_resident_memory_bytes{{{ROI}}}", "{{camera}} {{process}}"),
            (f'process_resident_memory_bytes{{job="lumpwatch", {SITE}}}', "{{site}} daemon"),
        ),
        unit="bytes",
    ),
)  # fmt: skip

FLEET = (
    Panel(
        "Daemons that answer", "Of all that are scraped.",
        ((f'sum(up{{job="lumpwatch", {SITE}}})', "up"), (f'count(up{{job="lumpwatch", {SITE}}})', "all")),
        kind="stat", width=6, height=5,
    ),
    Panel(
        "Blind regions", "Regions that cannot judge now.",
        ((f"sum(lumpwatch_roi_blind{{{SITE}}})", "blind"),), kind="stat", width=6, height=5, steps=BLIND_STEPS,
    ),
    Panel(
        "Lumps now", "Regions whose lump alarm is active.",
        ((f'sum(lumpwatch_alarm_active{{class="lump", {SITE}}})', "lumps"),),
        kind="stat", width=6, height=5, steps=ALARM_STEPS,
    ),
    Panel(
        "Lumps in the last day", "Lump alarms raised, over the fleet.",
        ((f"round(sum(increase({RAISED}, {SITE}}}[1d])))", "lumps"),),
        kind="stat", width=6, height=5,
    ),
    Panel(
        "Every crusher", "One row a region: purple cannot see, red has a lump, nothing means that nobody decides.",
        (
            (
                f'lumpwatch_roi_blind{{{SITE}}} * 2 > 0 or max without (class) '
                f'(lumpwatch_alarm_active{{class="lump", {SITE}}})',
                "{{site}} {{camera}}/{{roi}}",
            ),
        ),
        kind="state-timeline", width=24, height=24, steps=((None, "green"), (1.0, "red"), (2.0, "purple")),
        names=((0.0, "clear", "green"), (1.0, "LUMP", "red"), (2.0, "BLIND", "purple")),
    ),
    Panel(
        "Most lumps, last day", "The ten crushers with the most lump alarms.",
        ((f"sort_desc(topk(10, sum by (site, camera) (increase({RAISED}, {SITE}}}[1d]))))", "{{site}} {{camera}}"),),
        kind="bargauge",
    ),
    Panel(
        "Blind the longest, last day", "The ten regions that could not judge for the largest share of the day.",
        ((f"sort_desc(topk(10, avg_over_time(lumpwatch_roi_blind{{{SITE}}}[1d])))", "{{site}} {{camera}}/{{roi}}"),),
        unit="percentunit", kind="bargauge", most=1.0, steps=((None, "green"), (0.05, "purple")),
    ),
    Panel(
        "Slowest decisions", "99th percentile from frame to decision, the ten slowest.",
        ((f"topk(10, lumpwatch:frame_to_decision_seconds:p99_5m{{{SITE}}})", "{{site}} {{camera}}"),), unit="s",
    ),
    Panel(
        "Versions", "Daemons by version of lumpwatch.",
        ((f"count by (version) (lumpwatch_build_info{{{SITE}}})", "{{version}}"),), kind="bargauge",
    ),
)  # fmt: skip

DASHBOARDS = {
    "operations": ("lumpwatch: operations", "What do I see now?", OPERATIONS),
    "engineering": ("lumpwatch: engineering", "Where does the time go, and what goes wrong?", ENGINEERING),
    "fleet": ("lumpwatch: fleet", "All crushers on one page.", FLEET),
}


def dashboard(name: str) -> dict[str, Any]:
    """One dashboard as Grafana takes it."""
    title, description, panels = DASHBOARDS[name]
    placed, x, y, row = [], 0, 0, 0
    for number, panel in enumerate(panels, 1):
        if x + panel.width > 24:
            x, y, row = 0, y + row, 0
        placed.append(_panel(panel, number, x, y))
        x, row = x + panel.width, max(row, panel.height)
    return {
        "uid": f"lumpwatch-{name}",
        "title": title,
        "description": description,
        "tags": ["lumpwatch"],
        "schemaVersion": 39,
        "refresh": "5s",
        "time": {"from": "now-1h", "to": "now"},
        "templating": {
            "list": [_variable("site"), *([] if name == "fleet" else [_variable("camera", "site")])]
        },
        "links": [
            {
                "title": "lumpwatch",
                "type": "dashboards",
                "tags": ["lumpwatch"],
                "asDropdown": False,
                "includeVars": True,
                "keepTime": True,
            }
        ],
        "annotations": {"list": [_alerts()]},
        "panels": placed,
    }


def _alerts() -> dict[str, Any]:
    """Marks in all panels where an alert fired."""
    return {
        "name": "Alerts",
        "datasource": SOURCE,
        "enable": True,
        "iconColor": "red",
        # The watchdog always fires.
        "expr": f'ALERTS{{alertname=~"Lumpwatch.+", alertname!="LumpwatchWatchdog", alertstate="firing", {SITE}}}',
        "titleFormat": "{{alertname}}",
        "textFormat": "{{site}} {{camera}} {{roi}}",
        "step": "15s",
    }


def _variable(name: str, within: str = "") -> dict[str, Any]:
    chosen = f'{{{within}=~"${within}"}}' if within else ""
    query = f"label_values(lumpwatch_frames_received_total{chosen}, {name})"
    return {
        "name": name,
        "type": "query",
        "datasource": SOURCE,
        "definition": query,
        "query": {"query": query, "refId": name},
        "includeAll": True,
        "multi": True,
        "allValue": ".*",
        "current": {"text": "All", "value": "$__all"},
        "refresh": 2,
        "sort": 1,
    }


def _panel(panel: Panel, number: int, x: int, y: int) -> dict[str, Any]:
    words = {
        "type": "value",
        "options": {f"{value:g}": {"text": word, "color": colour} for value, word, colour in panel.names},
    }
    defaults: dict[str, Any] = {
        "unit": panel.unit,
        "thresholds": {
            "mode": "absolute",
            "steps": [{"value": value, "color": colour} for value, colour in panel.steps],
        },
        "mappings": [words] if panel.names else [],
        "noValue": "nothing",
    }
    if panel.unit == "percentunit":
        defaults["min"] = 0.0
    if panel.most is not None:
        defaults["max"] = panel.most
    return {
        "id": number,
        "type": panel.kind,
        "title": panel.title,
        "description": panel.description,
        "datasource": SOURCE,
        "gridPos": {"x": x, "y": y, "w": panel.width, "h": panel.height},
        "fieldConfig": {"defaults": defaults, "overrides": []},
        "options": {"colorMode": "background"} if panel.kind == "stat" else {},
        "targets": [
            {
                "refId": chr(ord("A") + i),
                "expr": query,
                "legendFormat": legend,
                "datasource": SOURCE,
                # Over a range, topk takes other series at every step.
                "instant": panel.kind in NOW,
                "range": panel.kind not in NOW,
            }
            for i, (query, legend) in enumerate(panel.queries)
        ],
    }


def text(name: str) -> str:
    """The file of a dashboard."""
    return json.dumps(dashboard(name), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    HERE.mkdir(exist_ok=True)
    for name in DASHBOARDS:
        (HERE / f"{name}.json").write_text(text(name), encoding="utf-8")
