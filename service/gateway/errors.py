"""What can go wrong with the gateway as a whole."""

from __future__ import annotations

from lumpwatch.service.errors import LumpwatchError


class GatewayError(LumpwatchError):
    """The gateway cannot serve."""
