"""What the monitor's loop needs of the proof tests."""

from __future__ import annotations

from typing import Protocol

from lumpwatch.service.core import Trouble
from lumpwatch.service.protocol import ProofResult


class Proofs(Protocol):
    """The proof tests of a camera."""

    def troubles(self, roi: str) -> dict[Trouble, bool]:
        """The troubles that they report to the system alarm of a ROI."""

    def poll(self) -> None:
        """Start a test where one is due."""

    def test(self, roi: str, actor: str) -> ProofResult:
        """Test one ROI now; raises LumpwatchError where that cannot be."""
