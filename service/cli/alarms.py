"""`lumpwatch alarms`: follow the alarm topic, or acknowledge an alarm."""

from __future__ import annotations

import argparse
import os
import select
import sys
import threading
import time
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from typing import TextIO, TypeVar

from pydantic import BaseModel, ValidationError

from lumpwatch.service.bus import Bus, Keys, open_client
from lumpwatch.service.cli.arguments.alarms import SILENT
from lumpwatch.service.cli.colours import coloured, wanted
from lumpwatch.service.cli.common import camera_of, stop_on_signals
from lumpwatch.service.config import BusConfig, load_config
from lumpwatch.service.core import AlarmClass, AlarmState, printable
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.protocol import AlarmEvent, Silence, SilenceWatch, StateMessage

_LONGEST_LINE = 1 << 20


def as_client(bus: BusConfig) -> BusConfig:
    """How an outsider on this host joins the daemon's bus."""
    return bus.model_copy(update={"mode": "client", "connect": bus.joined, "listen": ()})


def alarms(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.ack and ("/" not in arguments.ack or not arguments.actor):
        raise ConfigError("--ack takes CAMERA/ROI and needs --by NAME")
    config = load_config(arguments.config)
    chosen = [camera_of(config, arguments.camera)] if arguments.camera else config.cameras
    stop = stop_on_signals()
    with open_client(as_client(config.bus), stop, wait=False) as bus:
        if arguments.ack:
            camera, _, roi = arguments.ack.partition("/")
            key = Keys(config.site).command(camera, roi, "ack")
            _print(ask_one(bus, key, {"actor": arguments.actor}, arguments.ack).decode())
            return 0
        regions = {camera.id: [roi.id for roi in camera.rois] for camera in chosen}
        follower = _Follower(config.site, regions, arguments.json, arguments.count, arguments.exit_on_silence)
        return follower.follow(bus, stop)


class _Follower:
    """Prints alarms as they come, and SILENT where nothing valid is heard: silence is never clear."""

    def __init__(
        self,
        site: str,
        regions: Mapping[str, Collection[str]],
        as_json: bool,
        count: int | None,
        exit_on_silence: bool,
    ) -> None:
        self._keys = Keys(site)
        self._regions = regions
        self._json = as_json
        self._coloured = not as_json and wanted(sys.stdout, os.environ)
        self._left = count
        self._exit_on_silence = exit_on_silence
        self._watch = SilenceWatch(site, regions, time.monotonic())
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._silence = self._unread = False

    def follow(self, bus: Bus, stop: threading.Event) -> int:
        """Until `stop`, or the count is reached, or a camera falls silent where that ends it; the exit code.

        Raises BrokenPipeError once whoever read the lines has gone, though nothing is to be printed.
        """
        bus.subscribe(
            self._keys.heartbeats(), lambda _, payload: self._watch.heard(payload, time.monotonic())
        )
        if not self._json:
            self._states(bus, self._regions)
        bus.subscribe_alarms(
            self._keys.alarms(), self._alarm, lambda n: _print(f"{n} alarm records were missed", sys.stderr)
        )
        while not self._done.is_set() and not stop.wait(0.1):
            for change in self._watch.changes(time.monotonic()):
                self._tell(change, bus)
            if self._unread or reader_gone(sys.stdout):
                raise BrokenPipeError
        return SILENT if self._silence else 0

    def _tell(self, change: Silence, bus: Bus) -> None:
        now = datetime.now(UTC)
        self._line(change.line(now).decode() if self._json else f"{now:%Y-%m-%d %H:%M:%S} {change}")
        if change.silent and self._exit_on_silence:
            self._silence = True
            self._done.set()
        elif not change.silent and not self._json:
            self._states(bus, (change.camera,))

    def _states(self, bus: Bus, cameras: Collection[str]) -> None:
        for reply in bus.ask(self._keys.states()):
            if reply.payload is not None and reply.key.split("/")[-3] in cameras:
                self._line(describe_state(reply.payload))

    def _alarm(self, key: str, payload: bytes) -> None:
        if key.split("/")[-3] not in self._regions:
            return
        self._line(payload.decode(errors="replace") if self._json else describe_alarm(payload), counts=True)

    def _line(self, line: str, *, counts: bool = False) -> None:
        with self._lock:
            if self._done.is_set():
                return
            try:
                _print(line, coloured_states=self._coloured)
            except BrokenPipeError:
                self._unread = True
                return
            if counts and self._left is not None:
                self._left -= 1
                if self._left <= 0:
                    self._done.set()


def reader_gone(stream: TextIO) -> bool:
    """Whether nobody can read any more what is written there: the other end of a pipe is closed."""
    try:
        descriptor = stream.fileno()
    except (OSError, ValueError):  # no file at all
        return False
    look = select.poll()
    look.register(descriptor, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in look.poll(0))


def ask_one(bus: Bus, key: str, parameters: dict[str, str], target: str, timeout_s: float = 2.0) -> bytes:
    """The only answer to a query; raises LumpwatchError where there is none, or it is an error."""
    replies = bus.ask(key, parameters, timeout_s=timeout_s)
    if not replies:
        raise LumpwatchError(
            f"nobody answers for {target}: is the daemon running, the name right, and this client allowed to?"
        )
    reply = replies[0]
    if reply.payload is None:
        raise LumpwatchError(f"{target}: {reply.error}")
    return reply.payload


Answer = TypeVar("Answer", bound=BaseModel)


def read_answer(model: type[Answer], answer: bytes, target: str) -> Answer:
    """The answer as what it must be; raises LumpwatchError for that of another version or program."""
    try:
        return model.model_validate_json(answer)
    except ValidationError:
        raise LumpwatchError(f"{target}: the answer is not one that this version understands") from None


def describe_alarm(payload: bytes) -> str:
    """One line for a person."""
    try:
        event = AlarmEvent.model_validate_json(payload)
    except ValidationError:
        return f"a malformed alarm record of {len(payload)} bytes"
    data = event.data
    where = ""
    if box := next((found for found in data.objects if found.counts), None):
        where = f", box {box.w:.0f} x {box.h:.0f} px at ({box.x:.0f}, {box.y:.0f}), {box.model}"
    actor = f" by {data.actor}" if data.actor else ""
    of = "" if data.alarm_class is AlarmClass.LUMP else f"{data.alarm_class.value} "
    what = f"{'TEST ' if data.test else ''}{of}{data.change.value}"
    why = f" ({data.reason})" if data.reason else ""
    left = "" if data.left_s is None else f", {data.left_s:.1f} s to the lip"
    return (
        f"{event.time:%Y-%m-%d %H:%M:%S} {data.camera}/{data.roi}: {what}{actor}{why}, now {data.state}, "
        f"existence {data.existence:.2f}, frame {data.frame}{where}{left}"
    )


def describe_state(payload: bytes) -> str:
    """One line for a person."""
    try:
        state = StateMessage.model_validate_json(payload)
    except ValidationError:
        return f"a malformed state of {len(payload)} bytes"
    reason = f" ({state.reason.value})" if state.reason else ""
    others = "".join(
        f", {alarm_class} alarm {stands}"
        for alarm_class, stands in state.alarms.items()
        if alarm_class is not AlarmClass.LUMP and stands != AlarmState.NORMAL
    )
    return (
        f"{state.camera}/{state.roi}: {state.state.value}{reason}, "
        f"alarm {state.alarm}{others}, existence {state.existence:.2f}"
    )


def _print(line: str, stream: object = None, *, coloured_states: bool = False) -> None:
    out = sys.stdout if stream is None else sys.stderr
    text = printable(line, _LONGEST_LINE)
    out.write((coloured(text) if coloured_states else text) + "\n")
    out.flush()
