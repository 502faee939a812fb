from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.console.plant import Plant


@pytest.fixture(scope="module")
def plant() -> Iterator[Plant]:
    made = Plant()
    yield made
    made.close()
