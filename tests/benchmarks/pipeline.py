"""CPU time of the whole pipeline against bare decoding, and latency live over RTSP.

One ROI on 1920 x 1080 H.264. Decoding and replay take turns on the same file in one process, so that
a change of the machine's speed touches both. Live, the CPU time of camera and monitor process is read
from the process table over the same number of frames, and the latency from the states on the bus.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import threading
import time
from pathlib import Path

import av

from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.cli.demo import CAMERA, FEED, ROI, SEED, demo_config
from lumpwatch.service.config import load_config
from lumpwatch.service.core.video_writer import VideoWriter
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.protocol.messages import StateMessage
from lumpwatch.service.protocol.records import state_line
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec
from tests.integration.site import Daemon, wait_for
from tests.servers.process import RtspServer

SECONDS, FPS, ROUNDS = 12, 25, 5


def make_video(path: Path, seconds: float = SECONDS) -> Path:
    """A feed in the quality of a plant camera: some 4 Mbit/s."""
    spec = FeedSpec.from_query(FEED, seed=SEED, width=1920, height=1080, fps=FPS, noise=1.0)
    feed = FeedSimulator(spec)
    with VideoWriter(path, spec.width, spec.height, FPS, crf=30) as writer:
        for _ in range(round(seconds * FPS)):
            writer.write(feed.render()[0])
    print(f"  {'video_mbit_s':20} {8e-6 * path.stat().st_size / seconds:8.2f}")
    return path


def decode(video: Path) -> int:
    """Bare decoding to the luma plane."""
    frames = 0
    with av.open(str(video)) as container:
        container.streams.video[0].thread_type = "NONE"
        for picture in container.decode(video=0):
            memoryview(picture.planes[0])
            frames += 1
    return frames


def pipeline(config_path: Path, video: Path) -> int:
    """Decoding, cutting, filtering, deciding and writing the state lines."""
    config = load_config(config_path)
    camera = config.camera(CAMERA)
    whole = CameraPipeline(camera)
    frames, _ = read_frames(camera, video)
    count = 0
    for frame in frames:
        for result in whole.process(frame, frame.received_s):
            state_line(result, CAMERA, 0.0).line()
        count += 1
    return count


def _cpu_a_frame(work) -> float:  # type: ignore[no-untyped-def]
    began = time.process_time()
    frames = work()
    return (time.process_time() - began) / frames


def _process_cpu(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run() -> dict[str, float]:
    """All figures of this benchmark, times in milliseconds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        video = make_video(folder / "feed.mp4")
        cameras = demo_config(folder, 0).partition("cameras:\n")[2]
        with RtspServer(video) as server:
            source = f'source: {{url: "{server.url}"}}'
            lines = [source if "source:" in line else line.strip() for line in cameras.splitlines()]
            daemon = Daemon(folder, _indent(lines))
            pipeline(daemon.config, video)  # compiles the kernels
            decoding, whole = [], []
            for _ in range(ROUNDS):
                decoding.append(_cpu_a_frame(lambda: decode(video)))
                whole.append(_cpu_a_frame(lambda: pipeline(daemon.config, video)))
            figures = {
                "decoding_ms": 1000 * statistics.median(decoding),
                "pipeline_ms": 1000 * statistics.median(whole),
                "ratio": statistics.median(w / d for w, d in zip(whole, decoding, strict=True)),
            }
            with daemon:
                figures |= _live(daemon)
        figures["live_ratio"] = figures["live_cpu_ms"] / figures["decoding_ms"]
        return figures


def _live(daemon: Daemon) -> dict[str, float]:
    config = load_config(daemon.config)
    wait_for("ready", lambda: daemon.ready, 60)
    time.sleep(3.0)
    ages: list[float] = []
    decisions: list[float] = []

    def on_state(key: str, payload: bytes) -> None:
        state = StateMessage.model_validate_json(payload)
        if state.timing is not None and (not decisions or state.frame != decisions[-1]):
            ages.append(state.timing.age_s)
            decisions.append(state.frame)

    with open_client(as_client(config.bus), threading.Event()) as bus:
        bus.subscribe(Keys(config.site).states(), on_state)
        workers = [pid for pids in daemon.children().values() for pid in pids]
        before = sum(map(_process_cpu, workers))
        seen = len(decisions)
        time.sleep(20.0)
        spent, frames = sum(map(_process_cpu, workers)) - before, len(decisions) - seen
    ordered = sorted(ages)
    stages = {}
    for stage in ("receive", "publish", "cut", "filter"):
        total = daemon.metric("lumpwatch_stage_duration_seconds_sum", stage=stage)
        count = daemon.metric("lumpwatch_stage_duration_seconds_count", stage=stage)
        stages[f"stage_{stage}_ms"] = 1000 * total / count
    return stages | {
        "live_cpu_ms": 1000 * spent / frames,
        "live_fps": frames / 20.0,
        "latency_median_ms": 1000 * ordered[len(ordered) // 2],
        "latency_p99_ms": 1000 * ordered[int(0.99 * (len(ordered) - 1))],
    }


def _indent(lines: list[str]) -> str:
    """The camera of the demo's configuration with its source replaced."""
    depth = {"- id: " + CAMERA: 2, "source": 4, "rois": 4, "- id: " + ROI: 6, "polygon": 8, "alarm": 8}
    out = []
    for line in lines:
        indent = next(n for start, n in depth.items() if line.startswith(start))
        out.append(" " * indent + line)
    return "\n".join(out) + "\n"
