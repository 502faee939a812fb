"""Makes the pictures of docs/dashboards.md: `make pictures`, with Debian's prometheus and chromium.

A real daemon watches two cameras, a real Prometheus scrapes it, then one camera dies. Prometheus' own page of
alerts is photographed. Grafana is not at hand, so matplotlib draws each dashboard instead: its panels at their
places, with what that Prometheus answers to their queries.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from deploy.grafana.make_dashboards import DASHBOARDS, dashboard
from lumpwatch.service.cli.demo import CAMERA, FEED, ROI, SEED, demo_config
from lumpwatch.service.config import parse_config
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from tests.integration.conftest import PRIOR
from tests.integration.site import Daemon, wait_for
from tests.integration.test_prometheus import CAMERAS
from tests.reproduction.difficulty.peers import calibration
from tests.servers.process import RtspServer
from tests.servers.prometheus import Prometheus, prometheus

IMAGES = Path(__file__).parents[2] / "docs" / "images"
BEFORE_S, AFTER_S, STEP_S, CRUSHERS = 90.0, 40.0, 2.0, 40
_ROW_INCHES = 0.27
UNITS = {"s": "s", "hertz": "1/s", "percentunit": "share", "lengthmm": "mm", "short": ""}


def legend(template: str, labels: Mapping[str, str]) -> str:
    """Grafana's legend of one series."""
    return re.sub(r"\{\{(\w+)\}\}", lambda found: labels.get(found[1], ""), template).strip()


def colour(panel: Mapping[str, Any], value: float) -> str:
    """That of the highest threshold below the value."""
    steps = panel["fieldConfig"]["defaults"]["thresholds"]["steps"]
    return str([one["color"] for one in steps if one["value"] is None or value >= one["value"]][-1])


def shown(panel: Mapping[str, Any], value: float) -> str:
    """The value as the panel words it."""
    defaults = panel["fieldConfig"]["defaults"]
    words = {key: one["text"] for mapping in defaults["mappings"] for key, one in mapping["options"].items()}
    text = f"{value:.0%}" if defaults["unit"] == "percentunit" else f"{value:.3g}"
    return words.get(f"{value:g}", text)


def draw(axes: Axes, panel: Mapping[str, Any], asked: Prometheus, start: float, end: float) -> None:
    """One panel."""
    defaults = panel["fieldConfig"]["defaults"]
    axes.set_title(panel["title"], fontsize=8, loc="left")
    axes.tick_params(labelsize=6)
    series = []
    for target in panel["targets"]:
        query = target["expr"].replace("$site", ".*").replace("$camera", ".*")
        for one in asked.query(query) if target["instant"] else asked.range(query, start, end, STEP_S):
            values = one["values"] if "values" in one else [one["value"]]
            points = [(float(at) - start, float(value)) for at, value in values]
            series.append((legend(target["legendFormat"], one["metric"]), points))
    if not series:
        axes.text(0.5, 0.5, defaults["noValue"], ha="center", transform=axes.transAxes, fontsize=8)
    elif panel["type"] == "timeseries":
        for name, points in series:
            axes.plot(*zip(*points, strict=True), label=name, linewidth=0.9, drawstyle="steps-post")
        if len(series) <= 10:
            axes.legend(fontsize=5, loc="upper left", framealpha=0.6)
        axes.set_ylabel(UNITS[defaults["unit"]], fontsize=6)
        axes.set_xlim(0, end - start)
        values = [value for _, points in series for _, value in points]
        if min(values) >= 0:
            axes.set_ylim(0, 1.08 * max(values) or 1.0)
    elif panel["type"] == "state-timeline":
        for row, (_, points) in enumerate(series):
            for at, value in points:
                axes.broken_barh([(at, STEP_S)], (row - 0.42, 0.84), color=colour(panel, value), linewidth=0)
        axes.set_yticks(range(len(series)), [name for name, _ in series], fontsize=5)
        axes.set_ylim(len(series) - 0.5, -0.5)
        axes.set_xlim(0, end - start)
    elif panel["type"] == "bargauge":
        names, values = [name for name, _ in series], [points[-1][1] for _, points in series]
        axes.barh(range(len(series)), values, color=[colour(panel, value) for value in values])
        axes.set_yticks(range(len(series)), names, fontsize=4 if len(series) > 12 else 6)
        axes.invert_yaxis()
    else:
        axes.set_axis_off()
        for row, (name, points) in enumerate(series):
            value = points[-1][1]
            axes.text(
                0.5, 1 - (row + 0.5) / len(series), f"{name}: {shown(panel, value)}", fontsize=7, color="white",
                ha="center", va="center", transform=axes.transAxes,
                bbox={"facecolor": colour(panel, value), "edgecolor": "none", "boxstyle": "round"},
            )  # fmt: skip


def picture(name: str, asked: Prometheus, start: float, end: float) -> None:
    """One dashboard, its panels at their places."""
    panels = dashboard(name)["panels"]
    rows = max(p["gridPos"]["y"] + p["gridPos"]["h"] for p in panels) + 0.3
    figure = plt.figure(figsize=(10, rows * _ROW_INCHES))
    for panel in panels:
        at = panel["gridPos"]
        left = (at["x"] + (3.2 if panel["type"] in ("bargauge", "state-timeline") else 1.4)) / 24
        bottom = 1 - (at["y"] + at["h"] - 1.0) / rows
        width, height = (at["x"] + at["w"] - 0.3) / 24 - left, (at["h"] - 2.2) / rows
        draw(figure.add_axes((left, bottom, width, height)), panel, asked, start, end)
    figure.savefig(IMAGES / f"dashboard_{name}.png", dpi=90, pil_kwargs={"optimize": True})
    plt.close(figure)


def photograph(url: str, file: Path) -> None:
    """A page as Chromium shows it."""
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run(
            [
                "chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
                "--disable-background-networking", "--disable-component-update", "--disable-sync",
                "--hide-scrollbars", "--window-size=1000,760", "--virtual-time-budget=5000",
                f"--user-data-dir={profile}", f"--screenshot={file}", url,
            ],
            check=True, timeout=90, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip


def targets(port: int) -> Sequence[Mapping[str, Any]]:
    """The daemon as a site of two crushers; and again under as many names as make the fleet."""
    address = f"127.0.0.1:{port}"
    return [
        {"targets": [address], "labels": {"site": f"site-{i + 1:02}", "instance": f"host-{i + 1:02}:9464"}}
        for i in range(CRUSHERS // 2)
    ]


def ready(daemon: Daemon) -> bool:
    """Whether it says so."""
    return daemon.ready


def main() -> None:
    """Make them all; takes five minutes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=float, default=BEFORE_S, help="seconds until the camera dies")
    arguments = parser.parse_args()
    if lacking := [name for name in ("prometheus", "chromium") if shutil.which(name) is None]:
        raise SystemExit(f"Debian packages {', '.join(lacking)} are not installed")
    place = [[float(v) for v in point] for point in FeedSimulator(FeedSpec()).polygon]
    polygon = [
        list(point) for point in parse_config(demo_config(Path("var"), 0)).camera(CAMERA).roi(ROI).polygon
    ]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        clip = write_video(FeedSpec.from_query(FEED, seed=SEED), 30.0, folder / "feed").video
        for fleet in (False, True):
            within = Path("/tmp/lumpwatch")  # the page of alerts shows it
            shutil.rmtree(within, ignore_errors=True)
            within.mkdir()
            with RtspServer(clip) as server:
                told = json.dumps(calibration(FeedSpec()))
                cameras = CAMERAS.format(url=server.url, polygon=polygon, place=place, calibration=told)
                daemon = Daemon(within, cameras.replace("lumps_per_minute=20", "lumps_per_minute=6"))
                region = ("--camera", "crusher-1", "--roi", "apron")
                daemon.command("priors", "import", str(daemon.config), str(PRIOR), *region)
                with daemon, prometheus(within, targets(daemon.port)[: None if fleet else 1]) as asked:
                    wait_for("ready", partial(ready, daemon), 120)
                    start = time.time()
                    time.sleep(arguments.before)
                    server.kill()

                    def paged(asked: Prometheus = asked) -> bool:
                        return any(alert == "LumpwatchBlind" for alert, _ in asked.firing())

                    wait_for("page", paged, 90)
                    time.sleep(AFTER_S)
                    end = time.time()
                    for name in DASHBOARDS:
                        if (name == "fleet") == fleet:
                            picture(name, asked, start, end)
                    if not fleet:
                        # Debian's package has the older pages only.
                        photograph(f"{asked.url}/classic/alerts", IMAGES / "prometheus_alerts.png")
            shutil.rmtree(within)


if __name__ == "__main__":
    main()
