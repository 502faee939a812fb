"""The suites of real pixels, from the pictures to the page: `python -m tests.reproduction real`."""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.reproduction.real import page
from tests.reproduction.real.feeds import sites
from tests.reproduction.real.make_feeds import jobs, write_all
from tests.reproduction.real.runner import WAYS, run_all

DOCS = Path(__file__).parents[3] / "docs"
BUILD = Path(__file__).parents[3] / "build" / "reproduction" / "real"
_OF_FEEDS = ("belts", "cctv", "feeds", "ore", "render", "stones", "strip", "view")


def main(arguments: Sequence[str] = ()) -> None:
    """Make the feeds that are not there yet, run the command on them, write the page."""
    parser = argparse.ArgumentParser("python -m tests.reproduction real", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--split", choices=("dev", "test"), default="test")
    parser.add_argument("--only", nargs="*", default=[], help="kinds or sites; left out: all")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=DOCS, help="folder in the place of docs/")
    asked = parser.parse_args(arguments)
    todo, missing = jobs(asked.split)
    if asked.only:
        todo = [job for job in todo if job.site in asked.only or job.kind in asked.only]
    feeds = BUILD / f"feeds-{_digest()}" / asked.split
    write_all(todo, feeds)
    command = [str(Path(sys.executable).with_name("lumpwatch"))]
    folders = [feeds / site for site in dict.fromkeys(job.site for job in todo)]
    outcomes = run_all(command, folders, (*WAYS, "mog2", "contours"), BUILD / "work", asked.jobs)
    path = asked.out / "results" / "real.md"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page.write(outcomes, sites(asked.split), asked.split, missing), encoding="utf-8")
    print(f"  wrote {path}")


def _digest() -> str:
    """Of the code that makes feeds: those of other code are not taken."""
    total = hashlib.sha256()
    for name in _OF_FEEDS:
        total.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    return total.hexdigest()[:12]
