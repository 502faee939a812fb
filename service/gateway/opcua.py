"""OPC UA: the values as variables with status and source time, methods for acknowledge and shelve, events for alarms.

One object a region, named CAMERA/ROI, with the names of the register map. What judges (`state`, `quality`,
`quality_reason`, `heartbeat`) is always Good; the other values carry the quality as their StatusCode, and are null
where they are not available. Events are plain ones with the record as their message, not OPC UA's state machine of
alarms and conditions.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import logging
from datetime import UTC, datetime
from typing import Any

from asyncua import Node, Server, ua
from asyncua.crypto.permission_rules import USER_TYPES, PermissionRuleset, User, UserRole

from lumpwatch.service.config import OpcUaConfig
from lumpwatch.service.core import AlarmClass
from lumpwatch.service.gateway.errors import GatewayError
from lumpwatch.service.gateway.orders import Ask
from lumpwatch.service.gateway.register_map import RegisterMap
from lumpwatch.service.gateway.values import RegionValues, SiteValues, Why

log = logging.getLogger(__name__)
logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # what clients do wrong is theirs

NAMESPACE = "urn:lumpwatch"
MOST_CONNECTIONS = 32
_JUDGES = ("state", "quality", "quality_reason", "heartbeat")
_SEVERITY = {"critical": 900, "high": 700, "medium": 500, "low": 200}
_STATUS = {
    Why.GOOD: ua.StatusCodes.Good,
    Why.STARTING: ua.StatusCodes.BadWaitingForInitialData,
    Why.NO_BUS: ua.StatusCodes.BadNoCommunication,
    Why.PROCESS_GONE: ua.StatusCodes.BadNoCommunication,
    Why.HEARTBEAT_EXPIRED: ua.StatusCodes.BadNoCommunication,
    Why.HEARTBEAT_INVALID: ua.StatusCodes.BadDeviceFailure,
    Why.STATE_EXPIRED: ua.StatusCodes.BadNoCommunication,
    Why.NOT_DECIDING: ua.StatusCodes.BadDeviceFailure,
    Why.BLIND: ua.StatusCodes.BadSensorFailure,
    Why.DEGRADED: ua.StatusCodes.UncertainSensorNotAccurate,
}


class _Users:
    """Who may log in: users of the configuration, and whoever may only read."""

    def __init__(self, config: OpcUaConfig) -> None:
        self._config = config

    def get_user(
        self, iserver: Any, username: str | None = None, password: Any = None, certificate: Any = None
    ) -> User | None:
        if username is None:
            return User(UserRole.Anonymous) if self._config.anonymous else None
        given = password if isinstance(password, bytes) else str(password or "").encode()
        known = self._config.users.get(username)
        if known is None or not hmac.compare_digest(known.get_secret_value().encode(), given):
            return None
        return User(UserRole.User, username)


class _Rules(PermissionRuleset):  # type: ignore[misc]
    """Nobody writes; users call methods, everyone else reads."""

    _WRITES = ua.NodeId(ua.ObjectIds.WriteRequest_Encoding_DefaultBinary)
    _CALLS = ua.NodeId(ua.ObjectIds.CallRequest_Encoding_DefaultBinary)

    def __init__(self) -> None:
        self._all = frozenset(map(ua.NodeId, USER_TYPES)) - {self._WRITES}

    def check_validity(self, user: Any, action_type: Any, body: Any) -> bool:
        role = UserRole.Anonymous if user is None else user.role
        return action_type in self._all and (action_type != self._CALLS or role is UserRole.User)


def _encrypt_passwords(server: Server) -> None:
    """Ask for passwords that are encrypted for the server as well.

    asyncua says that an encrypted connection is enough; clients may refuse to send a password without a policy.
    """
    for endpoint in server.iserver.endpoints:
        for token in endpoint.UserIdentityTokens:
            if token.TokenType is ua.UserTokenType.UserName:
                token.SecurityPolicyUri = endpoint.SecurityPolicyUri


class OpcUaServer:
    """Serves one site."""

    def __init__(
        self, config: OpcUaConfig, site: str, register_map: RegisterMap, actor: str, ask: Ask
    ) -> None:
        self._config = config
        self._site = site
        self._map = register_map
        self._actor = actor
        self._ask = ask
        self._values: SiteValues | None = None
        self._news = asyncio.Event()
        self._events: asyncio.Queue[tuple[str, bytes]] = asyncio.Queue(1000)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._server = Server(user_manager=_Users(config))
        self._nodes: dict[str, Node] = {}
        self._told: dict[str, tuple[float | None, int]] = {}
        self._generator: Any = None
        self._tasks: list[asyncio.Task[None]] = []
        self.address = f"opc.tcp://{config.listen}/lumpwatch"
        """Its endpoint."""

    def set(self, values: SiteValues) -> None:
        """Say these from now on."""
        self._values = values
        self._news.set()

    def alarm(self, camera: str, roi: str, payload: bytes) -> None:
        """Raise an event of an alarm record."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._queue, f"{camera}/{roi}", payload)

    async def start(self) -> None:
        """Build the address space and listen. Raises GatewayError."""
        self._loop = asyncio.get_running_loop()
        try:
            await self._build()
            await self._server.start()
            _encrypt_passwords(self._server)
        except Exception as error:
            raise GatewayError(f"gateway.opcua: cannot serve {self._config.listen} ({error})") from error
        self._tasks = [asyncio.create_task(self._write()), asyncio.create_task(self._tell())]

    async def close(self) -> None:
        """End all sessions."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        with contextlib.suppress(Exception):
            await self._server.stop()

    async def _build(self) -> None:
        server = self._server
        await server.init()
        server.iserver.max_connections = MOST_CONNECTIONS
        server.set_endpoint(self.address)
        server.set_server_name("lumpwatch")
        await server.set_application_uri(f"urn:lumpwatch:{self._site}:gateway")
        policies = [ua.SecurityPolicyType.NoSecurity]
        if self._config.certificate is not None and self._config.key is not None:
            await server.load_certificate(self._config.certificate, "pem")
            await server.load_private_key(self._config.key, format="pem")
            policies = [
                ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
                ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
            ]
        server.set_security_policy(policies, permission_ruleset=_Rules())
        tokens = [ua.UserNameIdentityToken] if self._config.users else []
        server.set_identity_tokens(
            [*tokens, *([ua.AnonymousIdentityToken] if self._config.anonymous else [])]
        )
        index = await server.register_namespace(NAMESPACE)
        site = await server.nodes.objects.add_object(ua.NodeId(self._site, index), f"{index}:{self._site}")
        parents = {"": site}
        for camera, roi in self._map.regions:
            name = f"{camera}/{roi}"
            parents[name] = await site.add_object(ua.NodeId(name, index), f"{index}:{name}")
            await self._add_methods(parents[name], (camera, roi), index)
        for point in self._map.points:
            if point.table == "input":
                of, _, last = point.name.rpartition("/")
                kind = ua.VariantType.Double if point.scale > 1 else ua.VariantType.UInt32
                empty = ua.DataValue(
                    ua.Variant(None, ua.VariantType.Null),
                    ua.StatusCode(ua.StatusCodes.BadWaitingForInitialData),
                )
                node = await parents[of].add_variable(
                    ua.NodeId(point.name, index), f"{index}:{last}", 0, kind, ua.NodeId(kind.value)
                )
                await server.write_attribute_value(node.nodeid, empty)
                self._nodes[point.name] = node
        self._generator = await server.get_event_generator(emitting_node=server.nodes.server)

    async def _add_methods(self, parent: Node, region: tuple[str, str], index: int) -> None:
        name = f"{region[0]}/{region[1]}"

        async def acknowledge(_: Any, alarm_class: Any) -> Any:
            return await self._do(region, "ack", alarm_class, {})

        async def shelve(_: Any, alarm_class: Any, reason: Any, for_s: Any) -> Any:
            return await self._do(
                region, "shelve", alarm_class, {"reason": str(reason.Value), "for_s": float(for_s.Value)}
            )

        text, number = ua.VariantType.String, ua.VariantType.Double
        await parent.add_method(
            ua.NodeId(f"{name}/acknowledge", index), f"{index}:acknowledge", acknowledge, [text], [text]
        )
        await parent.add_method(
            ua.NodeId(f"{name}/shelve", index), f"{index}:shelve", shelve, [text, text, number], [text]
        )

    async def _do(
        self, region: tuple[str, str], command: str, alarm_class: Any, more: dict[str, object]
    ) -> list[ua.Variant] | ua.StatusCode:
        """Empty, or why it was not taken."""
        if alarm_class.Value not in tuple(AlarmClass):
            return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
        given: dict[str, object] = {"actor": self._actor, "class": alarm_class.Value, **more}
        problem = await asyncio.get_running_loop().run_in_executor(None, self._ask, region, command, given)
        return [ua.Variant(problem or "", ua.VariantType.String)]

    async def _write(self) -> None:
        while True:
            await self._news.wait()
            self._news.clear()
            if (values := self._values) is None:
                continue
            regions = {region.name: region for region in values.regions}
            for name, value, fraction in self._map.numbers(values):
                of, _, last = name.rpartition("/")
                region = regions.get(of)
                status = ua.StatusCodes.Good if last in _JUDGES or region is None else _STATUS[region.why]
                if status == ua.StatusCodes.Good and value is None:
                    status = (
                        ua.StatusCodes.BadNoData
                    )  # with a good one asyncua takes no null: the last would stay
                if self._told.get(name) != (value, status):
                    self._told[name] = value, status
                    await self._set(name, value, status, fraction, region)

    async def _set(
        self, name: str, value: float | None, status: int, fraction: bool, region: RegionValues | None
    ) -> None:
        if value is None:
            variant = ua.Variant(None, ua.VariantType.Null)
        elif fraction:
            variant = ua.Variant(float(value), ua.VariantType.Double)
        else:
            variant = ua.Variant(min(max(0, round(value)), 0xFFFFFFFF), ua.VariantType.UInt32)
        decided = None if region is None else region.decided
        source = (decided or datetime.now(UTC)).astimezone(UTC)
        told = ua.DataValue(
            variant, ua.StatusCode(status), SourceTimestamp=source, ServerTimestamp=datetime.now(UTC)
        )
        space, node = self._server.iserver.aspace, self._nodes[name].nodeid
        taken = await space.write_attribute_value(node, ua.AttributeIds.Value, told)
        if not taken.is_good():
            log.error("opcua: %s: a value was not taken (%s)", name, taken.name)
            nothing = ua.DataValue(ua.Variant(), ua.StatusCode(ua.StatusCodes.BadInternalError))
            await space.write_attribute_value(node, ua.AttributeIds.Value, nothing)

    def _queue(self, name: str, payload: bytes) -> None:
        if self._events.full():
            self._events.get_nowait()
            log.error("opcua: events come faster than they can be told: the oldest is dropped")
        self._events.put_nowait((name, payload))

    async def _tell(self) -> None:
        while True:
            name, payload = await self._events.get()
            try:
                data = json.loads(payload)["data"]
                self._generator.event.SourceName = name
                self._generator.event.Severity = _SEVERITY.get(data.get("priority"), 500)
                message = f"{data['class']} {data['change']}: {data['state']}, record {data['sequence']}"
                await self._generator.trigger(message=message)
            except Exception:
                log.exception("opcua: an alarm record was not told")
