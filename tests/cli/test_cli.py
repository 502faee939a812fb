"""The command line: help, exit codes, one line for each failure; `run` and `demo` have tests of their own."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import cv2
import jsonschema
import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.cli.alarms import describe_alarm, describe_state
from lumpwatch.service.cli.events import moment
from lumpwatch.service.config import load_config
from lumpwatch.service.core.duration import seconds_of
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.storage.event_log import Entry, EventLog, event_file
from lumpwatch.service.storage.prior_file import encode_prior
from lumpwatch.service.storage.prior_store import PriorStore, read_file
from tests.bus.test_bus_support import free_endpoint
from tests.protocol.test_messages import RECORDS
from tests.service_helpers import prior, site_tree
from tests.storage.test_event_log import event

LUMPWATCH = str(Path(sys.executable).with_name("lumpwatch"))
COMMANDS = (
    "run",
    "demo",
    "replay",
    "evaluate",
    "backtest",
    "train",
    "refine",
    "priors",
    "check",
    "schema",
    "alarms",
    "simulate",
    "ack",
    "reset",
    "shelve",
    "unshelve",
    "service",
    "events",
)
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A configuration file of the small camera, on a bus where nobody is."""
    path = tmp_path / "site.yaml"
    bus = {"listen": [free_endpoint()], "connect_timeout_s": 0.5}
    tree = {**site_tree(), "bus": bus}
    clip = tmp_path / "clip.mp4"
    clip.touch()
    tree["cameras"][0]["source"]["url"] = str(clip)
    path.write_text(json.dumps(tree), encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def _same_signals() -> Iterator[None]:
    """Commands that run until they are stopped take over the signals of the process."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def failed(capsys: Captured, *arguments: object, code: int) -> str:
    """Run a command that fails with this code; its only line on standard error."""
    assert main([str(argument) for argument in arguments]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("lumpwatch")
    assert len(err.splitlines()) == 1
    assert err.endswith("\n")
    return err


def done(capsys: Captured, *arguments: object) -> str:
    """Run a command that succeeds; what it prints."""
    assert main([str(argument) for argument in arguments]) == 0
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return out


# Help and arguments


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(capsys: Captured, command: str) -> None:
    told = done(capsys, command, "--help")
    assert f"usage: lumpwatch {command}" in told
    example = told.partition("example:\n")[2].strip()
    assert example.startswith(f"lumpwatch {command}")


def test_the_help_names_every_command(capsys: Captured) -> None:
    told = done(capsys, "--help")
    assert all(f"\n    {command} " in told or f"\n  {command} " in told for command in COMMANDS)


def test_an_operator_does_not_wait_for_what_only_filters_need() -> None:
    told = "import sys; from lumpwatch.service.cli import main; main(['ack', '--help']); print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "False"


def test_the_version(capsys: Captured) -> None:
    assert done(capsys, "--version").startswith("lumpwatch ")


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("nosuch",),
        ("--nosuch",),
        ("check",),
        ("check", "a.yaml", "b.yaml"),
        ("schema", "everything"),
        ("replay", "a.yaml", "b.mp4"),
        ("replay", "a.yaml", "b.mp4", "--camera", "c"),
        ("run",),
        ("run", "a.yaml", "--only", "console"),
        ("demo", "--seconds", "soon"),
        ("simulate",),
        ("simulate", "out", "--seed", "x"),
        ("refine", "a.yaml", "--camera", "c", "--roi", "r"),
        ("priors", "burn", "a.yaml", "--camera", "c", "--roi", "r"),
        ("alarms", "a.yaml", "--count", "many"),
        ("ack", "a.yaml", "--camera", "c", "--roi", "r"),
        ("ack", "a.yaml", "--camera", "c", "--roi", "r", "--actor", "a", "--class", "dust"),
        ("shelve", "a.yaml", "--camera", "c", "--roi", "r", "--actor", "a", "--for", "1h"),
        ("service", "off", "a.yaml", "--camera", "c", "--roi", "r", "--actor", "a"),
        ("events", "a.yaml", "--format", "xml"),
    ],
)
def test_bad_arguments_are_one_line(capsys: Captured, arguments: tuple[str, ...]) -> None:
    assert "--help" in failed(capsys, *arguments, code=2)


NEEDS_CONFIG = [
    ("check", "{}"),
    ("run", "{}"),
    ("alarms", "{}"),
    ("events", "{}"),
    ("replay", "{}", "clip.mp4", "--camera", "cam", "--out", "out"),
    ("ack", "{}", "--camera", "cam", "--roi", "apron", "--actor", "Ada"),
    ("reset", "{}", "--camera", "cam", "--roi", "apron", "--actor", "Ada"),
    ("unshelve", "{}", "--camera", "cam", "--roi", "apron", "--actor", "Ada"),
    ("service", "in", "{}", "--camera", "cam", "--roi", "apron", "--actor", "Ada"),
    ("train", "{}", "clip.mp4", "gt.txt", "--camera", "cam", "--roi", "apron"),
    ("refine", "{}", "clip.mp4", "--camera", "cam", "--roi", "apron"),
    ("priors", "list", "{}", "--camera", "cam", "--roi", "apron"),
]


@pytest.mark.parametrize("arguments", NEEDS_CONFIG)
def test_a_bad_configuration_is_one_line(
    capsys: Captured, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    path = tmp_path / "site.yaml"
    given = [argument.format(path) for argument in arguments]
    assert f"{path}: cannot be read" in failed(capsys, *given, code=2)
    path.write_text(json.dumps({**site_tree(), "sight": 1}), encoding="utf-8")
    assert f"{path}: sight: unknown key" in failed(capsys, *given, code=2)


@pytest.mark.parametrize("arguments", NEEDS_CONFIG[4:])
def test_a_camera_or_roi_that_is_not_configured_is_one_line(
    capsys: Captured, config: Path, arguments: tuple[str, ...]
) -> None:
    given = [argument.format(config) for argument in arguments]
    other = ["nope" if argument == "cam" else argument for argument in given]
    assert "--camera nope: " in failed(capsys, *other, code=2)
    if "apron" in given:
        other = ["nope" if argument == "apron" else argument for argument in given]
        assert "--roi nope: camera cam " in failed(capsys, *other, code=2)


def test_run_refuses_a_camera_that_is_not_configured(capsys: Captured, config: Path) -> None:
    assert "--camera nope" in failed(capsys, "run", config, "--camera", "nope", code=2)


# check and schema


def test_check(capsys: Captured, config: Path) -> None:
    assert "needs a prior; run lumpwatch train" in failed(capsys, "check", config, code=2)
    PriorStore(config.parent / "var").save(prior())
    told = done(capsys, "check", config)
    assert all(word in told for word in ("pit", "cam", "apron", "jdt", "version 1"))


def test_check_says_how_well_a_calibration_fits(capsys: Captured, config: Path) -> None:
    PriorStore(config.parent / "var").save(prior())
    tree = json.loads(config.read_text())
    points = [[0.32, 0.20], [0.68, 0.20], [0.84, 0.70], [0.16, 0.70]]
    calibration = {
        "points": points,
        "points_mm": [[0, 0], [2400, 0], [2400, 5000], [0, 5000]],
        "lip": [[0.15, 0.77], [0.85, 0.77]],
    }
    tree["cameras"][0]["rois"][0]["calibration"] = calibration
    config.write_text(json.dumps(tree))
    assert "1920x1080 assumed" in done(capsys, "check", config)
    found = re.search(
        r"fits within (\S+) px; .* sees (\d+) degrees", done(capsys, "check", config, "--size", "640x480")
    )
    assert found is not None
    assert float(found[1]) < 8.0
    assert 20 < int(found[2]) < 120
    calibration["points"] = [points[k] for k in (0, 2, 1, 3)]
    config.write_text(json.dumps(tree))
    assert "cam/apron: calibration" in failed(capsys, "check", config, "--size", "640x480", code=2)


@pytest.mark.parametrize("size", ["640", "640x0", "widexhigh", "-1x5"])
def test_check_wants_a_size_in_pixels(capsys: Captured, config: Path, size: str) -> None:
    assert size in failed(capsys, "check", config, f"--size={size}", code=2)


def test_check_refuses_a_simulation_that_does_not_exist(capsys: Captured, tmp_path: Path) -> None:
    tree = site_tree()
    tree["cameras"][0]["source"]["url"] = "sim:feed?no_such=1"
    file = tmp_path / "site.yaml"
    file.write_text(json.dumps(tree))
    for command in ("check", "run"):
        assert main([command, str(file)]) == 2
        told = capsys.readouterr().err.strip().splitlines()[-1]
        assert "camera cam: " in told
        assert "no_such" in told


def test_check_tells_of_a_damaged_prior(
    capsys: Captured, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    store = PriorStore(config.parent / "var")
    store.save(prior())
    store.save(prior())
    store.path("cam", "apron", 2).write_bytes(encode_prior(prior())[:-1])
    told = done(capsys, "check", config)
    assert "version 1 (refused: " in told
    assert "truncated" in told


def test_check_hides_the_password(capsys: Captured, config: Path) -> None:
    tree = site_tree(likelihood={"kind": "lump"})
    tree["cameras"][0]["source"]["url"] = "rtsp://u:hunter2-s3cret@h/x"
    config.write_text(json.dumps(tree), encoding="utf-8")
    told = done(capsys, "check", config)
    assert "***@h/x" in told
    assert "hunter2" not in told


@pytest.mark.parametrize("of", ["config", "alarm", "state", "heartbeat", "level", "replay"])
def test_schemas_are_schemas(capsys: Captured, of: str) -> None:
    schema = json.loads(done(capsys, "schema", of))
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["title"]


def test_the_schema_takes_the_configuration_of_these_tests(capsys: Captured) -> None:
    tree = site_tree(models=[{"kind": "constant_velocity"}])
    tree["cameras"][0]["rois"][0]["detector"]["models"][0]["name"] = "still"
    jsonschema.validate(tree, json.loads(done(capsys, "schema")))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**tree, "sight": 1}, json.loads(done(capsys, "schema", "config")))


def test_the_schema_takes_a_model_that_is_a_kind_alone(capsys: Captured) -> None:
    jsonschema.validate(site_tree(models=["bounce"]), json.loads(done(capsys, "schema")))


# priors


def test_priors_are_listed_rolled_back_exported_and_imported(
    capsys: Captured, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    store = PriorStore(tmp_path / "var")
    for source in ("a.mp4", "b.mp4", "c.mp4"):
        store.save(prior(source=source))
    store.path("cam", "apron", 3).write_bytes(b"nonsense")
    of = ("--camera", "cam", "--roi", "apron")
    told = done(capsys, "priors", "list", config, *of)
    assert "a.mp4" in told
    assert "is not a lumpwatch prior" in told
    assert "version 1 is in use" in done(capsys, "priors", "rollback", config, *of, "--version", 1)
    assert store.pointer("cam", "apron") == 1
    file = tmp_path / "kept.prior"
    done(capsys, "priors", "export", config, file, *of)
    assert read_file(file).meta.source == "a.mp4"
    done(capsys, "priors", "export", config, file, *of, "--version", 2)
    assert read_file(file).meta.source == "b.mp4"
    assert "stored as version 4 and in use" in done(capsys, "priors", "import", config, file, *of)
    found = store.current("cam", "apron").prior
    assert found is not None
    assert (found.version, found.meta.source) == (4, "b.mp4")
    picture = tmp_path / "prior.png"
    done(capsys, "priors", "show", config, picture, *of)
    assert cv2.imread(str(picture)) is not None


def test_a_prior_is_tried_in_shadow_promoted_and_gone_back_from(
    capsys: Captured, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    store = PriorStore(tmp_path / "var")
    of = ("--camera", "cam", "--roi", "apron")
    file = tmp_path / "some.prior"
    file.write_bytes(encode_prior(prior()))
    told = done(capsys, "priors", "import", config, file, *of, "--shadow")
    assert "stored as version 1 and runs in shadow" in told
    assert "nothing was counted yet" in done(capsys, "priors", "shadow", config, *of)
    assert "back with priors rollback --version 0" in done(capsys, "priors", "promote", config, *of)
    assert "the stated defaults are in use" in done(capsys, "priors", "rollback", config, *of, "--version", 0)
    assert store.current("cam", "apron").prior is None
    store.save(prior(source="b.mp4"))
    assert "version 1 runs in shadow" in done(capsys, "priors", "shadow", config, *of, "--version", 1)
    store.save(prior(source="c.mp4"), shadow=True)
    rows = [line.split("│") for line in done(capsys, "priors", "list", config, *of).splitlines()]
    states = {row[1].strip(): row[-2].strip() for row in rows if len(row) > 3}
    assert states == {"1": "", "2": "in use", "3": "in shadow"}
    assert "version 3 no longer" in done(capsys, "priors", "drop", config, *of, "--version", 3)
    assert "never in use" in done(capsys, "priors", "list", config, *of)


@pytest.mark.parametrize(
    ("action", "more", "reason"),
    [
        ("rollback", ("--version", "7"), "there is no version 7"),
        ("export", ("x.prior", "--version", "7"), "cannot be read (No such file"),
        ("export", ("x.prior",), "cam/apron: has no prior"),
        ("import", ("site.yaml",), "site.yaml: is not a lumpwatch prior"),
        ("import", ("none.prior",), "none.prior: cannot be read"),
        ("show", ("x.png",), "has no prior"),
        ("shadow", ("--version", "7"), "there is no version 7"),
        ("promote", (), "no prior runs in shadow"),
        ("drop", (), "no prior runs in shadow"),
    ],
)
def test_what_priors_cannot_do_is_one_line(
    capsys: Captured,
    config: Path,
    monkeypatch: pytest.MonkeyPatch,
    action: str,
    more: tuple[str, ...],
    reason: str,
) -> None:
    monkeypatch.chdir(config.parent)
    of = ("--camera", "cam", "--roi", "apron")
    assert reason in failed(capsys, "priors", action, config, *more, *of, code=1)


def test_the_prior_of_another_roi_is_not_imported(capsys: Captured, config: Path, tmp_path: Path) -> None:
    (tmp_path / "x.prior").write_bytes(encode_prior(prior(roi="chute")))
    of = ("--camera", "cam", "--roi", "apron")
    told = failed(capsys, "priors", "import", config, tmp_path / "x.prior", *of, code=1)
    assert "belongs to camera cam, roi chute" in told
    assert PriorStore(tmp_path / "var").versions("cam", "apron") == ()


def test_files_that_cannot_be_written_are_one_line(capsys: Captured, config: Path, tmp_path: Path) -> None:
    PriorStore(tmp_path / "var").save(prior())
    of = ("--camera", "cam", "--roi", "apron")
    for action in ("export", "show"):
        target = tmp_path / "nowhere" / "x.png"
        told = failed(capsys, "priors", action, config, target, *of, code=1)
        assert f"{target}: cannot be written" in told


@pytest.mark.parametrize(
    "arguments",
    [
        ("priors", "rollback", "{}", "--camera", "cam", "--roi", "apron"),
        ("priors", "export", "{}", "--camera", "cam", "--roi", "apron"),
        ("alarms", "{}", "--ack", "cam"),
    ],
)
def test_missing_arguments_are_bad_arguments(
    capsys: Captured, config: Path, arguments: tuple[str, ...]
) -> None:
    failed(capsys, *(argument.format(config) for argument in arguments), code=2)


# simulate and train


def test_a_feed_is_simulated_and_learned_from(capsys: Captured, config: Path, tmp_path: Path) -> None:
    told = done(
        capsys,
        *("simulate", tmp_path / "feed", "--seconds", 4, "--seed", 3),
        *("--set", "width=200&height=160&lumps_per_minute=60&fps=10&lump_spacing_s=0"),
    )
    assert [Path(line).name for line in told.splitlines()] == [
        *("video.mp4", "gt.txt", "spec.json", "site.yaml")
    ]
    about = json.loads((tmp_path / "feed" / "spec.json").read_text())
    assert (about["frames"], about["spec"]["seed"]) == (40, 3)
    tree = site_tree()
    tree["cameras"][0]["source"]["url"] = str(tmp_path / "feed" / "video.mp4")
    tree["cameras"][0]["rois"][0] |= {"polygon": about["polygon"], "detector": {"working_size_px": 96}}
    config.write_text(json.dumps(tree), encoding="utf-8")
    files = (tmp_path / "feed" / "video.mp4", tmp_path / "feed" / "gt.txt")
    of = ("--camera", "cam", "--roi", "apron")
    told = done(capsys, "train", config, *files, *of, "--plot", tmp_path / "learned.png")
    assert "prior version 1" in told
    assert cv2.imread(str(tmp_path / "learned.png")) is not None
    stored = PriorStore(load_config(config).store.path).current("cam", "apron").prior
    assert stored is not None
    assert (stored.meta.source, stored.meta.frames, stored.meta.aspect) == ("video.mp4", 40, 1.25)
    assert done(capsys, "check", config).count("version 1") == 1
    labels = tmp_path / "bad.txt"
    labels.write_text("1,1,2,3\n")
    told = failed(capsys, "train", config, files[0], labels, *of, code=1)
    assert f"{labels}, line 1: expected frame,id" in told
    told = failed(capsys, "train", config, tmp_path / "none.mp4", files[1], *of, code=1)
    assert "none.mp4: no such file or folder" in told
    assert PriorStore(tmp_path / "var").versions("cam", "apron") == (1,)


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (("--seconds", "-1"), "--for -1s"),
        (("--seconds", "0"), "--for 0s"),
        (("--seed", "-1"), "--seed -1: must not be negative"),
        (("--set", "dust=2"), "sim:feed: dust: "),
        (("--set", "rocks=2"), "sim:feed: rocks: unknown key"),
        (("--set", "nonsense"), "expected key=value"),
        *(pytest.param(("--seconds", value), f"--for {value}s") for value in ("nan", "inf")),
    ],
)
def test_what_cannot_be_simulated(
    capsys: Captured, tmp_path: Path, more: tuple[str, ...], reason: str
) -> None:
    assert reason in failed(capsys, "simulate", tmp_path / "feed", *more, code=2)


def test_a_folder_that_cannot_be_made(capsys: Captured, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    told = failed(capsys, "simulate", tmp_path / "file", "--seconds", 1, code=1)
    assert "file: cannot be written (File exists)" in told


# alarms


def test_nobody_to_listen_to_is_one_line(capsys: Captured, config: Path) -> None:
    (endpoint,) = load_config(config).bus.listen
    assert endpoint in failed(capsys, "alarms", config, code=1)


def test_alarms_and_states_in_words() -> None:
    event, state = (json.dumps(RECORDS[of][0]).encode() for of in ("alarm", "state"))
    assert describe_alarm(event) == (
        "2023-11-14 22:13:20 cam/apron: raised, now UNACKNOWLEDGED, existence 0.99, frame 42, "
        "box 30 x 20 px at (101, 50), belt"
    )
    assert describe_state(state) == "cam/apron: LUMP, alarm UNACKNOWLEDGED, existence 0.99"
    starting = json.dumps(RECORDS["state"][1]).encode()
    assert describe_state(starting) == "cam/apron: BLIND (starting), alarm NORMAL, existence 0.00"


@pytest.mark.parametrize("payload", [b"", b"\xff\xfe", b"{}", b"[1]", b'{"state": 1}'])
def test_a_malformed_record_is_told_in_one_line(payload: bytes) -> None:
    for told in (describe_alarm(payload), describe_state(payload)):
        assert told.startswith("a malformed ")
        assert f"of {len(payload)} bytes" in told


# Operating, and the event log

OF = ("--camera", "cam", "--roi", "apron", "--actor", "Ada")


def test_operating_without_a_daemon_is_one_line(capsys: Captured, config: Path) -> None:
    assert "bus: cannot connect" in failed(capsys, "ack", config, *OF, code=1)


@pytest.mark.parametrize("span", ["", "soon", "0", "90", "-5m", "5 m", "5x", "nan"])
def test_spans_that_are_none(capsys: Captured, config: Path, span: str) -> None:
    with pytest.raises(ConfigError, match="not a time"):
        seconds_of(span)
    told = failed(capsys, "shelve", config, *OF, f"--for={span}", "--reason", "x", code=2)
    assert "is not a time such as" in told


@pytest.mark.parametrize(
    ("span", "expected"),
    [("250ms", 0.25), ("90s", 90), ("30m", 1800), ("1h30m", 5400), ("1.5h", 5400), ("2d", 172_800)],
)
def test_spans(span: str, expected: float) -> None:
    assert seconds_of(span) == expected


def test_moments() -> None:
    assert moment("2024-05-17T06:00:00+02:00", 0.0) == 1_715_918_400.0
    assert moment("12h", 1e6) == 1e6 - 43_200
    with pytest.raises(ConfigError, match="--since 'yesterday': is neither"):
        moment("yesterday", 0.0)


def test_out_of_service_needs_a_reason(capsys: Captured, config: Path) -> None:
    assert "service: reason: " in failed(capsys, "service", "out", config, *OF, code=2)


ODD = 'dust, [red]and[/] "more" [/]'
"""Words of an operator that look like mark-up."""


def test_the_event_log_is_printed(capsys: Captured, config: Path) -> None:
    assert "holds no event log" in failed(capsys, "events", config, code=1)
    log = EventLog(event_file(config.parent / "var", "cam"))
    log.append([Entry(event(k, reason=ODD), b"") for k in (1, 2)])
    log.close()
    first, second = (
        json.loads(line) for line in done(capsys, "events", config, "--format", "jsonl").splitlines()
    )
    assert (first["sequence"], second["sequence"]) == (1, 2)
    assert first == {
        "time": "2023-11-14T22:13:21+00:00",
        "monotonic_s": 101.0,
        "camera": "cam",
        "roi": "apron",
        "class": "lump",
        "change": "raised",
        "before": "NORMAL",
        "after": "UNACKNOWLEDGED",
        "actor": "Ada",
        "reason": ODD,
        "existence": 0.97,
        "frame": 41,
        "id": "id-000001",
        "sequence": 1,
        "longest_mm": None,
        "lip_s": None,
        "evidence": None,
    }
    rows = list(csv.DictReader(io.StringIO(done(capsys, "events", config, "--format", "csv"))))
    assert [{k: "" if v is None else str(v) for k, v in one.items()} for one in (first, second)] == rows
    table = done(capsys, "events", config, "--camera", "cam")
    assert ODD in table
    assert table.count("UNACKNOWLEDGED") == 2
    since = ("--since", "2023-11-14T22:13:22+00:00")
    assert len(done(capsys, "events", config, *since, "--format", "jsonl").splitlines()) == 1
    assert "is not in the configuration" in failed(capsys, "events", config, "--camera", "nope", code=2)


def test_an_event_log_that_cannot_be_read_is_one_line(capsys: Captured, config: Path) -> None:
    path = event_file(config.parent / "var", "cam")
    path.parent.mkdir(parents=True)
    path.write_bytes(b"nonsense" * 600)
    assert "cam.sqlite: cannot be read" in failed(capsys, "events", config, "--format", "jsonl", code=1)


# As a process


def process(*arguments: object, stdout: int | IO[str] = subprocess.PIPE) -> subprocess.CompletedProcess[str]:
    command = [LUMPWATCH, *map(str, arguments)]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=120, check=False)


@pytest.mark.slow
def test_exit_codes_of_the_process(config: Path, tmp_path: Path) -> None:
    good = process("schema", "alarm")
    assert (good.returncode, good.stderr) == (0, "")
    assert json.loads(good.stdout)["title"] == "AlarmEvent"
    bad = process("check", tmp_path / "none.yaml")
    assert (bad.returncode, bad.stdout) == (2, "")
    assert bad.stderr.count("\n") == 1
    failure = process("priors", "rollback", config, "--camera", "cam", "--roi", "apron", "--version", 3)
    assert (failure.returncode, failure.stderr.count("\n")) == (1, 1)


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("schema",), ("--help",)])
def test_a_reader_that_has_gone_is_no_error(arguments: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        gone = process(*arguments, stdout=writer)
    finally:
        os.close(writer)
    assert gone.stderr == ""


@pytest.mark.slow
def test_a_full_disk_under_the_output_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        failure = process("schema", stdout=full)
    assert failure.returncode == 1
    assert len(failure.stderr.splitlines()) == 1


def test_numerics_use_one_thread_unless_the_user_wants_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    assert main(["--version"]) == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    assert os.environ["OMP_NUM_THREADS"] == "4"
