"""The text of a configuration: whatever it holds, it is taken or refused in one line; and the schema."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.service.config import SiteConfig, config_schema, load_config, parse_config
from lumpwatch.service.errors import ConfigError
from tests.config.test_config import EXAMPLE, refused
from tests.service_helpers import site_tree


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "expected a mapping"),
        ("- a\n- b\n", "expected a mapping"),
        ("just words", "expected a mapping"),
        ("site: [1, 2\n", "line 2"),
        ("site: a\n\tb: c\n", "line 2"),
        ("site: a\nsite: b\ncameras: []\n", 'duplicate key "site"'),
        ("site: !!python/object/apply:os.system [ls]\n", "tag"),
        ("a: 1\n---\nb: 2\n", "another document"),
        ("%YAML 9.9\n---\nsite: a\n", "incompatible"),
        ("site: *nowhere\n", "alias"),
        ("site: 2020-99-99\n", "not valid YAML"),
        ("[" * 5000, "line 1, column 51: more than 50 levels"),
        ("- " * 5000, "line 1, column 101: more than 50 levels"),
        ("a: {" * 5000, "more than 50 levels"),
        ("site: " + "9" * 5000, "not valid YAML"),
    ],
)
def test_text_that_is_no_configuration(text: str, reason: str) -> None:
    assert reason in refused(text)


@pytest.mark.parametrize(
    "text",
    [
        "site: !!int ''\n",  # IndexError
        "site: !!bool x\n",  # KeyError
        "site: &a [*a]\n",  # RecursionError in _substitute
        json.dumps(site_tree()).replace("300", "0x" + "f" * 6000),  # ValueError in the message itself
        json.dumps({**site_tree(), "a\nb": 1}),  # a message of two lines
    ],
)
def test_text_that_the_yaml_reader_trips_over(text: str) -> None:
    refused(text)


def test_many_unknown_keys_are_one_line() -> None:
    """Each problem is compared with what holds it, not with every other: ten thousand are read in seconds."""
    text = "\n".join(f"key{number}: 1" for number in range(10_000))
    assert "(and 10001 more)" in refused(text)


def test_aliases_do_not_multiply() -> None:
    """Four strings, and six levels of four references to the level before."""
    levels = ["a0: &a0 ['${N}', '${N}', '${N}', '${N}']"]
    levels += [f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}, *a{i - 1}, *a{i - 1}]" for i in range(1, 7)]
    looked_up = 0

    class Counting(dict[str, str]):
        def __contains__(self, key: object) -> bool:
            nonlocal looked_up
            looked_up += 1
            return super().__contains__(key)

    with pytest.raises(ConfigError):
        parse_config("\n".join(levels), "site.yaml", Counting(N="1"))
    assert looked_up <= 100


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing\.yaml: cannot be read"):
        load_config(tmp_path / "nothing.yaml")


def test_a_folder_is_no_configuration(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot be read"):
        load_config(tmp_path)


def test_a_file_that_is_not_text(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_bytes(b"site: \xff\xfe\n")
    with pytest.raises(ConfigError, match=r"site\.yaml: .*UTF-8"):
        load_config(tmp_path / "site.yaml")


def test_a_device_that_never_ends_is_too_large() -> None:
    with pytest.raises(ConfigError, match="larger than 1 MiB"):
        load_config(Path("/dev/zero"))


def test_a_secret_of_a_file_that_never_ends() -> None:
    text = "site: ${NAME}\ncameras: []\n"
    with pytest.raises(ConfigError, match="the file that NAME_FILE names cannot be read"):
        parse_config(text, environ={"NAME_FILE": "/dev/zero"})


@pytest.mark.parametrize("text", ['store: {path: "a\\0b"}\n', 'cameras: [{source: {url: "a\\0.mp4"}}]\n'])
def test_a_zero_byte_is_refused_by_its_key(text: str) -> None:
    with pytest.raises(ConfigError, match=r"(store\.path|cameras\[0\]\.source\.url): holds a zero byte"):
        parse_config(text)


def test_superscripts_are_no_port() -> None:
    with pytest.raises(ConfigError, match=r"telemetry\.listen: '127\.0\.0\.1:²' is not host:port"):
        parse_config('site: pit\ntelemetry: {listen: "127.0.0.1:²"}\n')


def test_a_file_that_is_far_too_large(tmp_path: Path) -> None:
    with (tmp_path / "site.yaml").open("wb") as file:
        file.truncate(64 << 20)
    with pytest.raises(ConfigError, match=r"site\.yaml: larger than 1 MiB"):
        load_config(tmp_path / "site.yaml")


# Anything at all

SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**12), 10**12),
    st.floats(),
    st.text(max_size=12),
    st.sampled_from(["rtsp://a:b@", "${X}", "lump", "bounce", "tcp/1", "1:2", "~"]),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text("abcdef", max_size=4), inner, max_size=3)
    ),
    max_leaves=6,
)


def _places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    below = [place for key, value in items for place in _places(value, (*path, key))]
    return [path, *below] if path else below


def _accept_or_refuse(text: str) -> None:
    try:
        assert isinstance(parse_config(text, "site.yaml", {"X": "1"}), SiteConfig)
    except ConfigError as error:
        told = str(error)
        assert told.startswith("site.yaml: ")
        assert len(told.splitlines()) == 1


@settings(deadline=None)
@given(st.data())
def test_any_value_anywhere_is_accepted_or_refused(data: st.DataObject) -> None:
    tree = site_tree()
    tree["bus"] = {"mode": "router", "listen": ["tcp/127.0.0.1:7447"]}
    tree["store"] = {"path": "var", "keep_priors": 5}
    place = data.draw(st.sampled_from(_places(tree)))
    node = tree
    for key in place[:-1]:
        node = node[key]
    node[place[-1]] = data.draw(VALUES)
    # JSON is YAML but for the spelling of numbers that are none.
    _accept_or_refuse(json.dumps(tree).replace("NaN", ".nan").replace("Infinity", ".inf"))


@settings(deadline=None)
@given(st.data())
def test_damaged_text_is_accepted_or_refused(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(EXAMPLE)))
    end = data.draw(st.integers(start, min(start + 40, len(EXAMPLE))))
    put = data.draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=10))
    _accept_or_refuse(EXAMPLE[:start] + put + EXAMPLE[end:])


@settings(deadline=None)
@given(st.text(max_size=200))
def test_random_text_is_accepted_or_refused(text: str) -> None:
    _accept_or_refuse(text)


# The schema


def _without_description(node: Any, where: str) -> list[str]:
    found = []
    for name, field in node.get("properties", {}).items():
        if not field.get("description"):
            found.append(f"{where}.{name}")
    return found


def test_every_field_is_described_in_the_schema() -> None:
    tree = json.loads(config_schema())
    missing = _without_description(tree, "SiteConfig")
    for name, definition in tree["$defs"].items():
        missing += _without_description(definition, name)
    assert len(tree["$defs"]) >= 10
    assert missing == []


def test_the_schema_refuses_unknown_keys_too() -> None:
    tree = json.loads(config_schema())
    objects = [tree, *(d for d in tree["$defs"].values() if d.get("type") == "object")]
    assert all(d["additionalProperties"] is False for d in objects)


@pytest.mark.parametrize("text", ['site: "\\ud800"\n', '"\\ud800": 1\n', 'site: {"\\ud800": 1}\n'])
def test_characters_that_are_no_text(text: str) -> None:
    """A lone surrogate, as an escape in YAML can name it, cannot be encoded anywhere."""
    with pytest.raises(ConfigError) as error:
        parse_config(text, "site.yaml")
    assert str(error.value).encode().startswith(b"site.yaml: ")
