"""What is said on the bus and in files: messages, commands, their schemas, and how results become records."""

from lumpwatch.service.protocol.asyncapi import asyncapi_text
from lumpwatch.service.protocol.commands import Parameters, act_of, read, text_of
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
from lumpwatch.service.protocol.requests import ActReply
from lumpwatch.service.protocol.schemas import MESSAGES, message_schema
from lumpwatch.service.protocol.shadow import SIDES, Counts, ShadowState, Side, summary

__all__ = [
    "CAMERA",
    "CLIP",
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
    "BlendPlan",
    "BlendReply",
    "Counts",
    "Ended",
    "EvidenceMeta",
    "Heartbeat",
    "Latency",
    "LumpAt",
    "Outcome",
    "Parameters",
    "ProofReason",
    "ProofRequest",
    "ProofResult",
    "RoiBeat",
    "ShadowState",
    "Side",
    "StateLine",
    "StateMessage",
    "StoredFile",
    "act_of",
    "alarm_event",
    "asyncapi_text",
    "level_of",
    "message_schema",
    "place_at",
    "read",
    "record_id",
    "state_line",
    "state_message",
    "summary",
    "text_of",
]
