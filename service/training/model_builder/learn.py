"""Training the net: pictures with truth -> weights."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from lumpwatch.models.likelihood.net import REACH, normalised
from lumpwatch.service.training.model_builder.net import BodyNet

_BATCH = 16
_RATE = 2.5e-3
_DECAY = 1e-4
_AVERAGE = 0.998
_OUTSIDE = 0.4
"""What a cell beside the belt counts."""
_EDGE, _SIDES = 0.5, 0.7
"""What the losses of outlines and of distances count."""

Arrays = dict[str, NDArray[np.generic]]


def read(files: Sequence[Path]) -> Arrays:
    """Pictures and maps of several files as one."""
    parts = []
    for file in files:
        with np.load(file) as archive:
            parts.append({key: archive[key] for key in ("grey", "body", "edge", "sides", "inside")})
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def batches(pictures: Arrays, rng: np.random.Generator) -> Iterator[tuple[Tensor, ...]]:
    """Batches without end, mirrored and seen in other lights."""
    count = len(pictures["grey"])
    while True:
        order = rng.permutation(count)
        for first in range(0, count - _BATCH + 1, _BATCH):
            chosen = order[first : first + _BATCH]
            seen, maps = [], []
            for k in chosen:
                across, down = bool(rng.integers(2)), bool(rng.integers(2))
                grey = _altered(pictures["grey"][k], rng)
                one = [pictures[key][k].astype(np.float32) for key in ("body", "edge", "inside")]
                sides = pictures["sides"][k].astype(np.float32)
                if across:
                    grey, one = grey[:, ::-1], [m[:, ::-1] for m in one]
                    sides = sides[[2, 1, 0, 3], :, ::-1]
                if down:
                    grey, one = grey[::-1], [m[::-1] for m in one]
                    sides = sides[[0, 3, 2, 1], ::-1]
                seen.append(normalised(np.ascontiguousarray(grey)))
                maps.append(np.concatenate([np.stack(one), sides]))
            yield torch.from_numpy(np.stack(seen)), torch.from_numpy(np.stack(maps))


def _altered(grey: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    if rng.random() < 0.4:
        curve = 255.0 * (np.arange(256) / 255.0) ** np.exp(rng.normal(0.0, 0.35))
        grey = np.asarray(cv2.LUT(grey, np.clip(curve, 0, 255).astype(np.uint8)), np.uint8)
    if rng.random() < 0.03:
        grey = 255 - grey
    if rng.random() < 0.3:
        noise = rng.uniform(0.5, 6.0) * rng.standard_normal(grey.shape, dtype=np.float32)
        grey = np.clip(grey + noise, 0, 255).astype(np.uint8)
    return grey


def losses(out: Tensor, maps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Of bodies, outlines and distances."""
    body, edge, inside, sides = maps[:, 0], maps[:, 1], maps[:, 2], maps[:, 3:]
    weight = (body >= 0) * (_OUTSIDE + (1.0 - _OUTSIDE) * inside)
    of_body = functional.binary_cross_entropy_with_logits(out[:, 0], body.clamp(min=0.0), reduction="none")
    of_edge = functional.binary_cross_entropy_with_logits(out[:, 1], edge, reduction="none")
    on_body = (body > 0).float()
    area = ((sides[:, 0] + sides[:, 2]) * (sides[:, 1] + sides[:, 3])).clamp(min=100.0)
    share = on_body * area**-0.2
    apart = functional.smooth_l1_loss(out[:, 2:], torch.log(sides + REACH), beta=0.15, reduction="none").mean(
        dim=1
    )
    return (
        (weight * of_body).sum() / weight.sum(),
        (weight * of_edge).sum() / weight.sum(),
        (share * apart).sum() / share.sum().clamp(min=1e-6),
    )


def train(
    pictures: Callable[[], Arrays], seconds: float, seed: int, start: Path | None = None,
    told: Callable[[str], None] = print, checkpoint: Path | None = None, steps: int | None = None,
) -> BodyNet:  # fmt: skip
    """A net trained for so many steps, or seconds where those are not given; `pictures` is asked now and then."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    net = BodyNet()
    if start is not None:
        net.load_state_dict(torch.load(start))
    average = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), lr=_RATE, weight_decay=_DECAY)
    began, step, seen = time.monotonic(), 0, np.zeros(3)
    source = batches(pictures(), rng)
    while True:
        part = step / steps if steps is not None else (time.monotonic() - began) / seconds
        if part >= 1.0:
            break
        rate = _RATE * min(1.0, (step + 1) / 150) * 0.5 * (1.0 + np.cos(np.pi * part))
        for group in optimiser.param_groups:
            group["lr"] = rate
        x, maps = next(source)
        # The net's maps may be some rows longer than the picture's.
        parts = losses(net(x)[..., : maps.shape[2], : maps.shape[3]], maps)
        total = parts[0] + _EDGE * parts[1] + _SIDES * parts[2]
        optimiser.zero_grad()
        total.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(net.parameters(), 2.0)
        optimiser.step()
        keep = min(_AVERAGE, (step + 1) / (step + 20))
        with torch.no_grad():
            for kept, new in zip(average.parameters(), net.parameters(), strict=True):
                kept.lerp_(new, 1.0 - keep)
        seen += [float(one.detach()) for one in parts]
        step += 1
        if step % 100 == 0:
            mean = " ".join(f"{value:.4f}" for value in seen / 100)
            told(f"{step} steps, {time.monotonic() - began:.0f} s, {part:.0%}: body, edge, sides {mean}")
            seen[:] = 0
        if step % 500 == 0:
            if checkpoint is not None:
                torch.save(average.state_dict(), checkpoint)
            if steps is None:
                source = batches(pictures(), rng)
    if checkpoint is not None:
        torch.save(average.state_dict(), checkpoint)
    return average
