"""Writes feeds out: `python -m tests.reproduction.real.make_feeds OUT --split dev [--only scroll-1 …]`."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import cv2  # noqa: E402

from tests.footage import footage_folder  # noqa: E402
from tests.reproduction.real.cctv import cctv_sites  # noqa: E402
from tests.reproduction.real.feeds import ROLES, make, sites  # noqa: E402
from tests.reproduction.real.ore import Split  # noqa: E402


@dataclass(frozen=True, slots=True)
class Job:
    """One minute to be written."""

    kind: str
    site: str
    role: str
    write: Callable[..., None]
    """Writes it into a folder of its own below the `folder` of its site."""


def jobs(split: Split) -> tuple[list[Job], list[str]]:
    """All minutes of a split that can be made here, and what is missing for others."""
    missing: list[str] = []
    found: list[Job] = []
    ore = footage_folder("belt-ore", "labels.json")
    cctv = footage_folder("belt-cctv", "limestone.mp4", "fines.mp4")
    if ore is None:
        missing.append("the pictures of ore, `belt-ore`: all feeds with lumps")
    else:
        for site in sites(split):
            found += [
                Job(site.kind, site.name, role, partial(make, site, ore, roles=(role,)))
                for role in (ROLES if split != "train" else ROLES[:2])
            ]
    if split == "train":
        return found, missing
    if cctv is None:
        missing.append("the belts of `belt-cctv`: the feeds `cctv`")
    else:
        for belt in cctv_sites(split):
            if ore is not None or not belt.lumps:
                found += [
                    Job(belt.kind, belt.name, role, partial(belt.make, ore, cctv, role=role))
                    for role in belt.roles
                ]
    return found, missing


def write_all(todo: Iterable[Job], out: Path, again: bool = False) -> None:
    """Write what is not there yet."""
    cv2.setNumThreads(1)
    for job in todo:
        folder = out / job.site
        if (folder / job.role / "about.json").exists() and not again:
            continue
        began = time.monotonic()
        job.write(folder=folder)
        print(f"  {folder / job.role}: {time.monotonic() - began:.0f} s", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--split", choices=("train", "dev", "test"), default="dev")
    parser.add_argument("--only", nargs="*", default=[], help="kinds or sites; left out: all")
    parser.add_argument("--again", action="store_true", help="also those that are there")
    asked = parser.parse_args(arguments)
    todo, missing = jobs(asked.split)
    for one in missing:
        sys.stderr.write(f"missing: {one}\n")
    if asked.only:
        todo = [job for job in todo if job.site in asked.only or job.kind in asked.only]
    write_all(todo, asked.out / asked.split, asked.again)


if __name__ == "__main__":
    main()
