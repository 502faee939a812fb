"""Serves the commands of a camera's regions: one queryable a region, dispatched by the command table."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

from lumpwatch.service.bus import Callback, Handle, Handler, Keys, Service
from lumpwatch.service.core import AlarmAction, AlarmClass, AlarmRequestError, Change, RoiResult
from lumpwatch.service.protocol import COMMANDS, ActReply, Command, Lane, read_request

log = logging.getLogger(__name__)

Do = Callable[[str, Any], bytes]
"""Does what a request, the second argument, asks of a ROI, the first."""


class Alarms(Protocol):
    """What alarm commands work on; the monitor is it."""

    def apply(self, roi: str, alarm_class: AlarmClass, action: AlarmAction) -> tuple[RoiResult, int]:
        """Do it, and have it recorded; the result, and the sequence of the ROI's last record."""


class CommandBus(Protocol):
    """What is needed of the bus."""

    def serve_all(self, prefix: str, services: Mapping[str, Service]) -> Handle:
        """See `Bus.serve_all`."""

    def subscribe(self, selector: str, callback: Callback) -> Handle:
        """See `Bus.subscribe`."""


class CommandServer:
    """Binds the rows of the table to what does them."""

    def __init__(
        self,
        *,
        alarms: Alarms,
        others: Mapping[str, Do],
        refused: Callable[[str, str], None],
        commands: Mapping[str, Command] = COMMANDS,
    ) -> None:
        """`others` do the commands that have no `action`, by name; `refused` counts by ROI and command.

        Raises KeyError for a command that nothing does.
        """
        self._refused = refused
        self._commands = commands
        self._do = {
            name: others[name] if row.action is None else partial(_apply, alarms, row, row.action)
            for name, row in commands.items()
        }

    def serve(self, bus: CommandBus, keys: Keys, camera: str, rois: tuple[str, ...]) -> None:
        """Answer from now on."""
        for roi in rois:
            services = {
                name: Service(self.handler(name, roi), row.lane.value, waits=row.lane is not Lane.TEST)
                for name, row in self._commands.items()
            }
            bus.serve_all(keys.region(camera, roi), services)
        for name in (name for name, row in self._commands.items() if row.puts):
            bus.subscribe(keys.commands(name, camera), self._put(name, keys, camera, rois))

    def handler(self, name: str, roi: str) -> Handler:
        """Answers the queries of one command on one ROI."""

        def handle(parameters: dict[str, str], payload: bytes | None) -> bytes:
            try:
                return self._do[name](roi, read_request(self._commands[name].request, parameters, payload))
            except AlarmRequestError:
                self._refused(roi, name)
                raise

        return handle

    def _put(self, name: str, keys: Keys, camera: str, rois: tuple[str, ...]) -> Callback:
        handlers = {keys.command(camera, roi, name): self.handler(name, roi) for roi in rois}

        def put(key: str, payload: bytes) -> None:
            if key not in handlers:
                return
            try:
                handlers[key]({}, payload)
            except AlarmRequestError as error:
                log.warning("%s: %s", key, error)

        return put


def _apply(alarms: Alarms, row: Command, make: Callable[[Any], AlarmAction], roi: str, request: Any) -> bytes:
    of: AlarmClass = request.alarm_class
    result, sequence = alarms.apply(roi, of, make(request))
    changes = tuple(change.transition.change for change in result.changes if change.alarm_class is of)
    alarm = result.alarms[of]
    return ActReply(
        alarm_class=of,
        changes=changes,
        alarm=alarm.state,
        active=alarm.active,
        sequence=sequence,
        acknowledged=Change.ACKNOWLEDGED in changes if row.name == "ack" else None,
    ).line()
