"""The command table: one row a command that operators, plant control and programs can give on the bus.

From a row come the key expression, the JSON Schema of the request, the channel in the AsyncAPI document, the rule
of access control, and the label of the metric of refusals. What operators do to alarms has a subcommand of
`lumpwatch`, whose options are the fields of the request.
A row with an `action` is complete: the monitor does it to the alarm. What the others do needs the store or the proof
test and is bound by name in the monitor (`lumpwatch.service.monitor.command_server`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal

from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from lumpwatch.service.bus import Role
from lumpwatch.service.core import (
    AlarmAction,
    acknowledge,
    all_of,
    put_back,
    reset,
    shelve,
    suppress,
    take_out,
    unshelve,
    unsuppress,
)
from lumpwatch.service.protocol.content import Content
from lumpwatch.service.protocol.evidence import EvidenceRequest
from lumpwatch.service.protocol.messages import Record
from lumpwatch.service.protocol.proof import ProofRequest, ProofResult
from lumpwatch.service.protocol.requests import ActReply, AlarmRequest, Name, OptionalReason, Reason, Request
from lumpwatch.service.protocol.verdict import VerdictOutcome, VerdictReply, VerdictRequest


class Lane(StrEnum):
    """Which commands of a camera wait for each other."""

    ALARMS = "alarm commands"
    """Short work in memory."""
    STORE = "store commands"
    """Reads files: no alarm command waits for a slow disk."""
    TEST = "proof tests"
    """Takes as long as a lump takes; one that comes meanwhile is refused."""


@dataclass(frozen=True, slots=True)
class Command:
    """One row. The example shows the request in documents, and its type is the model of the request."""

    name: str
    """Last part of the key, label in the metric of refusals, and name of the subcommand."""
    text: str
    """What it does, in a sentence."""
    role: Role
    example: Request
    action: Callable[[Any], AlarmAction] | None = None
    """From the request to what is done to the alarm: pure. None: it is about something else."""
    lane: Lane = Lane.ALARMS
    reply: type[Record] | Content = ActReply
    puts: bool = False
    """Whether a plain put of the request as JSON does it too."""

    @property
    def request(self) -> type[Request]:
        """The model of the request."""
        return type(self.example)


class AckRequest(AlarmRequest):
    """Acknowledge an alarm."""

    actor: Name
    """Who does it."""


class ResetRequest(AlarmRequest):
    """Reset an alarm that is latched."""

    actor: Name
    """Who does it."""


class ShelveRequest(AlarmRequest):
    """Keep an alarm from being announced for a while."""

    actor: Name
    """Who does it."""
    reason: Reason
    """Why."""
    for_s: float = Field(gt=0.0)
    """For how long, at most `shelve_max_s`."""


class UnshelveRequest(AlarmRequest):
    """End the shelving."""

    actor: Name
    """Who does it."""


class ServiceRequest(AlarmRequest):
    """Take an alarm out of service, or put it back in."""

    actor: Name
    """Who does it."""
    state: Literal["out", "in"]
    """`out` of service, or `in` again."""
    reason: OptionalReason | None = Field(default=None, validate_default=True)
    """Why; needed for `out`."""

    @field_validator("reason")
    @classmethod
    def _needs_reason(cls, reason: str | None, info: ValidationInfo) -> str | None:
        if info.data.get("state") == "out" and not reason:
            raise PydanticCustomError("missing", "is missing")
        return reason


class SuppressRequest(AlarmRequest):
    """A plant signal suppresses an alarm for as long as it is valid."""

    signal: Name
    """Name of the signal."""
    valid_s: float = Field(ge=0.0)
    """For how long, at most `suppress_max_s`; 0 ends it."""


class FeedRequest(Request):
    """What the plant says of a region's feed, for as long as that is valid."""

    signal: Name
    """Name of the signal."""
    valid_s: float = Field(ge=0.0, le=3_600.0)
    """For how long; 0 ends it."""
    runs: bool | None = None
    """Whether the feeder runs; left out: the signal does not say so."""
    speed_mm_s: float | None = Field(default=None, ge=0.0, le=20_000.0)
    """Speed of the belt; left out: the signal does not say so."""


class FeedReply(Record):
    """What became of the plant's signal."""

    taken: bool
    """Whether it is compared with what is seen from now on; false: it has ended."""


class PriorRequest(Request):
    """Ask for the prior in use; it has no parameters."""


def _acknowledge(request: AckRequest) -> AlarmAction:
    return lambda alarm, _, now_s: all_of(acknowledge(alarm, request.actor, now_s))


def _reset(request: ResetRequest) -> AlarmAction:
    return lambda alarm, _, now_s: all_of(reset(alarm, request.actor, now_s))


def _shelve(request: ShelveRequest) -> AlarmAction:
    return lambda alarm, rules, now_s: all_of(
        shelve(alarm, rules, now_s, request.actor, request.reason, request.for_s)
    )


def _unshelve(request: UnshelveRequest) -> AlarmAction:
    return lambda alarm, _, now_s: unshelve(alarm, now_s, request.actor)


def _service(request: ServiceRequest) -> AlarmAction:
    if request.state == "in":
        return lambda alarm, _, now_s: put_back(alarm, now_s, request.actor)
    return lambda alarm, _, now_s: all_of(take_out(alarm, now_s, request.actor, request.reason or ""))


def _suppress(request: SuppressRequest) -> AlarmAction:
    if request.valid_s == 0.0:
        return lambda alarm, _, now_s: unsuppress(alarm, now_s, request.signal)
    return lambda alarm, rules, now_s: all_of(suppress(alarm, rules, now_s, request.signal, request.valid_s))


_ROWS = (
    Command(
        "ack",
        "Acknowledges an alarm.",
        Role.OPERATOR,
        AckRequest(actor="anna"),
        _acknowledge,
    ),
    Command(
        "reset",
        "Resets an alarm that is latched.",
        Role.OPERATOR,
        ResetRequest(actor="anna"),
        _reset,
    ),
    Command(
        "shelve",
        "Shelves an alarm.",
        Role.OPERATOR,
        ShelveRequest(actor="anna", reason="dust from the repair", for_s=1800.0),
        _shelve,
    ),
    Command(
        "unshelve",
        "Ends the shelving.",
        Role.OPERATOR,
        UnshelveRequest(actor="anna"),
        _unshelve,
    ),
    Command(
        "service",
        "Takes an alarm out of service, or puts it back.",
        Role.OPERATOR,
        ServiceRequest(actor="anna", state="out", reason="camera is being moved"),
        _service,
    ),
    Command(
        "suppress",
        "A plant signal suppresses an alarm; also taken as a plain put.",
        Role.PLANT,
        SuppressRequest(signal="feeder-stopped", valid_s=30.0),
        _suppress,
        puts=True,
    ),
    Command(
        "feed",
        "Tells what the plant knows of the feed; also taken as a plain put.",
        Role.PLANT,
        FeedRequest(signal="feeder-drive", valid_s=10.0, runs=True, speed_mm_s=600.0),
        reply=FeedReply,
        puts=True,
    ),
    Command(
        "verdict",
        "Records whether a lump alarm was justified.",
        Role.OPERATOR,
        VerdictRequest(actor="anna", verdict=VerdictOutcome.FALSE, alarm="12", note="dust"),
        lane=Lane.STORE,
        reply=VerdictReply,
    ),
    Command(
        "evidence",
        "Lists evidence and hands it out.",
        Role.ANYONE,
        EvidenceRequest(newest=10),
        lane=Lane.STORE,
        reply=Content(
            "Evidence",
            "JSON of evidence (`lumpwatch schema evidence`, with verdict) or a list of it; with file its bytes.",
            "application/octet-stream",
        ),
    ),
    Command(
        "prior",
        "Asks for the prior in use.",
        Role.ANYONE,
        PriorRequest(),
        lane=Lane.STORE,
        reply=Content(
            "Prior",
            "The bytes of the prior in use, as `lumpwatch priors export` writes them.",
            "application/octet-stream",
        ),
    ),
    Command(
        "proof",
        "Starts a proof test; the reply comes when it has ended.",
        Role.OPERATOR,
        ProofRequest(actor="anna"),
        lane=Lane.TEST,
        reply=ProofResult,
    ),
)

COMMANDS: dict[str, Command] = {row.name: row for row in _ROWS}
"""All of them, by name."""
