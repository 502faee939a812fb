"""The commands of the experiments give the figures that are stated beside them."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.experiments.held import held
from docs.experiments.runner import EXPERIMENTS, HERE, compared, figures
from docs.experiments.square.scene import EMPTY, SHOWN, SIDE, make_scene
from lumpwatch.service.config import load_config


@pytest.mark.slow
@pytest.mark.parametrize("name", ["square", "traffic"])
def test_a_reader_gets_the_figures(name: str, tmp_path: Path) -> None:
    lines = compared(name, figures(name, tmp_path, tmp_path))
    assert all(met for _, met in lines), lines


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_is_complete(name: str) -> None:
    assert load_config(HERE / name / "site.yaml").cameras
    commands = (HERE / name / "commands.sh").read_text(encoding="utf-8").splitlines()
    assert all(command.split()[0] in ("lumpwatch", "python") for command in commands)


def test_footage_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"gt\.txt"):
        figures("pets", tmp_path / "work", tmp_path)


def test_the_square_is_where_its_labels_say() -> None:
    scene = make_scene(0, noise=0.0)
    x = scene.centres[7, 0]
    changed = (scene.pictures[EMPTY + 7] != scene.pictures[0]).any(axis=0).nonzero()[0]
    assert changed[0] == pytest.approx(x - SIDE / 2, abs=1.0)
    assert changed[-1] + 1 == pytest.approx(x + SIDE / 2, abs=1.0)
    assert 8 <= scene.bounced.sum() <= 14
    assert len(scene.labels.split()) == SHOWN
    assert make_scene(1, shown=0).labels == ""


def test_held_counts_what_lies_after_the_object_apart(tmp_path: Path) -> None:
    states, labels = tmp_path / "states.jsonl", tmp_path / "gt.txt"
    above = {2, *range(20, 38), 41, 60}
    states.write_text(
        "\n".join(f'{{"frame": {k}, "existence": {0.9 if k in above else 0.1}}}' for k in range(1, 61))
    )
    labels.write_text("".join(f"{k},1,0,0,9,9\n" for k in range(10, 40)))
    share, after, false = held(states, labels)
    assert share == pytest.approx(13 / 15)  # of the frames 25 to 39, the last two are missed
    assert (after, false) == (1, 2)
    assert held(states, None) == (None, 0, len(above))
