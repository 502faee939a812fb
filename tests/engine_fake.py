"""A container engine in memory: containers run, and are ready when their image is good."""

from __future__ import annotations

from dataclasses import replace

from lumpwatch.service.deployment.bundling import Bundle
from lumpwatch.service.deployment.errors import DeployError
from lumpwatch.service.deployment.plan import Found


class FakeEngine:
    """Image ids tell what becomes of a container: `good`, `blind`, `half` (one region of two), `ends`, `refuses`."""

    def __init__(self) -> None:
        self.containers: dict[str, Found] = {}
        self.done: list[str] = []

    def running(self) -> list[str]:
        return [name for name, one in self.containers.items() if one.running]

    def found(self, name: str) -> Found | None:
        return self.containers.get(name)

    def prepare(self, image: str, bundle: Bundle) -> None:
        self.done.append("prepare")

    def complaint(self, image: str, bundle: Bundle) -> str | None:
        return "unknown key" if image.startswith("refuses") else None

    def create(self, name: str, image: str, bundle: Bundle) -> None:
        assert name not in self.containers
        self.containers[name] = Found(name, image, bundle.digest, "created")

    def start(self, name: str) -> None:
        assert not self.running(), "two would fight for the ports"
        self.done.append(f"start {name}")
        status = "exited" if self.containers[name].image.startswith("ends") else "running"
        self.containers[name] = replace(self.containers[name], status=status)

    def stop(self, name: str) -> None:
        self.done.append(f"stop {name}")
        self.containers[name] = replace(self.containers[name], status="exited")

    def rename(self, name: str, new: str) -> None:
        if new in self.containers:
            raise DeployError(f"{new} exists")
        self.containers[new] = replace(self.containers.pop(name), name=new)

    def remove(self, name: str) -> None:
        self.containers.pop(name, None)

    def health(self, name: str) -> list[str] | None:
        one = self.containers[name]
        if not one.running:
            return None
        lip, apron = "cam/lip: has not decided yet", "cam/apron: has not decided yet"
        kind = one.image.partition("-")[0]
        return {"good": [], "half": [lip], "blind": [lip, apron], "mute": None}[kind]

    def logs(self, name: str, tail: int) -> list[str]:
        return ["INFO starting", "lumpwatch: bus.listen: cannot listen on tcp/127.0.0.1:7447"]
