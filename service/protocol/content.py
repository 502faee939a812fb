"""Messages that are not JSON, or have a header, as documents describe them."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel


@dataclass(frozen=True, slots=True)
class Content:
    """A message that no model describes as a whole."""

    name: str
    text: str
    content_type: str
    headers: type[BaseModel] | None = None
