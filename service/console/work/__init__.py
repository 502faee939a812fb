"""What an engineer works on from the page: clips and their labels, long work in a queue, priors on trial."""

from lumpwatch.service.console.work.errors import ClipError, LabelConflictError, VideoError
from lumpwatch.service.console.work.jobs import Job, JobError, Queue
from lumpwatch.service.console.work.library import About, Kept, Library, Recording
from lumpwatch.service.console.work.orders import (
    Order,
    OrderError,
    body_schemas,
    check_order,
    command,
    read_order,
)
from lumpwatch.service.console.work.tracks import Labels, from_boxes, from_proposals, to_mot
from lumpwatch.service.console.work.trials import (
    Deeds,
    PriorDeed,
    act,
    listing,
    references,
    use_reference,
)
from lumpwatch.service.console.work.workshop import Workshop, open_workshop

__all__ = [
    "About",
    "ClipError",
    "Deeds",
    "Job",
    "JobError",
    "Kept",
    "LabelConflictError",
    "Labels",
    "Library",
    "Order",
    "OrderError",
    "PriorDeed",
    "Queue",
    "Recording",
    "VideoError",
    "Workshop",
    "act",
    "body_schemas",
    "check_order",
    "command",
    "from_boxes",
    "from_proposals",
    "listing",
    "open_workshop",
    "read_order",
    "references",
    "to_mot",
    "use_reference",
]
