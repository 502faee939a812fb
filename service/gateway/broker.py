"""A connection to an MQTT broker that comes back by itself; only paho's thread waits for the network."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from lumpwatch.service.config import MqttConfig
from lumpwatch.service.gateway.errors import GatewayError

log = logging.getLogger(__name__)

KEEPALIVE_S = 5
"""The broker publishes the last will after one and a half times this without a sign of life."""
_WAITING = 1000
"""How many alarms wait at the most while the broker is not there."""


class Broker:
    """One client of a broker."""

    def __init__(
        self,
        config: MqttConfig,
        client_id: str,
        *,
        will: Callable[[], tuple[str, bytes, bool]],
        on_connect: Callable[[], None],
        on_message: Callable[[str, bytes], None],
        subscribe: tuple[str, ...] = (),
    ) -> None:
        """`will`, asked before every attempt to connect: topic, payload, whether retained.

        Callbacks run in paho's thread. What was retained is no command, since it would be given anew at every
        connection: it is not passed on.
        """
        self._config = config
        self._will = will
        self._on_connect = on_connect
        self._on_message = on_message
        self._subscribe = subscribe
        self._logged = False
        self._client = Client(CallbackAPIVersion.VERSION2, client_id=client_id, clean_session=True)
        self._client.max_queued_messages_set(_WAITING)
        self._client.reconnect_delay_set(1, 5)
        self._client.on_pre_connect = self._before
        self._client.on_connect = self._connected
        self._client.on_disconnect = self._disconnected
        self._client.on_message = self._message
        if config.user is not None:
            password = None if config.password is None else config.password.get_secret_value()
            self._client.username_pw_set(config.user, password)

    def start(self) -> None:
        """Connect, and again whenever that is lost. Raises GatewayError for certificates that cannot be used."""
        if (tls := self._config.tls) is not None:
            try:
                own = None if tls.certificate is None else str(tls.certificate)
                self._client.tls_set(str(tls.ca), own, None if tls.key is None else str(tls.key))
            except (OSError, ValueError) as error:
                raise GatewayError(f"gateway.mqtt.tls: cannot be used ({error})") from error
        self._client.connect_async(*self._config.address, keepalive=KEEPALIVE_S)
        self._client.loop_start()

    def close(self, last: tuple[str, bytes, bool] | None = None) -> None:
        """Say a last word, which the will is not for, and leave."""
        if last is not None and self._client.is_connected():
            with contextlib.suppress(ValueError, RuntimeError):
                self._client.publish(last[0], last[1], 1, last[2]).wait_for_publish(1.0)
        self._client.disconnect()
        self._client.loop_stop()

    @property
    def connected(self) -> bool:
        """Whether the broker is there."""
        return self._client.is_connected()

    def publish(self, topic: str, payload: bytes, *, qos: int = 0, retain: bool = False) -> None:
        """Have it sent; with qos 1 it waits while the broker is away. Returns at once."""
        self._client.publish(topic, payload, qos, retain)

    def _before(self, client: Client, userdata: object) -> None:
        topic, payload, retain = self._will()
        client.will_set(topic, payload, 1, retain)

    def _connected(
        self,
        client: Client,
        userdata: object,
        flags: ConnectFlags,
        code: ReasonCode,
        properties: Properties | None,
    ) -> None:
        if code.is_failure:
            log.warning("mqtt: %s refuses: %s", self._config.broker, code)
            return
        log.info("mqtt: %s is there", self._config.broker)
        for topic in self._subscribe:
            client.subscribe(topic, 1)
        self._on_connect()

    def _disconnected(
        self,
        client: Client,
        userdata: object,
        flags: DisconnectFlags,
        code: ReasonCode,
        properties: Properties | None,
    ) -> None:
        if code.is_failure:
            log.warning("mqtt: the connection to %s is lost: %s", self._config.broker, code)

    def _message(self, client: Client, userdata: object, message: MQTTMessage) -> None:
        if message.retain:
            log.warning("mqtt: %s is retained: not taken", message.topic)
            return
        try:
            self._on_message(message.topic, bytes(message.payload))
        except Exception:
            log.exception("mqtt: %s was not understood", message.topic)
