"""The contract with other programs: every message by name, and the AsyncAPI document of all keys."""

from __future__ import annotations

import json

from pydantic import BaseModel

from lumpwatch.service.bus import FrameHeader
from lumpwatch.service.protocol.evidence import EvidenceMeta
from lumpwatch.service.protocol.messages import AlarmEvent, Heartbeat, Level, StateLine, StateMessage
from lumpwatch.service.protocol.proof import BlendPlan, BlendReply, ProofRequest, ProofResult
from lumpwatch.service.protocol.requests import (
    AckRequest,
    ActReply,
    ResetRequest,
    ServiceRequest,
    ShelveRequest,
    SuppressRequest,
    UnshelveRequest,
)
from lumpwatch.service.protocol.shadow import ShadowState

MESSAGES: dict[str, type[BaseModel]] = {
    "alarm": AlarmEvent,
    "state": StateMessage,
    "heartbeat": Heartbeat,
    "level": Level,
    "replay": StateLine,
    "shadow": ShadowState,
    "frame": FrameHeader,
    "ack": AckRequest,
    "reset": ResetRequest,
    "shelve": ShelveRequest,
    "unshelve": UnshelveRequest,
    "service": ServiceRequest,
    "suppress": SuppressRequest,
    "act-reply": ActReply,
    "proof": ProofRequest,
    "proof-result": ProofResult,
    "blend": BlendPlan,
    "blend-reply": BlendReply,
    "evidence": EvidenceMeta,
}
"""By the name under which `lumpwatch schema` prints them."""


def message_schema(name: str) -> str:
    """The JSON Schema of one message as text."""
    return json.dumps(MESSAGES[name].model_json_schema(mode="serialization"), indent=2, sort_keys=True)
