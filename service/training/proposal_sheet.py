"""The contact sheet of proposals: one numbered picture a lump, for a person to say yes or no."""

from __future__ import annotations

from collections.abc import Sequence

from lumpwatch.service.offline import (
    html_figure,
    html_page,
    html_paragraph,
    html_photo,
    html_section,
    html_text,
)
from lumpwatch.service.training.proposing import Suggestion


def contact_sheet(suggestions: Sequence[Suggestion], video: str, command: str) -> str:
    """The page; `command` is what accepts, as a person would type it."""
    figures = []
    for suggestion in suggestions:
        proposal = suggestion.proposal
        image = html_photo(suggestion.picture, f"proposal {proposal.id}")
        frames = f"frames {proposal.boxes[0].frame} to {proposal.boxes[-1].frame}"
        caption = (
            f"{proposal.id}: {suggestion.first_s:.1f} to {suggestion.last_s:.1f} s, {frames}, "
            f"P = {proposal.existence:.2f}"
        )
        figures.append(html_figure(image, caption))
    many = f"{len(suggestions)} proposal{'' if len(suggestions) == 1 else 's'}"
    words = (
        "Each picture shows one proposed lump at its surest moment. Accept those that are large lumps, by taking "
        "the numbers of the others out of the command below; those are then learned as background. Lumps that are "
        "missing here are no label yet: add them by hand, or leave them out by rows with conf 0."
    )
    parts = [html_paragraph(words), f"<pre>{html_text(command)}</pre>"]
    return html_page(
        f"Proposals for {video}",
        [*parts, html_section(many, ['<div class="sheet">', *figures, "</div>"])],
    )
