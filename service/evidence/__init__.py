"""Evidence of an alarm: clip, still, curve and filter state, kept for people and for an exact replay."""

from lumpwatch.service.evidence.clip import read_frames, write_clip, write_video
from lumpwatch.service.evidence.folder import Evidence, EvidenceError, read_evidence
from lumpwatch.service.evidence.keeper import EvidenceKeeper
from lumpwatch.service.evidence.recorder import Trigger
from lumpwatch.service.evidence.serve import as_json, copy_evidence, fetch_evidence
from lumpwatch.service.evidence.state_file import decode_state
from lumpwatch.service.evidence.store import EvidenceStore
from lumpwatch.service.evidence.verdicts import verdicts_by_id

__all__ = [
    "Evidence",
    "EvidenceError",
    "EvidenceKeeper",
    "EvidenceStore",
    "Trigger",
    "as_json",
    "copy_evidence",
    "decode_state",
    "fetch_evidence",
    "read_evidence",
    "read_frames",
    "verdicts_by_id",
    "write_clip",
    "write_video",
]
