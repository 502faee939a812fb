"""A key that is written wrongly is named first, with the one that was meant; short secrets spoil no words."""

from __future__ import annotations

import json
from typing import Any

import pytest

from lumpwatch.service.config import JdtConfig, LumpConfig, parse_config
from lumpwatch.service.config.known_keys import keys_at
from lumpwatch.service.errors import ConfigError
from tests.service_helpers import site_tree


def refused(tree: dict[str, Any], environ: dict[str, str] | None = None) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_config(json.dumps(tree), "site.yaml", environ or {})
    return str(caught.value)


def test_the_wrong_key_comes_before_the_missing_one() -> None:
    tree = site_tree()
    roi = tree["cameras"][0]["rois"][0]
    roi["polygn"] = roi.pop("polygon")
    assert "rois[0].polygn: unknown key; did you mean polygon? (and 1 more)" in refused(tree)


@pytest.mark.parametrize(
    ("place", "wrong", "meant"),
    [
        (("detector",), "particels", "particles"),
        (("detector", "likelihood"), "margn", "margin"),
        (("alarm",), "raise_abov", "raise_above"),
    ],
)
def test_the_nearest_key_is_named_in_unions_too(place: tuple[str, ...], wrong: str, meant: str) -> None:
    tree = site_tree(likelihood={"kind": "lump"})
    node = tree["cameras"][0]["rois"][0]
    for part in place:
        node = node.setdefault(part, {})
    node[wrong] = 1
    assert f"{wrong}: unknown key; did you mean {meant}?" in refused(tree)


def test_a_key_that_is_like_none_gets_no_guess() -> None:
    assert "zzz: unknown key" in refused({**site_tree(), "zzz": 1})
    assert "did you mean" not in refused({**site_tree(), "zzz": 1})


def test_keys_of_the_top_level() -> None:
    assert {"site", "cameras", "bus", "store"} <= set(keys_at(()))


def test_a_likelihood_without_a_kind_is_a_lump() -> None:
    config = parse_config(json.dumps(site_tree(likelihood={"margin": 1.5})))
    detector = config.cameras[0].rois[0].detector
    assert isinstance(detector, JdtConfig)
    assert detector.likelihood == LumpConfig(margin=1.5)


@pytest.mark.parametrize("secret", ["a", "pin", "s3cret"])
def test_a_secret_is_hidden_and_words_stay_whole(secret: str) -> None:
    tree = site_tree()
    tree["cameras"][0]["source"]["url"] = "rtsp://u:${PW}@h/x"
    tree["store"] = {"keep_priors": "${PW}"}
    told = refused(tree, {"PW": secret})
    assert "input should be a valid integer" in told
    assert f"'{secret}'" not in told
    assert "'***'" in told
