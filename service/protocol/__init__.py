"""The contract of the bus and of files: messages, commands, their schemas, and how results become records."""

from lumpwatch.service.protocol.asyncapi import asyncapi_text
from lumpwatch.service.protocol.commands import COMMANDS, Cli, Command, Lane, PriorRequest
from lumpwatch.service.protocol.evidence import (
    CAMERA,
    CLIP,
    META,
    PRIOR,
    STATE,
    STATES,
    STILL,
    TIMES,
    Ended,
    EvidenceMeta,
    EvidenceRequest,
    StoredFile,
)
from lumpwatch.service.protocol.messages import (
    AlarmData,
    AlarmEvent,
    Heartbeat,
    Latency,
    RoiBeat,
    StateLine,
    StateMessage,
)
from lumpwatch.service.protocol.proof import (
    BlendPlan,
    BlendReply,
    LumpAt,
    Outcome,
    ProofReason,
    ProofRequest,
    ProofResult,
)
from lumpwatch.service.protocol.proof_path import place_at
from lumpwatch.service.protocol.records import alarm_event, level_of, record_id, state_line, state_message
from lumpwatch.service.protocol.requests import ActReply, AlarmRequest, Request, read_request
from lumpwatch.service.protocol.schemas import MESSAGES, message_schema
from lumpwatch.service.protocol.shadow import SIDES, Counts, ShadowState, Side, summary
from lumpwatch.service.protocol.verdict import VerdictOutcome, VerdictReply, VerdictRequest

__all__ = [
    "CAMERA",
    "CLIP",
    "COMMANDS",
    "MESSAGES",
    "META",
    "PRIOR",
    "SIDES",
    "STATE",
    "STATES",
    "STILL",
    "TIMES",
    "ActReply",
    "AlarmData",
    "AlarmEvent",
    "AlarmRequest",
    "BlendPlan",
    "BlendReply",
    "Cli",
    "Command",
    "Counts",
    "Ended",
    "EvidenceMeta",
    "EvidenceRequest",
    "Heartbeat",
    "Lane",
    "Latency",
    "LumpAt",
    "Outcome",
    "PriorRequest",
    "ProofReason",
    "ProofRequest",
    "ProofResult",
    "Request",
    "RoiBeat",
    "ShadowState",
    "Side",
    "StateLine",
    "StateMessage",
    "StoredFile",
    "VerdictOutcome",
    "VerdictReply",
    "VerdictRequest",
    "alarm_event",
    "asyncapi_text",
    "level_of",
    "message_schema",
    "place_at",
    "read_request",
    "record_id",
    "state_line",
    "state_message",
    "summary",
]
