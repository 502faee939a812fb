"""What is to be done to come from what runs to what is wanted; pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Action(StrEnum):
    """What `up` does."""

    NOTHING = "nothing to do"
    START = "start"
    CREATE = "create"
    REPLACE = "replace"


@dataclass(frozen=True, slots=True)
class Found:
    """One container as the engine has it."""

    name: str
    image: str
    """Id of its image."""
    digest: str
    """Fingerprint of what it was given."""
    status: str
    """In the engine's words: `running`, `exited`, …"""
    since: str = ""
    restarts: int = 0
    config_volume: str = ""

    @property
    def running(self) -> bool:
        """Whether its process exists."""
        return self.status == "running"


@dataclass(frozen=True, slots=True)
class Plan:
    """The action, and why."""

    action: Action
    reasons: tuple[str, ...]


def decide(image: str, digest: str, current: Found | None) -> Plan:
    """What to do so that the site runs that image with that fingerprint."""
    if current is None:
        return Plan(Action.CREATE, ("no container of this site exists",))
    reasons = []
    if current.image != image:
        reasons.append(f"image {short_name(current.image)} becomes {short_name(image)}")
    if current.digest != digest:
        reasons.append("configuration, secrets or limits have changed")
    if reasons:
        return Plan(Action.REPLACE, tuple(reasons))
    if not current.running:
        return Plan(Action.START, (f"the container is {current.status}",))
    return Plan(Action.NOTHING, ("same image, same configuration, running",))


def short_name(image: str) -> str:
    """An image's id as people write it."""
    return image.removeprefix("sha256:")[:12]


def at_fault(problems: list[str]) -> frozenset[str]:
    """The regions, `camera/roi`, that a list of health problems names; other problems as they are."""
    return frozenset(problem.partition(": ")[0] for problem in problems)


def cause(lines: list[str]) -> str:
    """The last word of a daemon that ended: its one line of error, or else the end of its log."""
    messages = [line.removeprefix("lumpwatch: ") for line in lines if line.startswith("lumpwatch: ")]
    return messages[-1] if messages else " ".join(" ".join(lines[-3:]).split())[:400] or "it says nothing"
