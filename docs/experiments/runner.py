"""Runs the commands of an experiment in a folder of its own and reads the figures that the last one prints."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from docs.experiments.data import pets_data, square_data, traffic_data

HERE = Path(__file__).parent
EXPERIMENTS = ("square", "pets", "traffic")


def figures(name: str, folder: Path, footage: Path) -> dict[str, float]:
    """Make the data in `folder` and run the commands there.

    Raises FileNotFoundError where footage is missing, and CalledProcessError where a command fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if name == "pets":
        pets_data(footage, folder)
    else:
        {"square": square_data, "traffic": traffic_data}[name](folder)
    shutil.copy(HERE / name / "site.yaml", folder)
    shutil.rmtree(folder / "var", ignore_errors=True)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    surroundings = os.environ | {"PATH": path, "PYTHONPATH": str(HERE.parents[1])}
    done = ""
    for command in (HERE / name / "commands.sh").read_text(encoding="utf-8").splitlines():
        result = subprocess.run(
            command.split(), cwd=folder, env=surroundings, check=True, stdout=subprocess.PIPE, text=True
        )
        done = result.stdout
    return {key: value for key, value in json.loads(done).items() if value is not None}


def compared(name: str, found: dict[str, float]) -> list[tuple[str, bool]]:
    """A line for each expected figure, and whether it is met: as good, but for the spread given beside it."""
    expected = json.loads((HERE / name / "expected.json").read_text(encoding="utf-8"))
    lines = []
    for key, (value, spread, better) in expected.items():
        short = value - found[key] if better == "larger" else found[key] - value
        lines.append((f"{key} {found[key]:.3f}, expected {value:g} within {spread:g}", bool(short <= spread)))
    return lines
