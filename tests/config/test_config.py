"""The configuration: what the documented example means, and what wrong ones are told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lumpwatch.service.config import HistogramConfig, JdtConfig, LumpConfig, load_config, parse_config
from lumpwatch.service.config.cameras import polygon_area
from lumpwatch.service.errors import ConfigError
from tests.service_helpers import POLYGON, site, site_tree

EXAMPLE = """\
site: north-pit
bus: {mode: router, listen: ["tcp/127.0.0.1:7447"], connect: []}
store: {path: var}
telemetry: {listen: "127.0.0.1:9464"}
cameras:
  - id: crusher-1
    source: {url: "rtsp://user:${CAM_PASSWORD}@10.0.0.5/stream"}
    rois:
      - id: apron
        polygon: [[0.15, 0.10], [0.85, 0.10], [0.85, 0.98], [0.15, 0.98]]
        detector:
          kind: jdt
          particles: 2000
          models: [{name: belt, kind: constant_acceleration}, {name: fall, kind: constant_acceleration}]
          switching: adaptive
          likelihood: {kind: lump}
          seed: 1
        alarm: {raise_above: 0.999, clear_below: 0.5, on_delay_s: 0.5, off_delay_s: 2.0, latch: true}
"""
SECRET = {"CAM_PASSWORD": "hunter2-s3cret"}


def refused(text: str, environ: dict[str, str] | None = None) -> str:
    """The text of the refusal: always one line that begins with the file."""
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "site.yaml", environ or {})
    told = str(caught.value)
    assert told.startswith("site.yaml: ")
    assert len(told.splitlines()) == 1
    return told


def refused_tree(tree: dict[str, Any]) -> str:
    return refused(json.dumps(tree))


def with_roi(**changes: Any) -> dict[str, Any]:
    tree = site_tree()
    tree["cameras"][0]["rois"][0].update(changes)
    return tree


def with_camera(**changes: Any) -> dict[str, Any]:
    tree = site_tree()
    tree["cameras"][0].update(changes)
    return tree


# The documented example


def test_the_example_means_what_it_says() -> None:
    config = parse_config(EXAMPLE, "site.yaml", SECRET)
    assert config.site == "north-pit"
    assert (config.bus.mode, config.bus.listen, config.bus.connect) == (
        "router",
        ("tcp/127.0.0.1:7447",),
        (),
    )
    assert config.store.path == Path("var")
    assert config.telemetry.address == ("127.0.0.1", 9464)
    camera = config.camera("crusher-1")
    assert camera.source.url.get_secret_value() == "rtsp://user:hunter2-s3cret@10.0.0.5/stream"
    assert camera.source.kind == "rtsp"
    roi = camera.roi("apron")
    assert roi.polygon == ((0.15, 0.10), (0.85, 0.10), (0.85, 0.98), (0.15, 0.98))
    detector = roi.detector
    assert isinstance(detector, JdtConfig)
    assert (detector.kind, detector.particles, detector.switching, detector.seed) == (
        "jdt",
        2000,
        "adaptive",
        1,
    )
    assert [(m.name, m.kind) for m in detector.models] == [
        ("belt", "constant_acceleration"),
        ("fall", "constant_acceleration"),
    ]
    assert isinstance(detector.likelihood, LumpConfig)
    alarm = roi.alarm
    assert (alarm.raise_above, alarm.clear_below, alarm.on_delay_s, alarm.off_delay_s, alarm.latch) == (
        0.999,
        0.5,
        0.5,
        2.0,
        True,
    )


@pytest.mark.parametrize(
    ("roi", "above", "delay_s"),
    [
        ({}, 0.999, 0.5),
        ({"alarm": {"raise_above": 0.8}}, 0.8, 0.5),
        ({"detector": {"likelihood": {"margin": 2.0}}}, 0.999, 0.5),
        ({"detector": {"likelihood": {"kind": "histogram"}}}, 0.9, 0.2),
        ({"detector": {"kind": "jpda"}}, 0.9, 0.2),
        ({"watch": "mouth"}, 0.9, 0.2),
    ],
)
def test_the_alarm_of_the_lump_likelihood_waits_for_more(
    roi: dict[str, object], above: float, delay_s: float
) -> None:
    tree = site_tree()
    tree["cameras"][0]["rois"] = [{"id": "apron", "polygon": [list(p) for p in POLYGON]} | roi]
    alarm = site(tree).cameras[0].rois[0].alarm
    assert (alarm.raise_above, alarm.on_delay_s) == (above, delay_s)


def test_what_is_left_out_is_what_the_example_states() -> None:
    polygon = [list(p) for p in POLYGON]
    short = {
        "site": "s",
        "cameras": [{"id": "c", "source": {"url": "x"}, "rois": [{"id": "r", "polygon": polygon}]}],
    }
    roi = parse_config(json.dumps(short)).cameras[0].rois[0]
    example = parse_config(EXAMPLE, "x", SECRET).cameras[0].rois[0]
    assert roi.detector == example.detector
    assert roi.alarm == example.alarm


def test_a_model_may_be_a_kind_alone() -> None:
    detector = (
        parse_config(json.dumps(site_tree(models=["bounce", {"kind": "random_walk"}]))).cameras[0].rois[0]
    )
    assert [(m.name, m.kind) for m in detector.detector.models] == [
        ("bounce", "bounce"),
        ("random_walk", "random_walk"),
    ]


@pytest.mark.parametrize(
    "kind",
    [
        "constant_position",
        "random_walk",
        "constant_velocity",
        "constant_acceleration",
        "bounce_x",
        "bounce_y",
        "bounce",
    ],
)
def test_every_documented_kind_of_motion_is_known(kind: str) -> None:
    assert (
        parse_config(json.dumps(site_tree(models=[kind]))).cameras[0].rois[0].detector.models[0].kind == kind
    )


@pytest.mark.parametrize(
    ("likelihood", "colour"),
    [
        ({"kind": "lump"}, False),
        ({"kind": "histogram"}, False),
        ({"kind": "histogram", "channel": "colour"}, True),
    ],
)
def test_colour_is_asked_for_only_where_a_likelihood_looks_at_it(
    likelihood: dict[str, str], colour: bool
) -> None:
    camera = parse_config(json.dumps(site_tree(likelihood=likelihood))).cameras[0]
    assert camera.needs_colour is colour
    detector = camera.rois[0].detector
    assert isinstance(detector, JdtConfig)
    assert isinstance(detector.likelihood, HistogramConfig) is (likelihood["kind"] == "histogram")


@pytest.mark.parametrize(
    ("url", "kind"),
    [
        ("rtsp://h/x", "rtsp"),
        ("RTSPS://h/x", "rtsp"),
        ("sim:feed?dust=0", "simulated"),
        ("clip.mp4", "video"),
        ("file:///data/clip.mp4", "video"),
    ],
)
def test_the_url_tells_the_kind_of_source(url: str, kind: str) -> None:
    assert parse_config(json.dumps(with_camera(source={"url": url}))).cameras[0].source.kind == kind


def test_a_folder_is_a_source_of_images(tmp_path: Path) -> None:
    assert (
        parse_config(json.dumps(with_camera(source={"url": str(tmp_path)}))).cameras[0].source.kind
        == "images"
    )


def test_a_relative_store_lies_beside_the_file(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(EXAMPLE, encoding="utf-8")
    assert load_config(path, SECRET).store.path == tmp_path / "var"
    path.write_text(EXAMPLE.replace("path: var", "path: /srv/lumpwatch"), encoding="utf-8")
    assert load_config(path, SECRET).store.path == Path("/srv/lumpwatch")


def test_names_that_do_not_exist_are_key_errors() -> None:
    config = parse_config(json.dumps(site_tree()))
    with pytest.raises(KeyError):
        config.camera("nobody")
    with pytest.raises(KeyError):
        config.cameras[0].roi("nothing")


# Variables and secrets


def test_a_variable_may_come_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("p${X}@ss/w?rd\n", encoding="utf-8")
    config = parse_config(EXAMPLE, "site.yaml", {"CAM_PASSWORD_FILE": str(tmp_path / "password")})
    assert config.cameras[0].source.url.get_secret_value() == "rtsp://user:p${X}@ss/w?rd@10.0.0.5/stream"


def test_the_variable_itself_goes_before_its_file(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("other", encoding="utf-8")
    environ = SECRET | {"CAM_PASSWORD_FILE": str(tmp_path / "password")}
    url = parse_config(EXAMPLE, "site.yaml", environ).cameras[0].source.url.get_secret_value()
    assert url == "rtsp://user:hunter2-s3cret@10.0.0.5/stream"


def test_an_unset_variable_is_named() -> None:
    told = refused(EXAMPLE)
    assert "cameras[0].source.url" in told
    assert "CAM_PASSWORD is not set" in told


@pytest.mark.parametrize("content", [None, b"\xff\xfe\xff"])
def test_a_secret_file_that_cannot_be_read_is_named(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "password"
    if content is not None:
        path.write_bytes(content)
    told = refused(EXAMPLE, {"CAM_PASSWORD_FILE": str(path)})
    assert "cameras[0].source.url" in told
    assert "CAM_PASSWORD_FILE" in told


# Wrong configurations: one line with file and key

SQUARE = [[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]]


@pytest.mark.parametrize(
    ("polygon", "key", "reason"),
    [
        ([[0.1, 0.1], [0.9, 0.9], [0.9, 0.1], [0.1, 0.9]], "polygon", "crosses itself (edges 1 and 3)"),
        ([[0.1, 0.1], [0.1, 0.1], [0.9, 0.1], [0.9, 0.9]], "polygon", "corners 1 and 2 "),
        ([*SQUARE, [0.1, 0.1]], "polygon", "corners 1 and 5 "),
        ([[0.1, 0.1], [0.105, 0.1], [0.105, 0.105], [0.1, 0.105]], "polygon", "less than 0.01 %"),
        ([[0.1, 0.1], [0.5, 0.5], [0.9, 0.9]], "polygon", "at corner 3"),
        ([[0.1, 0.1], [0.9, 0.9]], "polygon", "at least 3"),
        ([[0.1, 0.1], [1.2, 0.1], [0.9, 0.9]], "polygon[1][0]", "found 1.2"),
        ([[0.1, 0.1], [0.9, -0.1], [0.9, 0.9]], "polygon[1][1]", "greater than or equal to 0"),
        ([[0.1, 0.1], [0.9, float("nan")], [0.9, 0.9]], "polygon[1][1]", "number"),
        ([[0.1, 0.1], [0.9], [0.9, 0.9]], "polygon[1][1]", "missing"),
        ([[0.1, 0.1], [0.9, 0.1, 0.5], [0.9, 0.9]], "polygon[1]", "at most 2"),
        ("all", "polygon", "tuple"),
    ],
)
def test_a_bad_polygon(polygon: object, key: str, reason: str) -> None:
    told = refused(json.dumps(with_roi(polygon=polygon)).replace("NaN", ".nan"))
    assert f"cameras[0].rois[0].{key}: " in told
    assert reason in told


@pytest.mark.parametrize(
    "polygon",
    [
        # Passes straight through (0.5, 0.5) twice.
        [[0.1, 0.1], [0.5, 0.5], [0.9, 0.8], [0.9, 0.2], [0.5, 0.5], [0.1, 0.8]],
        # Goes back on itself.
        [[0.1, 0.1], [0.9, 0.1], [0.5, 0.1], [0.5, 0.9]],
    ],
)
def test_a_polygon_that_touches_itself(polygon: list[list[float]]) -> None:
    refused_tree(with_roi(polygon=polygon))


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0.05, 0.95), st.floats(0.05, 0.95)), min_size=3, max_size=3, unique=True))
def test_a_triangle_never_crosses_itself(points: list[tuple[float, float]]) -> None:
    assume(polygon_area(tuple(points)) > 2e-4)
    polygon = parse_config(json.dumps(with_roi(polygon=points))).cameras[0].rois[0].polygon
    assert polygon == tuple(points)


def test_area_of_a_polygon() -> None:
    assert polygon_area(((0.0, 0.0), (0.5, 0.0), (0.5, 0.4), (0.0, 0.4))) == pytest.approx(0.2)
    assert polygon_area(((0.0, 0.0), (0.0, 0.4), (0.5, 0.0))) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("tree", "key", "reason"),
    [
        ({**site_tree(), "sight": "x"}, "sight", "unknown key"),
        (with_roi(colour=True), "cameras[0].rois[0].colour", "unknown key"),
        (site_tree(partikles=3), "cameras[0].rois[0].detector.partikles", "unknown key"),
        ({"site": "s"}, "cameras", "missing"),
        ({"site": "s", "cameras": []}, "cameras", "at least 1"),
        ({**site_tree(), "site": "north pit"}, "site", "pattern"),
        (with_camera(id="a/b"), "cameras[0].id", "pattern"),
        (with_camera(rois=[]), "cameras[0].rois", "at least 1"),
        (site_tree(particles="many"), "cameras[0].rois[0].detector.particles", "'many'"),
        (site_tree(particles=49), "cameras[0].rois[0].detector.particles", "found 49"),
        (site_tree(particles=[1]), "cameras[0].rois[0].detector.particles", "integer"),
        (site_tree(models=[]), "cameras[0].rois[0].detector.models", "at least 1"),
        (site_tree(models=["warp"]), "cameras[0].rois[0].detector.models[0].kind", "'warp'"),
        (site_tree(models=["bounce", "bounce"]), "cameras[0].rois[0].detector", "'bounce' is given more"),
        (site_tree(size_h=[0.4, 0.2]), "cameras[0].rois[0].detector", "size_h must be"),
        (site_tree(likelihood={"kind": "magic"}), "cameras[0].rois[0].detector.likelihood", "kind lump"),
        (
            site_tree(models=[{"kind": "bounce", "acceleration_h_s2": [0, 1]}]),
            "cameras[0].rois[0].detector.models[0]",
            "acceleration_h_s2 belongs to constant_acceleration",
        ),
        (
            site_tree(models=[{"kind": "random_walk", "velocity_noise_h_s": 1}]),
            "cameras[0].rois[0].detector.models[0]",
            "use position_noise_h",
        ),
        (
            site_tree(models=[{"kind": "bounce", "position_noise_h": 1}]),
            "cameras[0].rois[0].detector.models[0]",
            "use velocity_noise_h_s",
        ),
        (
            with_roi(alarm={"raise_above": 0.5, "clear_below": 0.5}),
            "cameras[0].rois[0].alarm",
            "clear_below (0.5)",
        ),
        (with_roi(alarm={"raise_above": 1.1}), "cameras[0].rois[0].alarm.raise_above", "found 1.1"),
        (with_roi(alarm={"on_delay_s": -1}), "cameras[0].rois[0].alarm.on_delay_s", "found -1"),
        (with_roi(alarm={"latch": "maybe"}), "cameras[0].rois[0].alarm.latch", "'maybe'"),
        (with_camera(source={"url": ""}), "cameras[0].source.url", "empty"),
        (with_camera(source={"url": 5}), "cameras[0].source.url", "string"),
        (with_camera(source={"url": "http://h/x"}), "cameras[0].source.url", "'http' is not supported"),
        (with_camera(source={"url": "rtsp:///x"}), "cameras[0].source.url", "names no host"),
        (
            with_camera(source={"url": "x", "backoff": {"initial_s": 5, "max_s": 1}}),
            "cameras[0].source.backoff",
            "max_s (1) must not be smaller",
        ),
        (with_camera(wire={"encoding": "png"}), "cameras[0].wire.encoding", "'png'"),
        ({**site_tree(), "bus": {"mode": "router", "listen": []}}, "bus", "at least one endpoint in listen"),
        ({**site_tree(), "bus": {"mode": "client"}}, "bus", "at least one endpoint in connect"),
        ({**site_tree(), "bus": {"listen": ["127.0.0.1:1"]}}, "bus.listen[0]", "pattern"),
        ({**site_tree(), "telemetry": {"listen": "9464"}}, "telemetry.listen", "not host:port"),
        ({**site_tree(), "telemetry": {"listen": "h:99999"}}, "telemetry.listen", "not host:port"),
        ({**site_tree(), "store": {"keep_priors": 1}}, "store.keep_priors", "found 1"),
    ],
)
def test_a_wrong_value_is_named_by_its_key(tree: dict[str, Any], key: str, reason: str) -> None:
    told = refused_tree(tree)
    assert told.startswith(f"site.yaml: {key}: "), told
    assert reason in told


def test_ids_that_are_given_twice() -> None:
    tree = site_tree()
    tree["cameras"].append(tree["cameras"][0])
    assert "id 'cam' " in refused_tree(tree)
    tree = site_tree()
    tree["cameras"][0]["rois"] *= 2
    assert "cameras[0]: rois: id 'apron' " in refused_tree(tree)


def test_the_number_of_further_problems_is_told() -> None:
    told = refused_tree({**with_roi(alarm={"raise_above": 7}), "nonsense": 1})
    assert told.endswith("(and 1 more)")
