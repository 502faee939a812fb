from __future__ import annotations

import stat
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.config import load_config
from lumpwatch.service.console.editing import ConflictError, EditError, fingerprint, propose, region_of, write

TEXT = """\
# The pit.
site: pit   # its name
cameras:
  - id: cam
    source: {url: "sim:feed"}   # simulated
    rois:
      - id: apron
        polygon: [[0.2, 0.1], [0.8, 0.1], [0.8, 0.9], [0.2, 0.9]]  # drawn by hand
        alarm: {latch: true}
"""
SIZE = (640, 480)
POLYGON = [[0.3, 0.1], [0.8, 0.1], [0.8, 0.9], [0.2, 0.9]]
BELT: dict[str, Any] = {
    "points": [[0.3, 0.2], [0.7, 0.2], [0.9, 0.9], [0.1, 0.9]],
    "points_mm": [[0, 3000], [1500, 3000], [1500, 0], [0, 0]],
    "lip": [[0.1, 0.95], [0.9, 0.95]],
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "site.yaml"
    path.write_text(TEXT)
    path.chmod(0o600)
    return path


def change(**more: Any) -> dict[str, Any]:
    return {"base": fingerprint(TEXT), "size": list(SIZE), **more}


def test_a_change_touches_its_line_alone_and_comments_survive(file: Path) -> None:
    proposal = propose(file, "cam", "apron", change(polygon=POLYGON), SIZE)
    assert [line for line in proposal.diff[3:] if line[0] in "+-"] == [
        "-        polygon: [[0.2, 0.1], [0.8, 0.1], [0.8, 0.9], [0.2, 0.9]]  # drawn by hand",
        "+        polygon: [[0.3, 0.1], [0.8, 0.1], [0.8, 0.9], [0.2, 0.9]]  # drawn by hand",
    ]


def test_nothing_changed_is_no_difference(file: Path) -> None:
    told = region_of(file, "cam", "apron")
    polygon = [list(point) for point in told["polygon"]]
    assert propose(file, "cam", "apron", change(polygon=polygon), SIZE).diff == []


def test_writing_keeps_the_old_file_and_its_mode(file: Path) -> None:
    kept = write(file, propose(file, "cam", "apron", change(polygon=POLYGON), SIZE), "emma")
    assert kept.read_text() == TEXT
    assert load_config(file).camera("cam").roi("apron").polygon[0] == (0.3, 0.1)
    assert {stat.S_IMODE(path.stat().st_mode) for path in (file, kept)} == {0o600}
    assert '"actor": "emma"' in (file.parent / "site.yaml.changes.jsonl").read_text()


def test_a_belt_gets_a_grid_that_goes_through_its_points(file: Path) -> None:
    fit = propose(file, "cam", "apron", change(**BELT), SIZE).fit
    assert fit is not None
    assert fit["missed_px"] < 10
    corners = {tuple(round(v, 2) for v in end) for ends in fit["grid"] for end in ends}
    assert {(0.3, 0.2), (0.9, 0.9)} <= corners


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"polygon": [[0.2, 0.1], [0.8, 0.9], [0.8, 0.1], [0.2, 0.9]]}, "crosses itself"),
        ({"polygon": [[0.2, 0.1], [1.8, 0.9], [0.8, 0.1]]}, "polygon"),
        ({"polygon": [[0.2, 0.1]]}, "polygon"),
        ({"polygon": "everything"}, "polygon"),
        ({"polygon": [[True, 0.1], [0.1, 0.2], [0.3, 0.3]]}, "polygon"),
        ({"points": BELT["points"]}, "calibration"),
        ({**BELT, "points_mm": [[0, 0], [1, 0], [2, 0], [3, 0]]}, "calibration"),
        ({"alarm": {"latch": False}}, "alarm"),
    ],
)
def test_what_check_refuses_is_refused(file: Path, given: dict[str, Any], named: str) -> None:
    with pytest.raises(EditError, match=named):
        propose(file, "cam", "apron", change(**given), SIZE)
    assert file.read_text() == TEXT


def test_a_file_that_somebody_else_changed_is_left_alone(file: Path) -> None:
    file.write_text(TEXT + "# more\n")
    with pytest.raises(ConflictError):
        propose(file, "cam", "apron", change(polygon=POLYGON), SIZE)


def test_zones_of_a_tracker_stay_where_they_are_when_the_region_moves(file: Path) -> None:
    text = TEXT.replace(
        "        alarm:",
        "        detector: {kind: jpda, exits: [[[0.5, 0.0], [1.0, 0.0], [1.0, 1.0]]]}\n        alarm:",
    )
    file.write_text(text)
    base = {"base": fingerprint(text), "size": list(SIZE)}
    zones = region_of(file, "cam", "apron")["zones"]
    assert zones == {"entries": [], "exits": [[[0.5, 0.1], [0.8, 0.1], [0.8, 0.9]]]}
    assert propose(file, "cam", "apron", {**base, "exits": zones["exits"]}, SIZE).diff == []
    polygon = [[0.2, 0.1], [1.0, 0.1], [1.0, 0.9], [0.2, 0.9]]
    given = {
        **base,
        "polygon": polygon,
        "exits": zones["exits"],
        "entries": [[[0.0, 0.0], [0.4, 0.1], [0.4, 0.9]]],
    }
    proposal = propose(file, "cam", "apron", given, SIZE)
    write(file, proposal, "emma")
    assert region_of(file, "cam", "apron")["zones"] == {
        "entries": [[[0.2, 0.1], [0.4, 0.1], [0.4, 0.9]]],  # cut off at the region's box
        "exits": zones["exits"],
    }
    for wrong in ([[[0.1, 0.1]]], "all", [[[0.1, 0.1], [0.2, 0.2], ["x", 1]]], [[[0, 0]] * 3] * 17):
        with pytest.raises(EditError, match="exits"):
            propose(file, "cam", "apron", {"base": fingerprint(file.read_text()), "exits": wrong}, SIZE)


def test_a_detector_without_zones_gets_none(file: Path) -> None:
    with pytest.raises(EditError, match="jpda"):
        propose(file, "cam", "apron", change(exits=[[[0.1, 0.1], [0.2, 0.1], [0.2, 0.2]]]), SIZE)
