"""One stream of what is new, for any number of pages: put together once, and only while somebody listens."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from typing import Any

EVERY_S, AT_LEAST_S = 0.25, 1.0
"""Not more often, and not more seldom, than this a page hears something."""
_LOOK_S = 0.05


class Stream:
    """The newest snapshot as server-sent events. A page that is slow misses snapshots; none waits for it."""

    def __init__(
        self, snapshot: Callable[[], dict[str, Any]], version: Callable[[], tuple[int, int]]
    ) -> None:
        """`version` counts what has come, and what is urgent of it: an alarm record goes out at once."""
        self._snapshot = snapshot
        self._version = version
        self._listeners = 0
        self._serial = 0
        self._latest = b""
        self._task: asyncio.Task[None] | None = None
        self._news = asyncio.Event()

    @property
    def listeners(self) -> int:
        """How many pages listen."""
        return self._listeners

    async def events(self, welcome: Callable[[], bool] = lambda: True) -> AsyncIterator[bytes]:
        """The events for one page, as long as it is welcome."""
        self._listeners += 1
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._turn())
        seen = -1
        try:
            yield b"retry: 500\n\n"
            while welcome():
                if seen == self._serial or not self._latest:
                    news = self._news
                    await news.wait()
                    continue
                seen = self._serial
                yield self._latest
        finally:
            self._listeners -= 1

    async def _turn(self) -> None:
        loop = asyncio.get_running_loop()
        told, told_s = (-1, -1), -1e9
        while self._listeners:
            version, now = self._version(), loop.time()
            urgent = version[1] != told[1]
            due = version != told and now - told_s >= EVERY_S
            if urgent or due or now - told_s >= AT_LEAST_S:
                told, told_s = version, now
                content = json.dumps(self._snapshot(), separators=(",", ":"))
                self._latest = f"data: {content}\n\n".encode()
                self._serial += 1
                news, self._news = self._news, asyncio.Event()
                news.set()
            await asyncio.sleep(_LOOK_S)
        self._latest = b""
