from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.console.chromium import chromium
from tests.console.plant import Plant

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def plant() -> Iterator[Plant]:
    made = Plant()
    yield made
    made.close()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One for all: each page of `new_page` has cookies and storage of its own. Sound wants a click there too."""
    with chromium("--autoplay-policy=user-gesture-required") as opened:
        yield opened
