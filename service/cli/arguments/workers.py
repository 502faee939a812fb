"""Options that several commands have."""

from __future__ import annotations

import argparse
from pathlib import Path


def _share(text: str) -> object:
    """A `Share` of the work. Raises ConfigError."""
    from lumpwatch.service.batch import Share

    return Share.parse(text)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="processes of this machine (default: as many as cores)"
    )
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="let the workers of this Dask cluster do it (tcp://host:8786); they see the videos under the same paths "
        "and have the same lumpwatch installed; needs the extra dask",
    )
    parser.add_argument(
        "--worker-mb",
        type=int,
        default=2048,
        metavar="MIB",
        help="memory that one of these processes may take (default 2048; on a cluster its own --memory-limit holds)",
    )


def add_resuming(parser: argparse.ArgumentParser) -> None:
    """Add the options of runs that are interrupted, or shared by several."""
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="DIR",
        help="keep the result of each finished video here, and take what an earlier run finished from here",
    )
    parser.add_argument(
        "--share",
        type=_share,
        metavar="INDEX/COUNT",
        help="do this share of the work alone, from 0/COUNT on, into --resume, and report nothing; a last run without "
        "--share reports on all (one pod of a Kubernetes Job does one share)",
    )
