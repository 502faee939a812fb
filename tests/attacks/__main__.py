"""Does as many of each attack as wanted, and says what became of them: `python -m tests.attacks --count 10000`."""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

from tests.attacks.kinds import KINDS


def main() -> int:
    """The exit code: 0 where all was taken or refused, 1 where anything else came."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=1000, help="of each kind")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", choices=list(KINDS), action="append", help="one kind (may be repeated)")
    chosen = options.parse_args()
    logging.disable(logging.CRITICAL)
    findings = 0
    for name, kind in KINDS.items():
        if chosen.only and name not in chosen.only:
            continue
        began, became = time.monotonic(), Counter[str]()
        with tempfile.TemporaryDirectory() as folder, kind(Path(folder)) as attack:
            for number in range(chosen.count):
                try:
                    became[attack(np.random.default_rng((chosen.seed, number)))] += 1
                except Exception:
                    became["FINDING"] += 1
                    sys.stderr.write(f"{name}, seed {chosen.seed}, number {number}\n{traceback.format_exc()}")
        findings += became["FINDING"]
        told = ", ".join(f"{count} {what}" for what, count in sorted(became.items()))
        sys.stdout.write(f"{name}: {told}, in {time.monotonic() - began:.0f} s\n")
        sys.stdout.flush()
    return min(1, findings)


if __name__ == "__main__":
    sys.exit(main())
