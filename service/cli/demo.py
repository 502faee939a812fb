"""`lumpwatch demo`: the whole product on a simulated crusher, with lines that a person can follow."""

from __future__ import annotations

import argparse
import contextlib
import os
import tempfile
import threading
import time
from collections import Counter
from importlib.resources import as_file, files
from pathlib import Path

from rich.console import Console

from lumpwatch.service.bus import Bus, Keys, open_client
from lumpwatch.service.cli.alarms import describe_alarm
from lumpwatch.service.cli.beside import Gateway, Page
from lumpwatch.service.cli.common import stop_on_signals
from lumpwatch.service.config import BusConfig, SiteConfig, parse_config
from lumpwatch.service.core import LEVEL, AlarmClass, log_to_stderr
from lumpwatch.service.protocol import AlarmEvent, SilenceWatch, StateMessage
from lumpwatch.service.runtime import Addresses, ConfigFile
from lumpwatch.service.runtime import run as run_daemon
from lumpwatch.service.simulator import FeedSimulator, FeedSpec
from lumpwatch.service.storage import PriorStore, read_file

FEED = "lumps_per_minute=4&dust=0.25"
SEED = 10  # a lump comes early, and between two lumps the belt is clear
CAMERA, ROI = "crusher-1", "apron"
_EVERY_S = 2.0


def demo_config(store: Path, seed: int) -> str:
    """The configuration of the demo, as a user would write it."""
    polygon = [[round(v, 4) for v in point] for point in FeedSimulator(FeedSpec()).polygon]
    return f"""\
site: demo
bus: {{mode: router, listen: ["tcp/127.0.0.1:0"]}}
store: {{path: "{store}"}}
telemetry: {{listen: "127.0.0.1:0"}}
console: {{listen: "127.0.0.1:0", anonymous: engineer}}
gateway: {{modbus: {{listen: "127.0.0.1:0"}}}}
cameras:
  - id: {CAMERA}
    source: {{url: "sim:feed?{FEED}", seed: {seed}}}
    rois:
      - id: {ROI}
        polygon: {polygon}
        alarm: {{off_delay_s: 1.0, latch: false}}
"""


def demo(arguments: argparse.Namespace) -> int:
    """Run the command."""
    os.environ.setdefault(LEVEL, "error")  # the follower prints what happens, once
    log_to_stderr()
    stop = stop_on_signals()
    console = Console(highlight=False)
    with tempfile.TemporaryDirectory(prefix="lumpwatch-demo-") as folder:
        text = demo_config(Path(folder) / "var", SEED if arguments.seed is None else arguments.seed)
        config = parse_config(text, "demo configuration")
        console.print("[bold]The configuration of this demo:[/bold]")
        console.print(text, markup=False, soft_wrap=True)
        file = Path(folder) / "site.yaml"
        file.write_text(text, encoding="utf-8")
        with as_file(files("lumpwatch.service.simulator") / "demo.prior") as prior:
            PriorStore(config.store.path).save(read_file(prior))
        follower = _Follower(config, console, arguments.for_s, stop)
        with contextlib.ExitStack() as page:

            def begin(addresses: Addresses) -> None:
                for what in (Page, Gateway):
                    page.enter_context(contextlib.closing(what(config, file, addresses.bus, console)))
                follower.start(addresses)

            run_daemon(config, stop, on_ready=begin, changed=ConfigFile(file).changed)
        follower.join()
    return follower.summary()


class _Follower:
    """An outside subscriber: joins the bus as any client, counts and prints."""

    def __init__(self, config: SiteConfig, console: Console, seconds: float, stop: threading.Event) -> None:
        self._config = config
        self._console = console
        self._seconds = seconds
        self._stop = stop
        self._watch = SilenceWatch(config.site, {CAMERA: (ROI,)}, time.monotonic())
        self._frames = 0
        self._last: StateMessage | None = None
        self._ages: list[float] = []
        self._alarms: Counter[str] = Counter()
        self._thread: threading.Thread | None = None
        self._began = time.monotonic()

    def start(self, addresses: Addresses) -> None:
        """Follow in a thread of its own; called when the daemon is up."""
        self._console.print(f"bus      {', '.join(addresses.bus)}")
        self._console.print(f"metrics  {addresses.telemetry}/metrics   (also /readyz, /livez)")
        self._console.print("The simulated camera and the filter are starting; kernels compile once.\n")
        self._thread = threading.Thread(target=self._follow, args=(addresses,), name="follower", daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait for the thread."""
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def summary(self) -> int:
        """Print what happened; 1 where no frame was ever decided."""
        seconds = time.monotonic() - self._began
        self._console.print(
            f"\n[bold]{self._frames} frames decided in {seconds:.0f} s; "
            f"alarms raised {self._alarms['raised']}, cleared {self._alarms['cleared']}.[/bold]"
        )
        if self._ages:
            ages = sorted(self._ages)
            middle, late = ages[len(ages) // 2], ages[int(0.99 * (len(ages) - 1))]
            self._console.print(
                f"From capture to decision: median {1000 * middle:.0f} ms, 99 % within {1000 * late:.0f} ms."
            )
        return 0 if self._frames else 1

    def _follow(self, addresses: Addresses) -> None:
        bus_config = BusConfig(mode="client", connect=addresses.bus)
        keys = Keys(self._config.site)
        with open_client(bus_config, self._stop) as bus:
            bus.subscribe(keys.states(), self._on_state)
            bus.subscribe_alarms(keys.alarms(), self._on_alarm)
            bus.subscribe(keys.heartbeats(), self._on_heartbeat)
            self._tell(bus)

    def _tell(self, bus: Bus) -> None:
        printed_s, frames = time.monotonic(), 0
        while not self._stop.wait(0.2):
            now = time.monotonic()
            if (
                self._frames
                and self._began < printed_s
                and self._seconds
                and now - self._began > self._seconds
            ):
                self._stop.set()
            if self._seconds and now - self._began > self._seconds + 120:
                self._stop.set()
            for change in self._watch.changes(now):
                if self._frames:  # before the first one kernels compile
                    self._console.print(str(change), style="bold magenta" if change.silent else "green")
            if not self._watch.silent and now - printed_s >= _EVERY_S and self._last is not None:
                rate = (self._frames - frames) / (now - printed_s)
                printed_s, frames = now, self._frames
                self._console.print(_line(self._last, rate), markup=False, soft_wrap=True)

    def _on_state(self, key: str, payload: bytes) -> None:
        state = StateMessage.model_validate_json(payload)
        if state.timing is not None and (self._last is None or state.frame != self._last.frame):
            if self._frames == 0:
                self._began = time.monotonic()  # the seconds of the demo count from the first frame
            self._frames += 1
            self._ages.append(state.timing.age_s)
        self._last = state

    def _on_heartbeat(self, key: str, payload: bytes) -> None:
        self._watch.heard(payload, time.monotonic())

    def _on_alarm(self, key: str, payload: bytes) -> None:
        event = AlarmEvent.model_validate_json(payload)
        if event.data.alarm_class == AlarmClass.LUMP:
            self._alarms[event.data.change] += 1
        style = "bold red" if event.data.change == "raised" else "green"
        self._console.print(f"ALARM {describe_alarm(payload)}", style=style, soft_wrap=True)


def _line(state: StateMessage, rate: float) -> str:
    bar = "#" * round(20 * state.existence)
    where = ""
    if box := next((found for found in state.objects if found.counts), None):
        where = f"  {box.w:.0f} x {box.h:.0f} px at row {box.y + box.h / 2:.0f}, {box.model}"
    reason = f" ({state.reason.value})" if state.reason else ""
    return (
        f"{state.camera}/{state.roi} {state.state.value:5}{reason} {rate:5.1f} frames/s  "
        f"existence {state.existence:4.2f} [{bar:20}]{_feed(state)}{where}"
    )


def _feed(state: StateMessage) -> str:
    """What the feed does, as far as it is known."""
    told = state.feed
    if told is None:
        return ""
    speed = "" if told.speed_mm_s is None else f" {told.speed_mm_s / 1000.0:.2f} m/s"
    load = "" if told.load is None else f" load {told.load:.0%}"
    return f"  feed {told.state.value}{speed}{load}"
