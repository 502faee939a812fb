"""What is kept on disk: atomic, checksummed, versioned."""

from lumpwatch.service.storage.arrays import load_arrays
from lumpwatch.service.storage.atomic import replace_file, write_new_file
from lumpwatch.service.storage.checksummed import SealError, seal, unseal
from lumpwatch.service.storage.event import Details, Event
from lumpwatch.service.storage.event_log import (
    Entry,
    EventLogError,
    alarm_of,
    event_file,
)
from lumpwatch.service.storage.event_log_reader import merged_events, read_events, reading
from lumpwatch.service.storage.event_log_writer import EventWriter, Retention
from lumpwatch.service.storage.event_notes import (
    Span,
    Verdict,
    VerdictOutcome,
    latest_verdicts,
    raised_alarm,
    uptime_spans,
)
from lumpwatch.service.storage.fit_arrays import encode_fit, known_lump
from lumpwatch.service.storage.footage_archive import FootageArchive
from lumpwatch.service.storage.label_file import (
    Box,
    LabelError,
    check_frames,
    ignored_boxes,
    ignored_frames,
    is_proposal,
    read_labels,
)
from lumpwatch.service.storage.lock import lock_cameras
from lumpwatch.service.storage.lump_cuts import LumpCutError, decode_cuts, encode_cuts
from lumpwatch.service.storage.prior_file import Prior, PriorError, PriorMeta, decode_prior, encode_prior
from lumpwatch.service.storage.prior_store import Found, PriorStore, check_owner, read_file
from lumpwatch.service.storage.reference_store import (
    BadReferenceError,
    Reference,
    ReferenceMeta,
    ReferenceStore,
)
from lumpwatch.service.storage.shadow_store import StateKeeper, read_state
from lumpwatch.service.storage.versions import StoreError

__all__ = [
    "BadReferenceError",
    "Box",
    "Details",
    "Entry",
    "Event",
    "EventLogError",
    "EventWriter",
    "FootageArchive",
    "Found",
    "LabelError",
    "LumpCutError",
    "Prior",
    "PriorError",
    "PriorMeta",
    "PriorStore",
    "Reference",
    "ReferenceMeta",
    "ReferenceStore",
    "Retention",
    "SealError",
    "Span",
    "StateKeeper",
    "StoreError",
    "Verdict",
    "VerdictOutcome",
    "alarm_of",
    "check_frames",
    "check_owner",
    "decode_cuts",
    "decode_prior",
    "encode_cuts",
    "encode_fit",
    "encode_prior",
    "event_file",
    "ignored_boxes",
    "ignored_frames",
    "is_proposal",
    "known_lump",
    "latest_verdicts",
    "load_arrays",
    "lock_cameras",
    "merged_events",
    "raised_alarm",
    "read_events",
    "read_file",
    "read_labels",
    "read_state",
    "reading",
    "replace_file",
    "seal",
    "unseal",
    "uptime_spans",
    "write_new_file",
]
