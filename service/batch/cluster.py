"""Workers of a Dask cluster, in the shape of `concurrent.futures`. The only place that knows Dask."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from lumpwatch.service.errors import ConfigError, LumpwatchError

_CONNECT_S = 10.0


class ClusterWorkers(Executor):
    """The workers of the cluster whose scheduler listens at an address.

    A worker that is lost costs only what it was doing: the scheduler gives that to another one, and gives a task up
    that has cost several workers. Raises ConfigError without the extra `dask`, LumpwatchError where no scheduler
    or worker answers.
    """

    def __init__(self, address: str, patience_s: float = _CONNECT_S) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise ConfigError("--dask needs the extra `dask`: pip install lumpwatch[dask]") from None
        self._address = address
        try:
            self._client = Client(address, timeout=patience_s, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise LumpwatchError(
                f"--dask {address}: no scheduler answers ({type(error).__name__})"
            ) from error
        try:
            self._client.wait_for_workers(1, timeout=patience_s)
        except TimeoutError:
            self._client.close()
            raise LumpwatchError(f"--dask {address}: the cluster has no worker") from None
        # A task says itself why it fails; another worker would say the same.
        self._executor = self._client.get_executor(pure=False, retries=0)

    def width(self) -> int:
        """How many tasks are done at a time, as the cluster stands now."""
        return max(sum(self._client.nthreads().values()), 1)

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """See `Executor`."""
        # As bytes: the scheduler takes apart what it is given, and would load all that the work needs.
        return self._executor.submit(_call, pickle.dumps((function, arguments, named)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `Executor`. The cluster stays; with `cancel_futures` it is told to drop what it still has of ours."""
        self._executor.shutdown(wait and not cancel_futures)
        self._client.close()

    def __exit__(self, kind: object, *_: object) -> None:
        """Wait for the tasks; where an error or a person ends the work, leave them."""
        self.shutdown(cancel_futures=kind is not None)


def _call(content: bytes) -> Any:
    """What a worker does."""
    function, arguments, named = pickle.loads(content)  # from whom the worker takes code as well
    return function(*arguments, **named)
