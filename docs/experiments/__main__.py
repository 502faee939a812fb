"""`python -m docs.experiments [square|pets|traffic …]`: make the data, run the commands, compare the figures.

Each experiment is a folder with a `site.yaml`, the `commands.sh` that a reader would type, and the `expected.json`
that they give. `--folder` keeps clips, priors and replays; `--footage` is where real footage lies. Exit code 1 where
a figure is worse than expected. `--pages` writes the results page of pets, docs/results/paper2.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from docs.experiments.pets import page
from docs.experiments.runner import EXPERIMENTS, HERE, compared, figures

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.experiments", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *EXPERIMENTS], help="experiments (default: all)")
    parser.add_argument("--folder", type=Path, help="where clips and results are kept")
    parser.add_argument("--footage", type=Path, default=Path("../shared/data"), help="real footage")
    parser.add_argument("--pages", action="store_true", help="write the results page of pets")
    arguments = parser.parse_args()
    good = True
    with tempfile.TemporaryDirectory() as temporary:
        for name in arguments.names or EXPERIMENTS:
            folder = (arguments.folder or Path(temporary)) / name
            try:
                found = figures(name, folder, arguments.footage)
            except FileNotFoundError as error:
                sys.stdout.write(f"{name}: skipped, {error.filename} is missing\n")
                continue
            if arguments.pages and name == "pets":
                (HERE.parent / "results" / "paper2.md").write_text(page.write(found), encoding="utf-8")
            for line, met in compared(name, found):
                good &= met
                sys.stdout.write(f"{name}: {line}\n")
    sys.exit(0 if good else 1)
