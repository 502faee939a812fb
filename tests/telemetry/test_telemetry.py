"""Metrics and health: names and labels, the relay over restarts, and the HTTP endpoints."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from lumpwatch.service.core.alarm import Alarm, AlarmClass, AlarmState, Change, Hold, Transition
from lumpwatch.service.core.decision import Decision
from lumpwatch.service.core.detection import DetectedObject, Detection
from lumpwatch.service.telemetry import CameraMetrics, DaemonMetrics, MonitorMetrics
from lumpwatch.service.telemetry.http import TelemetryError, TelemetryServer
from lumpwatch.service.telemetry.relay import Relay


def _camera(registry: CollectorRegistry) -> None:
    metrics = CameraMetrics(registry, "cam")
    metrics.attempt()
    metrics.connected()
    metrics.received(1.7e9)
    metrics.failed("read_timeout")
    metrics.dropped("corrupt", 3)
    metrics.stage("publish", "", 0.003)


def _monitor(registry: CollectorRegistry) -> None:
    metrics = MonitorMetrics(registry, "cam", ("apron", "chute"))
    shares = (("belt", 0.75), ("fall", 0.25))
    found = DetectedObject(7, 0.0, 0.0, 9.0, 9.0, 1.0, 1.0, 0.97, "belt", shares, wrong_way=True)
    other = replace(found, id=8, model_shares=(("belt", 0.25), ("fall", 0.75)), wrong_way=False)
    metrics.decided("apron", 0.012, Detection(0.97, (found, other), 850.0, 0.1))
    metrics.decided("apron", 0.012, Detection(0.97, (found, other), 850.0, 0.1))
    alarms = {AlarmClass.LUMP: Alarm(active=True, waits=True), AlarmClass.BLIND: Alarm()}
    metrics.state("apron", Decision.LUMP, 0.97, alarms)
    raised = Transition(Change.RAISED, AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, 1.0)
    metrics.transition("apron", AlarmClass.LUMP, raised)
    for reason in ("latency", "feed_signal"):
        told = Transition(Change.RAISED, AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, 1.0, reason=reason)
        metrics.transition("chute", AlarmClass.SYSTEM, told)
    metrics.refused("chute", "ack")
    metrics.events_written(3)
    metrics.events_waiting(1)
    metrics.event_problem("unwritable")
    metrics.event_problem("lost", 2)
    metrics.prior("apron", 4, 60.0)
    metrics.prior_refused("chute", "unfit")
    metrics.dropped("late")
    metrics.stage("filter", "apron", 0.004)


def _daemon(registry: CollectorRegistry) -> None:
    DaemonMetrics(registry, "1.2.3", Path("none/yet")).restarted("cam", "monitor", "stuck")


def _whole(registry: CollectorRegistry) -> None:
    """The daemon's own and what its workers sent."""
    _daemon(registry)
    relay = Relay()
    registry.register(relay)
    for name, fill in (("camera:cam", _camera), ("monitor:cam", _monitor)):
        relay.update(name, text_of(fill))


Fill = Callable[[CollectorRegistry], None]
PROCESSES: dict[str, Fill] = {
    "camera": _camera,
    "monitor": _monitor,
    "daemon": _daemon,
    "whole": _whole,
}


def text_of(fill: Fill) -> str:
    registry = CollectorRegistry()
    fill(registry)
    return generate_latest(registry).decode()


def values(text: str) -> dict[tuple[str, ...], float]:
    """Samples by name and label values in the order of the labels' names, without `_created`."""
    return {
        (sample.name, *(sample.labels[label] for label in sorted(sample.labels))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if not sample.name.endswith("_created")
    }


# Names and labels


LABELS = {
    "camera", "roi", "stage", "class", "reason", "model", "le", "version", "process", "change", "command", "side",
    "outcome",
}  # fmt: skip
"""Each means one thing in all metrics."""


@pytest.mark.parametrize("process", PROCESSES)
def test_labels_are_few_and_names_are_ours(process: str) -> None:
    text = text_of(PROCESSES[process])
    samples = [s for family in text_string_to_metric_families(text) for s in family.samples]
    assert len(samples) > 2
    for sample in samples:
        assert sample.name.startswith(("lumpwatch_", "process_"))
        assert set(sample.labels) <= LABELS
        assert ("version" in sample.labels) is (sample.name == "lumpwatch_build_info")


@pytest.mark.system
@pytest.mark.parametrize("process", PROCESSES)
def test_promtool_finds_nothing_to_complain_of(process: str) -> None:
    if (promtool := shutil.which("promtool")) is None:
        pytest.skip("promtool is not installed (Debian package prometheus)")
    done = subprocess.run(
        [promtool, "check", "metrics"],
        input=text_of(PROCESSES[process]),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_what_the_camera_counts() -> None:
    found = values(text_of(_camera))
    assert found["lumpwatch_frames_received_total", "cam"] == 1
    assert found["lumpwatch_source_connect_attempts_total", "cam"] == 1
    assert found["lumpwatch_source_failures_total", "cam", "read_timeout"] == 1
    assert found["lumpwatch_source_connected", "cam"] == 0
    assert found["lumpwatch_last_frame_timestamp_seconds", "cam"] == 1.7e9
    assert found["lumpwatch_frames_dropped_total", "cam", "corrupt"] == 3


def test_what_the_monitor_counts() -> None:
    found = values(text_of(_monitor))
    assert found["lumpwatch_frames_processed_total", "cam", "apron"] == 2
    assert found["lumpwatch_objects", "cam", "apron"] == 2
    assert found["lumpwatch_model_share_ratio", "cam", "belt", "apron"] == 0.5
    assert found["lumpwatch_wrong_way_objects_total", "cam", "apron"] == 1  # once an object, not once a frame
    assert found["lumpwatch_wrong_way_objects_total", "cam", "chute"] == 0
    assert found["lumpwatch_frames_processed_total", "cam", "chute"] == 0
    assert found["lumpwatch_existence_ratio", "cam", "apron"] == 0.97
    assert found["lumpwatch_alarm_active", "cam", "lump", "apron"] == 1
    assert found["lumpwatch_alarm_active", "cam", "blind", "apron"] == 0
    assert found["lumpwatch_alarm_unacknowledged", "cam", "lump", "apron"] == 1
    assert found["lumpwatch_alarm_changes_total", "cam", "raised", "lump", "apron"] == 1
    assert found["lumpwatch_alarm_changes_total", "cam", "raised", "blind", "apron"] == 0
    assert found["lumpwatch_alarm_changes_total", "cam", "raised", "lump", "chute"] == 0
    assert found["lumpwatch_alarm_reason", "cam", "system", "latency", "chute"] == 0
    assert found["lumpwatch_alarm_reason", "cam", "system", "feed_signal", "chute"] == 1
    assert found["lumpwatch_commands_refused_total", "cam", "ack", "chute"] == 1
    assert found["lumpwatch_events_written_total", "cam"] == 3
    assert found["lumpwatch_events_waiting", "cam"] == 1
    assert found["lumpwatch_event_log_problems_total", "cam", "unwritable"] == 1
    assert found["lumpwatch_event_log_problems_total", "cam", "lost"] == 2
    assert found["lumpwatch_event_log_problems_total", "cam", "corrupt"] == 0
    assert found["lumpwatch_roi_blind", "cam", "apron"] == 0
    assert found["lumpwatch_roi_blind", "cam", "chute"] == 1
    assert found["lumpwatch_prior_version", "cam", "apron"] == 4
    assert found["lumpwatch_prior_problems_total", "cam", "unfit", "chute"] == 1


HOLD = Hold("Ada", "dust")
GAUGES = ("active", "unacknowledged", "shelved", "suppressed", "out_of_service")


@pytest.mark.parametrize("alarm_class", AlarmClass)
@pytest.mark.parametrize(
    ("alarm", "expected"),
    [
        (Alarm(), (0, 0, 0, 0, 0)),
        (Alarm(active=True, waits=True), (1, 1, 0, 0, 0)),
        (Alarm(active=True), (1, 0, 0, 0, 0)),
        (Alarm(waits=True), (0, 1, 0, 0, 0)),
        (Alarm(active=True, shelved=HOLD), (1, 0, 1, 0, 0)),
        (Alarm(suppressed=(HOLD,), out_of_service=HOLD), (0, 0, 0, 1, 1)),
    ],
)
def test_alarm_states_as_gauges(alarm_class: AlarmClass, alarm: Alarm, expected: tuple[int, ...]) -> None:
    registry = CollectorRegistry()
    metrics = MonitorMetrics(registry, "cam", ("apron",))
    metrics.state("apron", Decision.CLEAR, 0.1, {alarm_class: alarm})
    labels = {"camera": "cam", "roi": "apron", "class": alarm_class.value}
    found = tuple(registry.get_sample_value(f"lumpwatch_alarm_{name}", labels) for name in GAUGES)
    assert found == expected


# The relay


class Worker:
    """One life of a worker process: its counts begin at zero."""

    def __init__(self, camera: str) -> None:
        self._registry = CollectorRegistry()
        labels = ("camera",)
        self.events = Counter("events", "E.", labels, registry=self._registry).labels(camera)
        self.level = Gauge("level", "L.", labels, registry=self._registry).labels(camera)
        self.time = Histogram(
            "time_seconds", "T.", labels, buckets=(0.1, 1.0), registry=self._registry
        ).labels(camera)

    def text(self) -> str:
        return generate_latest(self._registry).decode()


def scraped(relay: Relay) -> dict[tuple[str, ...], float]:
    registry = CollectorRegistry()
    registry.register(relay)
    return values(generate_latest(registry).decode())


def test_two_workers_are_shown_as_one() -> None:
    relay = Relay()
    assert scraped(relay) == {}
    for name, count in (("a", 2), ("b", 5)):
        worker = Worker(name)
        worker.events.inc(count)
        worker.level.set(count / 10)
        relay.update(name, worker.text())
    found = scraped(relay)
    assert found["events_total", "a"] == 2
    assert found["events_total", "b"] == 5
    assert found["level", "a"] == 0.2
    assert found["level", "b"] == 0.5


def shown_families() -> list[str]:
    relay = Relay()
    for name in ("a", "b"):
        relay.update(name, Worker(name).text())
    return [family.name for family in relay.collect()]


def test_each_family_is_shown_once() -> None:
    names = shown_families()
    assert len(names) == len(set(names))
    assert {"events", "level", "time_seconds"} <= set(names)


def test_no_family_is_shown_empty() -> None:
    assert sorted(shown_families()) == ["events", "level", "time_seconds"]


def test_the_newest_text_counts() -> None:
    relay, worker = Relay(), Worker("a")
    worker.events.inc()
    relay.update("a", worker.text())
    worker.events.inc()
    relay.update("a", worker.text())
    assert scraped(relay)["events_total", "a"] == 2


def test_a_silent_worker_shows_what_it_counted_and_no_gauge() -> None:
    relay, worker = Relay(), Worker("a")
    worker.events.inc(4)
    worker.level.set(0.7)
    worker.time.observe(0.5)
    relay.update("a", worker.text())
    relay.silent("a")
    relay.silent("a")
    found = scraped(relay)
    assert ("level", "a") not in found
    assert (found["events_total", "a"], found["time_seconds_count", "a"]) == (4, 1)
    relay.update("a", worker.text())  # it was only slow
    found = scraped(relay)
    assert (found["level", "a"], found["events_total", "a"]) == (0.7, 4)
    relay.silent("a")
    relay.gone("a")
    relay.update("a", Worker("a").text())  # its successor
    found = scraped(relay)
    assert (found["level", "a"], found["events_total", "a"]) == (0.0, 4)


def test_counters_go_on_over_restarts_and_gauges_are_forgotten() -> None:
    relay, worker = Relay(), Worker("a")
    worker.events.inc(4)
    worker.level.set(0.7)
    for seconds in (0.05, 0.5, 5.0):
        worker.time.observe(seconds)
    relay.update("a", worker.text())
    relay.gone("a")
    relay.gone("a")  # said twice, counted once
    assert ("level", "a") not in scraped(relay)
    worker = Worker("a")
    worker.events.inc(3)
    worker.time.observe(0.5)
    relay.update("a", worker.text())
    found = scraped(relay)
    assert found["events_total", "a"] == 7
    assert found["level", "a"] == 0.0
    buckets = [found["time_seconds_bucket", "a", le] for le in ("0.1", "1.0", "+Inf")]
    assert buckets == [1, 3, 4]
    assert found["time_seconds_count", "a"] == 4
    assert found["time_seconds_sum", "a"] == pytest.approx(6.05)
    relay.gone("a")
    relay.update("a", Worker("a").text())
    assert scraped(relay)["events_total", "a"] == 7


def test_a_worker_that_said_nothing_may_be_gone() -> None:
    relay = Relay()
    relay.gone("a")
    assert scraped(relay) == {}


# HTTP


class Health:
    """A daemon as healthy as a test wants it."""

    def __init__(self) -> None:
        self.problems: dict[str, list[str]] = {"live": [], "ready": [], "started": []}

    def live(self) -> list[str]:
        return self.problems["live"]

    def ready(self) -> list[str]:
        return self.problems["ready"]

    def started(self) -> list[str]:
        return self.problems["started"]


def get(url: str) -> tuple[int, str, str]:
    """Status, content type and body."""
    try:
        with urllib.request.urlopen(url, timeout=30) as answer:
            return answer.status, answer.headers["Content-Type"], answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers["Content-Type"], error.read().decode()


def server(health: Health | None = None) -> TelemetryServer:
    registry = CollectorRegistry()
    _whole(registry)
    return TelemetryServer(("127.0.0.1", 0), registry, health or Health())


def test_metrics_are_served() -> None:
    with server() as served:
        status, kind, body = get(f"{served.url}/metrics?collect[]=all")
    assert status == 200
    assert kind.startswith("text/plain")
    assert values(body)["lumpwatch_frames_dropped_total", "cam", "late"] == 1


@pytest.mark.parametrize(("path", "check"), [("livez", "live"), ("readyz", "ready"), ("startupz", "started")])
def test_health_is_judged_each_by_its_own(path: str, check: str) -> None:
    health = Health()
    with server(health) as served:
        status, kind, body = get(f"{served.url}/{path}")
        assert (status, kind, json.loads(body)) == (200, "application/json", {"ok": True, "problems": []})
        for other in health.problems:
            health.problems[other] = ["cam/apron: has not decided yet"] if other != check else []
        assert get(f"{served.url}/{path}")[0] == 200
        health.problems[check] = ["one thing", "another"]
        status, _, body = get(f"{served.url}/{path}")
        assert status == 503
        assert json.loads(body) == {"ok": False, "problems": ["one thing", "another"]}


def test_other_paths_are_not_found() -> None:
    with server() as served:
        status, _, body = get(f"{served.url}/healthz")
    assert status == 404
    assert "/readyz" in body


def test_a_silent_client_does_not_hold_up_others() -> None:
    with server() as served:
        host, port = served.url.removeprefix("http://").split(":")
        with socket.create_connection((host, int(port))):
            assert get(f"{served.url}/livez")[0] == 200


def test_a_port_in_use_is_named_in_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(TelemetryError) as caught:
            TelemetryServer(("127.0.0.1", port), CollectorRegistry(), Health())
    assert str(caught.value).startswith(f"telemetry.listen 127.0.0.1:{port}: ")
    assert "\n" not in str(caught.value)


def test_an_address_of_another_machine_is_named_in_one_line() -> None:
    with pytest.raises(TelemetryError, match=r"^telemetry\.listen 192\.0\.2\.1:0: "):
        TelemetryServer(("192.0.2.1", 0), CollectorRegistry(), Health())


def test_ipv6() -> None:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        pytest.skip("this machine has no IPv6")
    with TelemetryServer(("::1", 0), CollectorRegistry(), Health()) as served:
        assert get(f"{served.url}/livez")[0] == 200


def test_the_port_is_free_again_afterwards() -> None:
    with server() as served:
        port = int(served.url.rpartition(":")[2])
    with TelemetryServer(("127.0.0.1", port), CollectorRegistry(), Health()) as again:
        assert get(f"{again.url}/livez")[0] == 200
