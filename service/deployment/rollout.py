"""From the container that runs to the one that is wanted, and back by itself when that is not ready.

Old and new share the bus's and the metrics' port and the store, so the old one is stopped first. What
can be found out before that is: the image is there, and its own `check` takes the configuration.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Protocol

from lumpwatch.service.deployment.bundling import Bundle
from lumpwatch.service.deployment.errors import DeployError
from lumpwatch.service.deployment.plan import Action, Found, Plan, at_fault, cause, decide

_POLL_S = 0.5


class Engine(Protocol):
    """What a roll-out needs of an engine; everything raises DeployError where the engine refuses."""

    def found(self, name: str) -> Found | None:
        """The container of that name."""

    def prepare(self, image: str, bundle: Bundle) -> None:
        """Make and fill the volumes."""

    def complaint(self, image: str, bundle: Bundle) -> str | None:
        """What the image's own `lumpwatch check` says against the configuration."""

    def create(self, name: str, image: str, bundle: Bundle) -> None:
        """Make a container without starting it."""

    def start(self, name: str) -> None:
        """Start a container."""

    def stop(self, name: str) -> None:
        """Stop a container and keep it; nothing starts it again by itself."""

    def rename(self, name: str, new: str) -> None:
        """Give a container, running or not, another name."""

    def remove(self, name: str) -> None:
        """Remove a container, and its configuration unless another container has the same."""

    def health(self, name: str) -> list[str] | None:
        """What keeps the daemon in the container from being ready; None: it does not answer."""

    def logs(self, name: str, tail: int) -> list[str]:
        """The last lines of its log."""


class Rollout:
    """The containers of one site: in use, kept for a roll-back, and on trial."""

    def __init__(
        self,
        engine: Engine,
        name: str,
        timeout_s: float,
        say: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        """`name` is that of the container in use; `timeout_s` is how long a start may take until ready."""
        self._engine = engine
        self._timeout_s = timeout_s
        self._say = say
        self._clock = clock
        self._pause = pause
        self.current, self.previous, self._next = name, f"{name}-previous", f"{name}-next"

    def plan(self, image: str, bundle: Bundle) -> Plan:
        """What `up` would do."""
        return decide(image, bundle.digest, self._engine.found(self.current))

    def up(self, image: str, bundle: Bundle) -> Plan:
        """Do it; returns when the daemon is ready. Raises DeployError, after going back where it can."""
        self._tidy()
        plan = self.plan(image, bundle)
        self._say(f"{self.current}: {plan.action} ({'; '.join(plan.reasons)})")
        if plan.action in (Action.CREATE, Action.REPLACE):
            self._engine.prepare(image, bundle)
            if complaint := self._engine.complaint(image, bundle):
                raise DeployError(f"the image refuses the configuration: {complaint}")
        if plan.action is Action.REPLACE:
            self._engine.create(self._next, image, bundle)
            self._exchange(self._next)
            self._engine.remove(self.previous)
            self._engine.rename(self.current, self.previous)
            self._engine.rename(self._next, self.current)
        else:
            self._begin(plan.action, image, bundle)
        return plan

    def rollback(self) -> None:
        """Exchange the container in use and the one kept; doing it twice changes nothing."""
        self._tidy()
        if self._engine.found(self.previous) is None:
            raise DeployError(f"{self.current}: no earlier container is kept, nothing to go back to")
        self._exchange(self.previous)
        self._engine.rename(self.current, self._next)
        self._engine.rename(self.previous, self.current)
        self._engine.rename(self._next, self.previous)

    def _begin(self, action: Action, image: str, bundle: Bundle) -> None:
        """Without a container to go back to."""
        began = self._clock()
        if action is Action.CREATE:
            self._engine.create(self.current, image, bundle)
        try:
            if action is not Action.NOTHING:
                self._engine.start(self.current)
            self._await(self.current, frozenset())
        except DeployError as error:
            found = self._engine.found(self.current)
            if action is Action.CREATE and (found is None or not found.running or found.restarts):
                self._engine.remove(self.current)
                raise DeployError(f"{error}; it was removed") from error
            raise DeployError(f"{error}; it is left as it is") from error
        self._say(f"{self.current}: ready after {self._clock() - began:.1f} s")

    def _exchange(self, candidate: str) -> None:
        """Stop the current container and start another; the other way round when that is not ready."""
        found = self._engine.found(self.current)
        # A camera that was dead before must not stand in the way of an upgrade for ever.
        before = self._engine.health(self.current) if found and found.running else None
        accepted = at_fault(before or [])
        stopped = self._clock()
        try:
            if found is not None:
                self._engine.stop(self.current)
            self._engine.start(candidate)
            self._await(candidate, accepted)
        except BaseException as error:
            # Also where a person interrupts: nobody watches the feed until one of the two runs.
            if found is None:
                raise
            outcome = self._go_back(candidate, accepted, stopped)
            if not isinstance(error, DeployError):
                raise
            raise DeployError(f"{error}; {outcome}") from error
        self._say(f"{self.current}: ready; {self._clock() - stopped:.1f} s without a decision")

    def _go_back(self, candidate: str, accepted: frozenset[str], stopped: float) -> str:
        """Start the current container again in the candidate's place; says how that ended."""
        with contextlib.suppress(DeployError):
            self._engine.stop(candidate)
        self._engine.start(self.current)
        try:
            self._await(self.current, accepted)
        except DeployError as error:
            return f"went back to the container before, and now that is not ready either: {error}"
        if candidate == self._next:
            self._engine.remove(candidate)
        gap = self._clock() - stopped
        return f"went back to the container before, which is ready again, {gap:.1f} s after it was stopped"

    def _await(self, name: str, accepted: frozenset[str]) -> None:
        """Until the daemon is ready. Raises DeployError when it ends, or is not ready in time.

        At the end of the time, regions that were at fault before (`accepted`) are forgiven.
        """
        deadline = self._clock() + self._timeout_s
        found = self._engine.found(name)
        restarts = found.restarts if found is not None else 0
        while True:
            found = self._engine.found(name)
            if found is None or not found.running or found.restarts > restarts:
                said = self._engine.logs(name, 20) if found is not None else []
                raise DeployError(f"the daemon ended: {cause(said)}")
            problems = self._engine.health(name)
            if problems == []:
                return
            if self._clock() >= deadline:
                if problems is not None and at_fault(problems) <= accepted:
                    self._say(f"as before, not ready: {'; '.join(problems)}")
                    return
                what = "; ".join(problems) if problems else "it does not answer"
                raise DeployError(f"not ready within {self._timeout_s:g} s: {what}")
            self._pause(_POLL_S)

    def _tidy(self) -> None:
        """Clear away what an interrupted roll-out left."""
        left = self._engine.found(self._next)
        if self._engine.found(self.current) is not None:
            if left is not None:
                self._engine.remove(self._next)
            return
        kept = self._engine.found(self.previous)
        for container in (left, kept):
            if container is not None and (container.running or container is left):
                self._engine.rename(container.name, self.current)
                return
