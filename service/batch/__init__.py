"""Work on archives: lists of independent tasks, done by processes, a cluster or several runs that share a folder."""

from lumpwatch.service.batch.cluster import ClusterWorkers
from lumpwatch.service.batch.code import code_digest
from lumpwatch.service.batch.finished import Finished, file_identity, key_of
from lumpwatch.service.batch.local import LocalWorkers, WorkerLostError
from lumpwatch.service.batch.run import Progress, run_tasks
from lumpwatch.service.batch.share import Share
from lumpwatch.service.batch.task import Failed, MismatchError, Task

__all__ = [
    "ClusterWorkers",
    "Failed",
    "Finished",
    "LocalWorkers",
    "MismatchError",
    "Progress",
    "Share",
    "Task",
    "WorkerLostError",
    "code_digest",
    "file_identity",
    "key_of",
    "run_tasks",
]
