"""The net that is trained, in PyTorch; `lumpwatch.models.likelihood.net` runs it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from lumpwatch.models.likelihood.net import DEEP, DEEPEST, FINE, HEADS, MIDDLE, STEM

_SHARE = 0.5
"""What a deep layer adds counts so much."""
_SHARED = "deep0", "deep1", "deep2", "deepest0", "deepest1", "gathered"


class BodyNet(nn.Module):
    """Normalised pictures (n, 4, h / 4, w / 4) -> maps (n, 6, h / 4, w / 4), see `lumpwatch.models.likelihood.net`."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Conv2d(STEM, FINE, 3, padding=1)
        self.fine = nn.Conv2d(FINE, FINE, 3, padding=1)
        self.down = nn.Conv2d(FINE, MIDDLE, 3, stride=2, padding=1)
        self.middle = nn.Conv2d(MIDDLE, MIDDLE, 3, padding=1)
        self.deeper = nn.Conv2d(MIDDLE, DEEP, 3, stride=2, padding=1)
        self.deep0 = nn.Conv2d(DEEP, DEEP, 3, padding=1)
        self.deep1 = nn.Conv2d(DEEP, DEEP, 3, padding=1)
        self.deep2 = nn.Conv2d(DEEP, DEEP, 3, padding=1)
        self.deepest = nn.Conv2d(DEEP, DEEPEST, 3, stride=2, padding=1)
        self.deepest0 = nn.Conv2d(DEEPEST, DEEPEST, 3, padding=1)
        self.deepest1 = nn.Conv2d(DEEPEST, DEEPEST, 3, padding=1)
        self.rise = nn.Conv2d(DEEPEST, DEEP, 1)
        self.gathered = nn.Conv2d(DEEP, DEEP, 3, padding=1)
        self.up = nn.Conv2d(DEEP, MIDDLE, 1)
        self.joined = nn.Conv2d(MIDDLE, MIDDLE, 3, padding=1)
        self.upper = nn.Conv2d(MIDDLE, FINE, 1)
        self.finish = nn.Conv2d(FINE, FINE, 3, padding=1)
        self.heads = nn.Conv2d(FINE, len(HEADS), 1)
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d):
                nn.init.kaiming_normal_(layer.weight)
                if layer.bias is not None:
                    nn.init.zeros_(layer.bias)
        nn.init.normal_(self.heads.weight, std=0.05)
        first = torch.tensor([-1.0, -1.0, 2.5, 2.5, 2.5, 2.5])
        self.heads.bias = nn.Parameter(first)

    def forward(self, x: Tensor) -> Tensor:
        """The maps."""
        relu = functional.relu
        x = relu(self.stem(x))
        fine = x + relu(self.fine(x))
        x = relu(self.down(fine))
        middle = x + relu(self.middle(x))
        x = relu(self.deeper(middle))
        for layer in (self.deep0, self.deep1, self.deep2):
            x = x + _SHARE * relu(layer(x))
        deep = x
        x = relu(self.deepest(deep))
        for layer in (self.deepest0, self.deepest1):
            x = x + _SHARE * relu(layer(x))
        x = deep + functional.interpolate(self.rise(x), scale_factor=2.0, mode="nearest")
        x = x + _SHARE * relu(self.gathered(x))
        x = middle + functional.interpolate(self.up(x), scale_factor=2.0, mode="nearest")
        x = x + relu(self.joined(x))
        x = fine + functional.interpolate(self.upper(x), scale_factor=2.0, mode="nearest")
        x = x + relu(self.finish(x))
        return self.heads(x)

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """Weights and offsets by name, as they ship; the share of the deep layers is in them."""
        out = {}
        for name, value in self.state_dict().items():
            factor = _SHARE if name.split(".")[0] in _SHARED else 1.0
            out[name.replace(".", "_")] = (factor * value).numpy().astype(np.float32)
        return out
