"""MQTT and Sparkplug B against Debian's mosquitto, read by its own client and by another implementation."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.core import AlarmState, Decision
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.gateway.sparkplug import BOOLEAN, DOUBLE, UINT64, Metric, decode, encode
from tests.bus.test_bus_support import eventually
from tests.gateway.site import CONFIG, Gateway, Plant, config, lump
from tests.integration.site import free_port

BROKER = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
needs_broker = pytest.mark.skipif(
    BROKER is None or shutil.which("mosquitto_sub") is None, reason="Debian's mosquitto is not installed"
)
GATEWAY = "{{mqtt: {{broker: '127.0.0.1:{port}', commands: true, sparkplug: {{group: quarry, node: gate}}}}}}"


class Mosquitto:
    """A broker that can be stopped and started."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        self._config.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence false\n")
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [str(BROKER), "-c", str(self._config)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()


class Subscriber:
    """mosquitto_sub: what it has received, as (topic, payload, whether retained)."""

    def __init__(self, port: int, topic: str) -> None:
        self.got: list[tuple[str, bytes, bool]] = []
        self._process = subprocess.Popen(
            ["mosquitto_sub", "-p", str(port), "-t", topic, "-q", "1", "-F", "%t %x %r"],
            stdout=subprocess.PIPE,
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            topic, payload, retained = line.decode().rstrip("\n").rsplit(" ", 2)
            self.got.append((topic, bytes.fromhex(payload), retained == "1"))

    def last(self, topic: str) -> Any:
        found = [payload for name, payload, _ in self.got if name == topic]
        return json.loads(found[-1]) if found else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()
        self._thread.join()


def wait_until_there(broker: Mosquitto) -> None:
    probe = ["mosquitto_pub", "-p", str(broker.port), "-t", "x", "-m", "1"]
    eventually(lambda: subprocess.run(probe, capture_output=True).returncode == 0)


def publish(port: int, topic: str, message: bytes, *more: str) -> None:
    subprocess.run(
        ["mosquitto_pub", "-p", str(port), "-t", topic, "-s", *more], input=message, check=True, timeout=20
    )


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Plant, Gateway, Mosquitto]]:
    folder = tmp_path_factory.mktemp("mqtt")
    broker = Mosquitto(folder)
    try:
        with Plant() as plant:
            file = folder / "site.yaml"
            file.write_text(CONFIG.format(endpoint=plant.endpoint, gateway=GATEWAY.format(port=broker.port)))
            with Gateway(file, "mqtt") as gateway:
                yield plant, gateway, broker
    finally:
        broker.stop()


STATE = "lumpwatch/pit/cam/apron/state"


@needs_broker
def test_states_are_retained_and_alarms_come_as_events(live: tuple[Plant, Gateway, Mosquitto]) -> None:
    plant, _, broker = live
    with Subscriber(broker.port, "lumpwatch/#") as first:
        eventually(lambda: (first.last(STATE) or {}).get("quality") == "GOOD")
    with Subscriber(broker.port, "lumpwatch/#") as late:
        eventually(lambda: late.last(STATE))
        assert late.got[0][2]
        assert late.last("lumpwatch/pit/status") == {"online": True}
        state = late.last(STATE)
        assert (state["decision"], state["clear"], state["count"], state["lip_s"]) == ("CLEAR", True, 0, None)
        eventually(lambda: late.last(STATE)["heartbeat"] != state["heartbeat"])
        plant.decision, plant.objects = Decision.LUMP, (lump(),)
        plant.raise_alarm()
        eventually(lambda: late.last("lumpwatch/pit/cam/apron/alarm"))
        event = late.last("lumpwatch/pit/cam/apron/alarm")
        assert (event["specversion"], event["data"]["state"]) == ("1.0", "UNACKNOWLEDGED")
        eventually(lambda: late.last(STATE)["largest_mm"] == 812.0)
        publish(broker.port, "lumpwatch/pit/cam/apron/set/ack", b"1")
        eventually(lambda: late.last(STATE)["alarms"]["lump"] == "ACKNOWLEDGED")
        plant.decision, plant.objects, plant.alarms = Decision.CLEAR, (), {}


@needs_broker
def test_what_is_no_command_and_what_was_retained_does_nothing(
    live: tuple[Plant, Gateway, Mosquitto],
) -> None:
    plant, gateway, broker = live
    done = len(plant.deeds)
    root = "lumpwatch/pit/cam/apron/set"
    for topic, message in ((f"{root}/ack", b"yes"), (f"{root}/none", b"1"), ("lumpwatch/pit/x/y/set/ack", b"1"),
                           ("spBv1.0/quarry/NCMD/gate", b"\xff" * 40)):  # fmt: skip
        publish(broker.port, topic, message, "-q", "1")
    eventually(lambda: gateway.log.count("expected a coil") == 3 and "not a payload" in gateway.log)
    assert plant.deeds[done:] == []


@needs_broker
def test_sparkplug_is_understood_by_another_implementation(live: tuple[Plant, Gateway, Mosquitto]) -> None:
    sparkplug = pytest.importorskip("pysparkplug", reason="pysparkplug is not installed")
    plant, _, broker = live
    with Subscriber(broker.port, "spBv1.0/#") as host:
        rebirth = sparkplug.NCmd(
            timestamp=1,
            metrics=(
                sparkplug.Metric(
                    timestamp=1, name="Node Control/Rebirth", datatype=sparkplug.DataType.BOOLEAN, value=True
                ),
            ),
        )

        def born() -> bool:
            publish(broker.port, "spBv1.0/quarry/NCMD/gate", rebirth.encode(include_dtypes=True))
            return any(topic == "spBv1.0/quarry/NBIRTH/gate" for topic, _, _ in host.got)

        eventually(born)
        birth = sparkplug.NBirth.decode(next(p for topic, p, _ in host.got if "NBIRTH" in topic))
        metrics = {metric.name: metric for metric in birth.metrics}
        assert birth.seq == 0
        assert {"bdSeq", "heartbeat", "cam/apron/quality", "cam/apron/ack"} <= set(metrics)
        assert metrics["cam/apron/quality"].value == 192
        assert metrics["cam/apron/existence"].value == pytest.approx(0.02)
        assert metrics["cam/apron/lip"].value is None
        assert metrics["cam/apron/lip"].is_null

        def data() -> list[bytes]:
            """What came after the newest birth: each rebirth that was asked for, answered late or not, counts anew."""
            got = list(host.got)
            newest = max(i for i, (topic, _, _) in enumerate(got) if "NBIRTH" in topic)
            return [p for topic, p, _ in got[newest + 1 :] if "NDATA" in topic]

        plant.decision, plant.objects = Decision.LUMP, (lump(),)
        eventually(lambda: len(data()) > 10)
        told = [sparkplug.NData.decode(p, birth=birth) for p in data()]
        assert [one.seq for one in told[:5]] == [1, 2, 3, 4, 5]
        newest = sparkplug.NBirth.decode([p for topic, p, _ in host.got if "NBIRTH" in topic][-1])
        names = {metric.name: metric.value for one in (newest, *told) for metric in one.metrics}
        assert names["cam/apron/largest"] == 812
        assert names["cam/apron/decision"] == 2
        plant.decision, plant.objects = Decision.CLEAR, ()


@needs_broker
def test_a_broker_that_comes_back_is_told_everything_anew(live: tuple[Plant, Gateway, Mosquitto]) -> None:
    plant, _, broker = live
    broker.stop()
    plant.raise_alarm(AlarmState.UNACKNOWLEDGED)  # waits for the broker
    broker.start()
    wait_until_there(broker)
    with Subscriber(broker.port, "#") as sub:
        eventually(lambda: sub.last(STATE) and sub.last("lumpwatch/pit/status") == {"online": True})
        eventually(lambda: any("NBIRTH" in topic or "NDATA" in topic for topic, _, _ in sub.got))
        eventually(lambda: sub.last("lumpwatch/pit/cam/apron/alarm"))


@needs_broker
def test_the_last_will_says_offline_and_dead(tmp_path: Path) -> None:
    sparkplug = pytest.importorskip("pysparkplug", reason="pysparkplug is not installed")
    broker = Mosquitto(tmp_path)
    try:
        with Plant() as plant:
            file = tmp_path / "site.yaml"
            file.write_text(CONFIG.format(endpoint=plant.endpoint, gateway=GATEWAY.format(port=broker.port)))
            wait_until_there(broker)
            publish(broker.port, "lumpwatch/pit/cam/apron/set/ack", b"1", "-r")
            with Subscriber(broker.port, "#") as sub:
                gateway = Gateway(file, "mqtt")
                gateway.start()
                eventually(lambda: sub.last(STATE) and any("NBIRTH" in topic for topic, _, _ in sub.got))
                eventually(lambda: "set/ack is retained: not taken" in gateway.log)
                assert plant.deeds == []
                gateway.process.kill()
                gateway.process.wait()
                eventually(lambda: sub.last("lumpwatch/pit/status") == {"online": False})
                eventually(lambda: any("NDEATH" in topic for topic, _, _ in sub.got))
                born, died = (
                    next(p for topic, p, _ in sub.got if kind in topic) for kind in ("NBIRTH", "NDEATH")
                )
                of_birth = {m.name: m.value for m in sparkplug.NBirth.decode(born).metrics}["bdSeq"]
                assert decode_bdseq(died) == of_birth
    finally:
        broker.stop()


def decode_bdseq(payload: bytes) -> int:
    """By the schema that pysparkplug carries."""
    schema = pytest.importorskip("pysparkplug._protobuf")
    found = schema.Payload.FromString(payload)
    assert not found.HasField("seq")
    (metric,) = found.metrics
    return int(metric.long_value)


@given(
    st.lists(
        st.builds(
            Metric,
            st.one_of(st.none(), st.integers(0, 2**63)),
            st.just(UINT64),
            st.one_of(st.none(), st.text(max_size=40)),
            st.one_of(st.none(), st.integers(0, 2**40)),
        )
        | st.builds(
            Metric, st.one_of(st.none(), st.floats(allow_nan=False)), st.just(DOUBLE), st.text(max_size=9)
        )
        | st.builds(Metric, st.booleans(), st.just(BOOLEAN), st.text(max_size=9)),
        max_size=8,
    ),
    st.integers(0, 2**50),
    st.integers(0, 255),
)
def test_what_is_encoded_is_what_the_published_schema_reads(
    metrics: list[Metric], time_ms: int, seq: int
) -> None:
    schema = pytest.importorskip("pysparkplug._protobuf", reason="pysparkplug is not installed")
    payload = schema.Payload.FromString(encode(metrics, time_ms, seq))
    assert (payload.timestamp, payload.seq, len(payload.metrics)) == (time_ms, seq, len(metrics))
    for mine, read in zip(metrics, payload.metrics, strict=True):
        assert (read.name if read.HasField("name") else None) == mine.name
        assert (read.alias if read.HasField("alias") else None) == mine.alias
        assert read.is_null == (mine.value is None)
        if mine.value is not None:
            field = {UINT64: read.long_value, DOUBLE: read.double_value, BOOLEAN: read.boolean_value}
            assert field[mine.datatype] == mine.value


@given(st.binary(max_size=80))
def test_rubbish_is_refused_or_read_and_nothing_else(payload: bytes) -> None:
    with contextlib.suppress(ValueError):
        decode(payload)


def test_a_broker_elsewhere_needs_tls() -> None:
    with pytest.raises(ConfigError, match=r"gateway\.mqtt: a broker on another host needs tls"):
        config("{mqtt: {broker: '10.0.0.9:1883'}}")
    assert config("{mqtt: {broker: '10.0.0.9:1883', insecure: true}}").gateway.mqtt is not None
