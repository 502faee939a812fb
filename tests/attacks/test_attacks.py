"""A few of each kind of attack: all are taken or refused with one plain line, nothing else comes."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.attacks.kinds import KINDS, REFUSED

COUNTS = {
    "damaged event logs": 20,
    "Modbus requests": 40,
    "requests to the page": 60,
    "configurations": 30,
    "priors with a right checksum": 30,
}


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_but_taken_or_refused(kind: str, tmp_path: Path) -> None:
    count = COUNTS.get(kind, 300)
    with KINDS[kind](tmp_path) as attack:
        became = Counter(attack(np.random.default_rng((1, number))) for number in range(count))
    assert became.total() == count
    assert became[REFUSED] > 0
