"""A real Prometheus and a real Alertmanager with the files of `deploy/`, in a hurry, and a receiver of alerts."""

from __future__ import annotations

import json
import shutil
import subprocess
import threading
import urllib.parse
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from tests.integration.site import free_port, wait_for

DEPLOY = Path(__file__).parents[2] / "deploy"
ALERTMANAGER = shutil.which("prometheus-alertmanager") or shutil.which("alertmanager")


def get(url: str) -> Any:
    with urllib.request.urlopen(url, timeout=10) as answer:
        return json.load(answer)


class Prometheus:
    """Asks a running server."""

    def __init__(self, port: int) -> None:
        self.url = f"http://127.0.0.1:{port}"

    def query(self, expression: str) -> list[dict[str, Any]]:
        text = urllib.parse.urlencode({"query": expression})
        found: list[dict[str, Any]] = get(f"{self.url}/api/v1/query?{text}")["data"]["result"]
        return found

    def range(self, expression: str, start: float, end: float, step_s: float) -> list[dict[str, Any]]:
        text = urllib.parse.urlencode({"query": expression, "start": start, "end": end, "step": step_s})
        found: list[dict[str, Any]] = get(f"{self.url}/api/v1/query_range?{text}")["data"]["result"]
        return found

    def firing(self) -> set[tuple[str, str]]:
        """Name and camera of the alerts that fire."""
        return {
            (one["labels"]["alertname"], one["labels"].get("camera", ""))
            for one in get(f"{self.url}/api/v1/alerts")["data"]["alerts"]
            if one["state"] == "firing"
        }


@contextmanager
def _running(command: Sequence[str | Path], log: Path, url: str) -> Iterator[None]:
    def ready() -> bool:
        assert process.poll() is None, log.read_text()
        try:
            with urllib.request.urlopen(f"{url}/-/ready", timeout=5) as answer:
                return bool(answer.status == 200)
        except OSError:
            return False

    with log.open("wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=file)
    try:
        wait_for(url, ready, 30)
        yield
    finally:
        process.terminate()
        process.wait(timeout=20)


@contextmanager
def prometheus(
    folder: Path, targets: Sequence[Mapping[str, Any]], alertmanager_url: str | None = None
) -> Iterator[Prometheus]:
    """Prometheus with the configuration of `deploy/`; every period is two seconds."""
    config = YAML(typ="safe").load(DEPLOY / "prometheus" / "prometheus.yml")
    config["global"] = {"scrape_interval": "2s", "evaluation_interval": "2s"}
    (manager,) = config["alerting"]["alertmanagers"]
    manager["static_configs"] = (
        [{"targets": [alertmanager_url.removeprefix("http://")]}] if alertmanager_url else []
    )
    shutil.copytree(DEPLOY / "prometheus" / "rules", folder / "rules")
    (folder / "targets").mkdir()
    (folder / "targets" / "site.yml").write_text(json.dumps(targets))
    (folder / "prometheus.yml").write_text(json.dumps(config))
    asked = Prometheus(free_port())
    command = [
        "prometheus",
        f"--config.file={folder}/prometheus.yml",
        f"--storage.tsdb.path={folder}/data",
        f"--web.listen-address={asked.url.removeprefix('http://')}",
    ]
    with _running(command, folder / "prometheus.log", asked.url):
        yield asked


class Alertmanager:
    """A running server, and what its receivers were sent."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.received: dict[str, list[dict[str, Any]]] = {
            "pages": [],
            "tickets": [],
            "watchdog": [],
        }

    def post(self, alerts: Sequence[Mapping[str, Any]]) -> None:
        """As Prometheus does."""
        request = urllib.request.Request(
            f"{self.url}/api/v2/alerts", json.dumps(alerts).encode(), {"Content-Type": "application/json"}
        )
        urllib.request.urlopen(request, timeout=10).close()

    def told(self, receiver: str, status: str = "firing") -> set[tuple[str, str]]:
        """Name and camera of the alerts that a receiver was sent with that status."""
        return {
            (one["labels"]["alertname"], one["labels"].get("camera", ""))
            for message in self.received[receiver]
            for one in message["alerts"]
            if one["status"] == status
        }


@contextmanager
def alertmanager(folder: Path) -> Iterator[Alertmanager]:
    """Alertmanager with the routes of `deploy/`: tickets wait a second, and the receivers are here."""
    assert ALERTMANAGER is not None
    manager = Alertmanager(f"http://127.0.0.1:{free_port()}")

    class Receiver(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            manager.received[self.path.strip("/")].append(json.loads(body))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Receiver)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    config = YAML(typ="safe").load(DEPLOY / "alertmanager" / "alertmanager.yml")
    config["route"]["group_wait"] = "1s"
    for route in (config["route"], *config["route"]["routes"]):
        route["group_interval"] = "1s"
    for receiver in config["receivers"]:
        (hook,) = receiver["webhook_configs"]
        hook["url"] = f"http://127.0.0.1:{server.server_port}/{hook['url'].rpartition('/')[2]}"
    (folder / "alertmanager.yml").write_text(json.dumps(config))
    command = [
        ALERTMANAGER,
        f"--config.file={folder}/alertmanager.yml",
        f"--storage.path={folder}/alertmanager",
        f"--web.listen-address={manager.url.removeprefix('http://')}",
        "--cluster.listen-address=",
    ]
    try:
        with _running(command, folder / "alertmanager.log", manager.url):
            yield manager
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
