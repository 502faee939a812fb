"""Trains and replays by the command line, as a user does, and judges what was written.

python -m tests.reproduction.real.runner FEEDS --split dev --lumpwatch /path/to/lumpwatch

FEEDS is a folder that `make_feeds` wrote. For each site: `lumpwatch train` on its labelled minute into a fresh
store, `lumpwatch replay` of the minute to watch and of the one without lumps; and the same without training.
A table in markdown goes to standard output, everything to --json.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from tests.reproduction.real.judge import Verdict, judge_folder
from tests.reproduction.real.peers import PEERS, watch_peer

CAMERA, ROI = "feed", "apron"
WAYS = ("trained", "untrained")


@dataclass(frozen=True, slots=True)
class Outcome:
    """One method on one site."""

    site: str
    way: str
    watch: Verdict | None
    quiet: Verdict | None
    train_s: float
    replay_s: float
    problem: str = ""


class CommandError(Exception):
    """The command failed; the text is what it said."""


def run_site(command: Sequence[str], site: Path, way: str, work: Path, extra: Sequence[str] = ()) -> Outcome:
    """Train (or not) and replay."""
    name = site.name
    folder = work / f"{name}-{way}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    trained_s = replayed_s = 0.0
    verdicts: dict[str, Verdict] = {}
    try:
        if way in PEERS:
            for role in _roles(site):
                began = time.monotonic()
                watch_peer(way, site, role, folder / role)
                replayed_s += time.monotonic() - began
        else:
            base = site / ("watch" if (site / "watch").exists() else "quiet")
            config = folder / "site.yaml"
            shutil.copy(base / "site.yaml", config)
            if way == "trained" and (site / "train").exists():
                began = time.monotonic()
                videos = [str(site / "train" / file) for file in ("video.mp4", "gt.txt")]
                where = ["--camera", CAMERA, "--roi", ROI]
                _call([*command, "train", str(config), *videos, *where, *extra], folder, "train")
                trained_s = time.monotonic() - began
            for role in _roles(site):
                began = time.monotonic()
                video = str(site / role / "video.mp4")
                out = ["--camera", CAMERA, "--out", str(folder / role)]
                _call([*command, "replay", str(config), video, *out], folder, f"replay-{role}")
                replayed_s += time.monotonic() - began
        for role in _roles(site):
            verdicts[role] = judge_folder(folder / role, site / role)
    except CommandError as error:
        return Outcome(name, way, None, None, trained_s, replayed_s, str(error))
    return Outcome(name, way, verdicts.get("watch"), verdicts.get("quiet"), trained_s, replayed_s)


def _roles(site: Path) -> list[str]:
    return [role for role in ("watch", "quiet") if (site / role / "about.json").exists()]


def _call(command: Sequence[str], folder: Path, what: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    (folder / f"{what}.log").write_text(done.stdout + done.stderr, encoding="utf-8")
    if done.returncode:
        raise CommandError(f"{what}: {done.stderr.strip().splitlines()[-1:] or done.returncode}")


def run_all(
    command: Sequence[str],
    sites: Sequence[Path],
    ways: Sequence[str],
    work: Path,
    workers: int = 1,
    train_options: Sequence[str] = ("--folds=0",),
) -> list[Outcome]:
    """Every way on every site that has what the way needs; told on standard error as it goes."""
    with ThreadPoolExecutor(workers) as pool:
        waiting = [
            pool.submit(run_site, command, site.absolute(), way, work.absolute(), train_options)
            for site in sites
            for way in ways
            if _complete(site) and (way == "untrained" or (site / "train" / "about.json").exists())
        ]
        outcomes = []
        for one in waiting:
            outcomes.append(one.result())
            sys.stderr.write(_row(outcomes[-1].site, outcomes[-1].way, outcomes[-1:]) + "\n")
    return outcomes


def _complete(site: Path) -> bool:
    """Whether no minute of it is still being written."""
    return any(site.iterdir()) and all(
        (role / "about.json").exists() for role in site.iterdir() if role.is_dir()
    )


def kind_of(site: str) -> str:
    """The kind of a site by its name."""
    return site.rsplit("-", 1)[0]


def table(outcomes: Sequence[Outcome]) -> str:
    """Markdown: a row for each site and way, then sums."""
    rows = [
        "| site | way | announced | late or no alarm, but boxed | warning median s | false, watch | false, quiet "
        "| quiet min | alarm stands, quiet | stray |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    rows += [_row(one.site, one.way, [one]) for one in outcomes]
    ways = list(dict.fromkeys(one.way for one in outcomes))
    for kind in dict.fromkeys(kind_of(one.site) for one in outcomes):
        for way in ways:
            mine = [one for one in outcomes if kind_of(one.site) == kind and one.way == way]
            if len(mine) > 1:
                rows.append(_row(f"**{kind}**", way, mine))
    for way in ways:
        mine = [one for one in outcomes if one.way == way]
        rows.append(_row("**all**", way, mine))
    return "\n".join(rows)


def _row(site: str, way: str, outcomes: Sequence[Outcome]) -> str:
    problems = [one.problem for one in outcomes if one.problem]
    if problems and len(outcomes) == 1:
        return f"| {site} | {way} | failed: {problems[0]} | | | | | | | |"
    watch = [one.watch for one in outcomes if one.watch is not None]
    quiet = [one.quiet for one in outcomes if one.quiet is not None]
    lumps = [lump for one in watch for lump in one.lumps]
    leads = [lump.warned_s for lump in lumps if lump.announced and lump.warned_s is not None]
    boxed = sum(lump.boxed and not lump.announced for lump in lumps)
    minutes = sum(one.seconds for one in quiet) / 60
    cells = [
        f"{len(leads)} of {len(lumps)}" if watch else "-",
        str(boxed) if watch else "-",
        f"{np.median(leads):.1f}" if leads else "-",
        str(sum(one.false_alarms for one in watch)) if watch else "-",
        str(sum(one.false_alarms for one in quiet)) if quiet else "-",
        f"{minutes:.1f}",
        f"{np.mean([one.standing for one in quiet]):.0%}" if quiet else "-",
        f"{np.mean([one.stray for one in watch]):.0%}" if watch else "-",
    ]
    if problems:
        cells[0] += f" ({len(problems)} failed)"
    return f"| {site} | {way} | " + " | ".join(cells) + " |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, judge, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("feeds", type=Path)
    parser.add_argument("--split", default="dev")
    parser.add_argument("--lumpwatch", default=str(Path(sys.executable).with_name("lumpwatch")))
    parser.add_argument("--only", nargs="*", default=[], help="kinds or sites")
    parser.add_argument("--way", nargs="*", choices=(*WAYS, *PEERS), default=list(WAYS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--work", type=Path, help="keep stores and replays here")
    parser.add_argument("--train-option", action="append", default=["--folds=0"])
    asked = parser.parse_args(arguments)
    sites = sorted(path for path in (asked.feeds / asked.split).iterdir() if path.is_dir())
    if asked.only:
        sites = [path for path in sites if path.name in asked.only or kind_of(path.name) in asked.only]
    command = asked.lumpwatch.split()
    with tempfile.TemporaryDirectory() as temporary:
        work = asked.work or Path(temporary)
        outcomes = run_all(command, sites, asked.way, work, asked.jobs, asked.train_option)
    print(table(outcomes))
    if asked.json is not None:
        asked.json.write_text(
            json.dumps([asdict(one) for one in outcomes], indent=1) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
