"""Writes docs/simulator.md and its contact sheet: `python -m tests.reproduction.simulator`."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import NDArray

from lumpwatch.service.simulator.feed import FeedSimulator, Truth
from lumpwatch.service.simulator.spec import FeedSpec
from tests.reproduction.matrix import (
    LONG_SEEDS,
    STANDARD,
    TEST_EMPTY_SEEDS,
    TEST_SEEDS,
    TRAIN_EMPTY_SEEDS,
    TRAIN_SEEDS,
    Scene,
    scenes,
)

DOCS = Path(__file__).parents[2] / "docs"
_COLUMNS, _WIDTH, _HEIGHT, _SHOWN = 6, 320, 240, (240, 180)
_SEED, _FROM_S, _UNTIL_S, _FPS = 1003, 6.0, 36.0, 2.0
# A still does not show these; of the others the last step, or every one where steps differ in kind.
_UNSEEN = {"shake", "knock", "belt", "fps", "near-limit"}
_EVERY = {"size", "contrast", "kind", "company", "light", "mixed"}
_OPENING = """# The simulated feed

`sim:feed` is a crusher's feeder without a mine: a camera of the demo, a source of labelled video, and the bench of
the tests. It is deterministic (the same options give the same bytes) and knows the truth about every lump: box,
motion model (`belt` or `fall`), visibility, longest diameter in millimetres, and time to the lip.

```sh
lumpwatch simulate out/feed --for 60s --seed 3 --set "style=b&dust=0.6&night=0.5&h264_crf=36"
```

In a configuration the same options stand in the address of a source, `url: "sim:feed?style=b&dust=0.6"`.

The pictures show scenes of the matrix below, each at a moment at which it differs much from the standard scene,
with lumps framed as the truth has them. What a still cannot show (shake, stops, frame rate) is left out.

![One picture of each scene](images/simulator.png)

Two styles differ in all that a filter could get used to: camera, width of the belt, how ore and rocks are made,
light, and what stands beside the belt. In style a rocks are painted, in style b they are bodies with facets, lit
from anywhere, that throw shadows; the kinds of lumps and lumps that roll are bodies in both. What was tuned on
one style should be tried on the other.

## What the truth means

- The box is that of the part of the lump that shows: inside the picture, above the rim, not buried. Rocks
  in front of a lump are not taken off.
- `size_mm` is the longest diameter of the whole lump. Of a body it is that of the body in space; it looks up to a
  third shorter when it points at the camera. Of a painted rock it is that of its outline.
- Visibility is the share of the lump that the box holds. Labels begin when half of what is not buried is in the
  picture, and end when less than 0.4 of it is above the rim.
- After a knock of the camera the boxes move with the picture; the outline of the belt does not, as in a real
  configuration.
- With `h264_crf` a live source codes and decodes each picture; a written video is coded once, at that quality.
- Rocks of the simulator are drawn with their middle in the plane of the belt, as if half of them lay in the ore. Sizes
  and speeds are measured for a sphere that lies on the belt, whose middle is half its diameter nearer to the camera. So
  the true boxes of a lump of 720 mm on a belt of 0.60 m/s, 3.0 m below the camera, measure as 0.53 m/s (0.60 times
  1 - 360/3028). A filter with a trained prior reads that (0.52); one with the stated
  defaults reads 0.60 to 0.70, for its wider motion noise lets speeds scatter, and they scatter upwards.

`FeedSimulator.belt_at(t)` is the truth about the belt: its speed, and the share of it on which ore lies.

With `mouth_level`, `bridge_every_s` or `stuck_share` the crusher's mouth between lip and rim is drawn, too. Material
lies in it up to `mouth_level`, sinks as it is crushed, and is held back for moments; a bridge stands, fills up to the
lip, and breaks; lumps lodge half way down. `FeedSimulator.mouth_at(t)` is the truth about it: how full it is, the
share of it in
which material stands, and whether it is bridged; `bridges` and `lodged` list what happened. `lumpwatch simulate` writes
them into `spec.json`, and a region that [watches the mouth](operation.md#a-blocked-mouth) into `site.yaml`:

```sh
lumpwatch simulate out/mouth --seconds 120 --set "mouth_level=0.4&bridge_every_s=40&bridge_duration_s=20"
```

## Options
"""


def main() -> None:
    """Write the page and the sheet."""
    (DOCS / "simulator.md").write_text(page(), encoding="utf-8")
    cv2.imwrite(str(DOCS / "images" / "simulator.png"), sheet(), (cv2.IMWRITE_PNG_COMPRESSION, 9))


def page() -> str:
    """The text of docs/simulator.md."""
    rows = ["| option | default | range | meaning |", "|---|---|---|---|"]
    for name, field in FeedSpec.model_fields.items():
        limits = _limits(field.metadata)
        rows.append(f"| `{name}` | {_value(field.default)} | {limits} | {field.description} |")
    cells = ["| scene | differs from the standard scene in |", "|---|---|"]
    cells += [f"| `{one.name}` | {_difference(one)} |" for one in scenes()]
    seeds = ", ".join(
        f"{what} {seeds.start} to {seeds.stop - 1}"
        for what, seeds in (
            ("training", TRAIN_SEEDS),
            ("training without lumps", TRAIN_EMPTY_SEEDS),
            ("test", TEST_SEEDS),
            ("test without lumps", TEST_EMPTY_SEEDS),
            ("long run without lumps", LONG_SEEDS),
        )
    )
    matrix = f"""
## The matrix of difficulty

Each scene changes one thing of the standard scene, or combines some (`tests/reproduction/matrix.py`). At the same
seed the lumps of a style come at the same moments (touching ones excepted), so scenes compare pair by pair. Seeds
never mix: {seeds}.

`python -m tests.reproduction difficulty` plays the lump filter and its peers on these scenes and writes
`docs/results/difficulty.md`; `--help` shows how to run parts of it, or for a limited time. What was watched is kept
in `build/reproduction/`, so an interrupted run goes on; a change of the code starts anew.

"""
    return _OPENING + "\n" + "\n".join(rows) + "\n" + matrix + "\n".join(cells) + "\n"


def sheet() -> NDArray[np.uint8]:
    """A contact sheet of the scenes that a still can show."""
    last = {one.axis: one.name for one in scenes() if one.spec.style == "a"}
    tiles = [
        _tile(one)
        for one in scenes()
        if one.axis not in _UNSEEN
        and (one.axis in _EVERY or one.name == last[one.axis] or one.spec.style == "b")
    ]
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % _COLUMNS)
    rows = [np.hstack(tiles[i : i + _COLUMNS]) for i in range(0, len(tiles), _COLUMNS)]
    return np.asarray(np.vstack(rows), np.uint8)


def _tile(one: Scene) -> NDArray[np.uint8]:
    small = {"seed": _SEED, "width": _WIDTH, "height": _HEIGHT, "fps": _FPS}
    simulator = FeedSimulator(one.spec.model_copy(update=small))
    plain = FeedSpec.model_validate({**STANDARD.model_dump(exclude_unset=True), "style": one.spec.style})
    standard = FeedSimulator(plain.model_copy(update=small))
    best, shown = -1.0, np.zeros((_HEIGHT, _WIDTH), np.uint8)
    for feed in (simulator, standard):
        feed.skip(round(_FROM_S * _FPS))
    while simulator.time_s < _UNTIL_S:
        (picture, truths), (other, _) = simulator.render(), standard.render()
        difference = float(cv2.absdiff(picture, other).mean()) if any(map(_central, truths)) else -0.5
        if difference > best:
            best, shown = difference, _framed(picture, truths)
    # Fewer grey levels keep the file small.
    tile = cv2.resize(shown, _SHOWN, interpolation=cv2.INTER_AREA) // 5 * 5
    cv2.rectangle(tile, (0, _SHOWN[1] - 16), _SHOWN, (0,), -1)
    at, font = (4, _SHOWN[1] - 4), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(tile, one.name, at, font, 0.42, (255,), 1, cv2.LINE_AA)
    return np.asarray(cv2.copyMakeBorder(tile, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=(255,)), np.uint8)


def _framed(picture: NDArray[np.uint8], truths: tuple[Truth, ...]) -> NDArray[np.uint8]:
    for truth in truths:
        corners = (round(truth.x), round(truth.y)), (round(truth.x + truth.w), round(truth.y + truth.h))
        cv2.rectangle(picture, *corners, (255,), 1)
    return picture


def _central(truth: Truth) -> bool:
    return truth.on_belt and 0.25 * _HEIGHT < truth.y + truth.h / 2 < 0.6 * _HEIGHT


def _limits(metadata: list[object]) -> str:
    words = []
    for sign, kind, name in ((">", Gt, "gt"), ("≥", Ge, "ge"), ("<", Lt, "lt"), ("≤", Le, "le")):
        words += [f"{sign} {getattr(limit, name):g}" for limit in metadata if isinstance(limit, kind)]
    return ", ".join(words)


def _value(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)


def _difference(one: Scene) -> str:
    standard = STANDARD.model_dump()
    changed = {key: value for key, value in one.spec.model_dump().items() if value != standard[key]}
    return ", ".join(f"{key} {_value(value)}" for key, value in changed.items()) or "nothing"


if __name__ == "__main__":
    main()
