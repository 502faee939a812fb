"""From a trained prior to one in use: stored, judged, and only then switched to.

What was stored and is not in use when anything stops the judgement (an error, Ctrl-C, a lost terminal) stays a
version that has never been in use; the one before goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lumpwatch.service.storage import Prior, PriorStore
from lumpwatch.service.training.cross_validation import Validation


@dataclass(frozen=True, slots=True)
class Acceptance:
    """What became of a training."""

    prior: Prior
    """With its version."""
    objection: str | None
    """Why it is not in use; None where it is, or runs in shadow as was wanted."""


def accept(
    store: PriorStore,
    prior: Prior,
    judge: Callable[[Prior], str | None],
    *,
    shadow: bool = False,
    use_anyway: bool = False,
) -> Acceptance:
    """Store a prior, have it judged, then use it or run it in shadow. Raises StoreError, and what `judge` raises.

    `judge` is given the stored version and says what speaks against its use, which `use_anyway` overrides. A
    trial in shadow decides nothing and needs no good judgement.
    """
    camera, roi = prior.meta.camera, prior.meta.roi
    stored = store.stage(prior)
    objection = judge(stored)
    if shadow:
        store.set_shadow(camera, roi, stored.version)
    elif objection is None or use_anyway:
        store.use(camera, roi, stored.version)
    else:
        return Acceptance(stored, objection)
    return Acceptance(stored, None)


def objection_to(validation: Validation | None) -> str | None:
    """What a cross-validation has against the use of a prior; None also where there was none to be had."""
    if validation is None:
        return None
    if not validation.lumps:
        return "no lump could be judged by what the others teach"
    if validation.whole and not validation.found:
        return f"none of {len(validation.whole)} held-out lumps was found by what the others teach"
    return None
