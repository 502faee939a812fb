"""What a user does to an alarm: a command on the bus with the user's name as the actor."""

from __future__ import annotations

import json
from typing import Any

from lumpwatch.service.bus import Bus, Keys, Role
from lumpwatch.service.config import UserRole
from lumpwatch.service.console.users import User
from lumpwatch.service.core import AlarmRequestError
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import COMMANDS, read_request

_TIMEOUTS_S = {"proof": 150.0}
_ENGINEERS = ("proof",)


class DeedError(LumpwatchError):
    """A deed was not done; `status` is that of the answer by HTTP."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


def needed(name: str) -> UserRole | None:
    """The role that a command needs; None for what is no command of people."""
    row = COMMANDS.get(name)
    if row is None or row.role is not Role.OPERATOR:
        return None
    return UserRole.ENGINEER if name in _ENGINEERS else UserRole.OPERATOR


def do(bus: Bus, site: str, user: User, camera: str, roi: str, name: str, given: dict[str, Any]) -> Any:
    """Give a command and wait for its reply. Raises DeedError."""
    role = needed(name)
    if role is None:
        raise DeedError(404, f"{name[:40]}: is no command")
    if user.role < role:
        raise DeedError(403, f"{name}: needs the role {role.label}, and {user.name} is {user.role.label}")
    try:
        request = read_request(COMMANDS[name].request, {**given, "actor": user.name})
    except AlarmRequestError as error:
        raise DeedError(422, str(error)) from error
    parameters = json.loads(request.model_dump_json(by_alias=True, exclude_none=True))
    key = Keys(site).command(camera, roi, name)
    replies = bus.ask(key, {}, json.dumps(parameters).encode(), timeout_s=_TIMEOUTS_S.get(name, 3.0))
    if not replies:
        raise DeedError(
            504, f"nobody answers for {camera}/{roi}: does its monitor run, and may this console do that?"
        )
    reply = replies[0]
    if reply.payload is None:
        raise DeedError(504 if reply.error == "Timeout" else 409, reply.error or "refused")
    return json.loads(reply.payload)
