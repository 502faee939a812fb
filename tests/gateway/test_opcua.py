"""OPC UA by real clients, over a policy that encrypts, with users: asyncua as the server is, and open62541."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import shutil
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.core import Decision
from lumpwatch.service.errors import ConfigError
from tests.bus.test_bus_access import make
from tests.bus.test_bus_support import eventually as wait_until
from tests.gateway.open62541 import Open62541
from tests.gateway.site import CONFIG, Gateway, Plant, config, lump
from tests.integration.site import free_port

asyncua = pytest.importorskip("asyncua", reason="asyncua is not installed")
pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
URI = "urn:lumpwatch:pit:gateway"


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Plant, Gateway, Path]]:
    folder = tmp_path_factory.mktemp("opcua")
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("URI", URI)
        make(folder / "certs", "gateway", "localhost")
        environment.setenv("URI", "urn:test:client")
        client = make(folder / "certs", "hmi", "localhost")
        shutil.copy(client.key, folder / "certs/hmi-key.pem")  # the client goes by the name
    opcua = (
        f"{{opcua: {{listen: '127.0.0.1:{free_port()}', certificate: certs/gateway.pem, key: certs/gateway.key, "
        "users: {hmi: secret}}}"
    )
    with Plant() as plant:
        file = folder / "site.yaml"
        file.write_text(CONFIG.format(endpoint=plant.endpoint, gateway=opcua))
        with Gateway(file, "opcua") as gateway:
            yield plant, gateway, folder


@contextlib.asynccontextmanager
async def session(live: tuple[Plant, Gateway, Path], user: str | None = None, password: str = "") -> Any:
    _, gateway, folder = live
    client = asyncua.Client(gateway.address, timeout=15)
    client.application_uri = "urn:test:client"
    certificate, key = folder / "certs/hmi.pem", folder / "certs/hmi-key.pem"
    await client.set_security_string(f"Basic256Sha256,SignAndEncrypt,{certificate},{key}")
    if user is not None:
        client.set_user(user)
        client.set_password(password)
    async with client:
        yield client


def run_apart(work: Coroutine[Any, Any, None]) -> None:
    """In a thread of its own: where a browser was driven before, this one has a loop that runs."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, work).result()


async def eventually(condition: Callable[[], Awaitable[object]]) -> None:
    for _ in range(300):
        if await condition():
            return
        await asyncio.sleep(0.05)
    raise AssertionError("what was waited for did not come")


def node(client: Any, name: str) -> Any:
    return client.get_node(f"ns=2;s={name}")


async def value(client: Any, name: str) -> Any:
    return await node(client, f"cam/apron/{name}").read_data_value(raise_on_bad_status=False)


def told(found: Any) -> Any:
    """The value; None: there is none."""
    return found.Value.Value


def test_values_carry_status_and_source_time(live: tuple[Plant, Gateway, Path]) -> None:
    plant = live[0]

    async def look() -> None:
        async with session(live) as client:

            async def good() -> bool:
                return (await value(client, "quality")).Value.Value == 192

            await eventually(good)
            existence, lip = await value(client, "existence"), await value(client, "lip")
            assert existence.Value.Value == pytest.approx(0.02)
            assert existence.StatusCode.is_good()
            assert existence.SourceTimestamp is not None
            assert (told(lip), lip.StatusCode.name) == (None, "BadNoData")
            plant.decision, plant.objects = Decision.LUMP, (lump(),)

            async def large() -> bool:
                return told(await value(client, "largest")) == 812

            await eventually(large)
            plant.decision, plant.objects = Decision.CLEAR, ()

            async def none() -> bool:
                return told(await value(client, "largest")) is None

            await eventually(none)
            assert (await value(client, "largest")).StatusCode.name == "BadNoData"
            before = (await value(client, "heartbeat")).Value.Value

            async def beats() -> bool:
                return (await value(client, "heartbeat")).Value.Value != before

            await eventually(beats)
            plant.beating = False

            async def silent() -> bool:
                return (await value(client, "quality")).Value.Value == 0

            await eventually(silent)
            lost = await value(client, "existence")
            assert lost.StatusCode.name == "BadNoCommunication"
            assert told(lost) is None
            plant.beating = True
            await eventually(good)

    run_apart(look())


def test_by_open62541_a_client_of_other_make_sees_the_same_acknowledges_and_writes_nothing(
    live: tuple[Plant, Gateway, Path],
) -> None:
    if importlib.util.find_spec("o6") is None:
        pytest.skip("o6 is not installed: pip install o6")
    plant, gateway, folder = live
    names = ("quality", "existence", "largest", "heartbeat")

    with Open62541(gateway.address, folder / "certs", "hmi", "hmi", "secret") as client:

        def read() -> dict[str, dict[str, Any]]:
            return dict(
                zip(names, client.ask("read", *(f"ns=2;s=cam/apron/{one}" for one in names)), strict=True)
            )

        wait_until(lambda: read()["quality"]["value"] == 192)
        first = read()
        assert first["existence"] == {"value": pytest.approx(0.02), "status": 0, "dated": True}
        assert (first["largest"]["value"], first["largest"]["status"]) == (
            None,
            asyncua.ua.StatusCodes.BadNoData,
        )
        wait_until(lambda: read()["heartbeat"]["value"] > first["heartbeat"]["value"])
        plant.decision, plant.objects = Decision.LUMP, (lump(),)
        wait_until(lambda: read()["largest"]["value"] == 812)
        assert client.ask("call", "ns=2;s=cam/apron", "acknowledge", "lump") == [0, ""]
        assert plant.deeds[-1] == ("ack", {"actor": "plc", "class": "lump"})
        assert client.ask("write", "ns=2;s=cam/apron/quality", 0) == "BAD_USER_ACCESS_DENIED"
        plant.beating = False
        wait_until(lambda: read()["quality"]["value"] == 0)
        lost = read()["existence"]
        assert (lost["value"], lost["status"]) == (None, asyncua.ua.StatusCodes.BadNoCommunication)
        plant.beating = True
    plant.decision, plant.objects, plant.alarms = Decision.CLEAR, (), {}


def test_users_acknowledge_and_shelve_and_others_only_read(live: tuple[Plant, Gateway, Path]) -> None:
    plant = live[0]
    ua = asyncua.ua

    async def act() -> None:
        async with session(live, "hmi", "secret") as client:
            region = node(client, "cam/apron")
            await region.call_method("2:acknowledge", "lump")
            await region.call_method("2:shelve", "blind", "dust", 60.0)
            with pytest.raises(ua.UaStatusCodeError):
                await region.call_method("2:acknowledge", "nonsense")
            with pytest.raises(ua.UaStatusCodeError):
                await node(client, "cam/apron/quality").write_value(192)
        async with session(live) as client:
            with pytest.raises(ua.UaError):
                await node(client, "cam/apron").call_method("2:acknowledge", "lump")
        with pytest.raises(ua.UaError):
            async with session(live, "hmi", "wrong"):
                pass

    done = len(plant.deeds)
    run_apart(act())
    assert plant.deeds[done:] == [
        ("ack", {"actor": "plc", "class": "lump"}),
        ("shelve", {"actor": "plc", "class": "blind", "reason": "dust", "for_s": 60.0}),
    ]


def test_alarms_are_events(live: tuple[Plant, Gateway, Path]) -> None:
    plant = live[0]
    seen: list[Any] = []

    class Handler:
        def event_notification(self, event: Any) -> None:
            seen.append(event)

    async def listen() -> None:
        async with session(live) as client:
            subscription = await client.create_subscription(100, Handler())
            await subscription.subscribe_events()
            plant.decision, plant.objects = Decision.LUMP, (lump(),)
            plant.raise_alarm()

            async def came() -> bool:
                return any("UNACKNOWLEDGED" in event.Message.Text for event in seen)

            await eventually(came)

    run_apart(listen())
    event = next(event for event in seen if "UNACKNOWLEDGED" in event.Message.Text)
    assert (event.SourceName, event.Severity) == ("cam/apron", 700)
    plant.decision, plant.objects, plant.alarms = Decision.CLEAR, (), {}


def test_without_a_policy_nobody_comes_in(live: tuple[Plant, Gateway, Path]) -> None:
    async def plain() -> None:
        async with asyncua.Client(live[1].address, timeout=5):
            pass

    with pytest.raises((asyncua.ua.UaError, ConnectionError, asyncio.TimeoutError)):
        run_apart(plain())


def test_an_address_that_others_reach_needs_a_certificate() -> None:
    with pytest.raises(ConfigError, match=r"gateway\.opcua: an address that others reach needs certificate"):
        config("{opcua: {listen: '0.0.0.0:4840'}}")
