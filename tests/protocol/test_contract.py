"""The AsyncAPI document: valid, complete, and with examples that the daemon itself would take."""

from __future__ import annotations

import gzip
import json
from io import StringIO
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic import BaseModel
from ruamel.yaml import YAML

from lumpwatch.service.bus.keys import KEY_OF, Kind, command_key, parse
from lumpwatch.service.cli import main
from lumpwatch.service.protocol.asyncapi import asyncapi_document
from lumpwatch.service.protocol.commands import COMMANDS
from lumpwatch.service.protocol.examples import example
from lumpwatch.service.protocol.requests import read_request
from lumpwatch.service.protocol.schemas import MESSAGES, message_schema

SPECIFICATION = Path(__file__).parents[1] / "schemas" / "asyncapi-3.0.0.json.gz"
DOCUMENT: dict[str, Any] = json.loads(json.dumps(asyncapi_document()))


def errors(one: object) -> list[str]:
    specification = json.loads(gzip.decompress(SPECIFICATION.read_bytes()))
    return [error.message for error in jsonschema.Draft7Validator(specification).iter_errors(one)]


def references(one: object) -> list[str]:
    if isinstance(one, dict):
        own = [one["$ref"]] if isinstance(one.get("$ref"), str) else []
        return own + [ref for value in one.values() for ref in references(value)]
    if isinstance(one, list):
        return [ref for value in one for ref in references(value)]
    return []


def test_the_document_is_asyncapi_3() -> None:
    assert errors(DOCUMENT) == []
    assert errors({**DOCUMENT, "channels": {"alarm": {"addres": "x"}}})  # the check can fail


def test_every_reference_leads_somewhere() -> None:
    for reference in references(DOCUMENT):
        found: Any = DOCUMENT
        for part in reference.removeprefix("#/").split("/"):
            found = found[part]


def test_every_key_has_a_channel_and_an_operation() -> None:
    addresses = {channel["address"] for channel in DOCUMENT["channels"].values()}
    assert addresses == {*KEY_OF.values(), *map(command_key, COMMANDS)}
    assert set(KEY_OF) == set(Kind)
    used = {operation["channel"]["$ref"] for operation in DOCUMENT["operations"].values()}
    assert used == {f"#/channels/{name}" for name in DOCUMENT["channels"]}


@pytest.mark.parametrize("kind", Kind)
def test_addresses_are_keys(kind: Kind) -> None:
    names = {"site": "pit", "camera": "cam", "roi": "apron", "role": "monitor", "name": "cam"}
    assert parse(KEY_OF[kind].format(**names)).kind is kind


@pytest.mark.parametrize("name", MESSAGES)
def test_examples_fit_their_schema_and_come_back(name: str) -> None:
    one, model = example(MESSAGES[name]), MESSAGES[name]
    jsonschema.Draft202012Validator(json.loads(message_schema(name))).validate(one)
    again: BaseModel = model.model_validate_json(json.dumps(one))
    assert json.loads(again.model_dump_json(by_alias=True)) == one


@pytest.mark.parametrize("name", DOCUMENT["components"]["messages"])
def test_examples_in_the_document_fit_its_own_schemas(name: str) -> None:
    message = DOCUMENT["components"]["messages"][name]
    for part in ("payload", "headers"):
        if message.get(part, {}).get("$ref"):
            whole = {**message[part], "components": DOCUMENT["components"]}
            (one,) = message["examples"]
            jsonschema.Draft202012Validator(whole).validate(one[part])


@pytest.mark.parametrize("name", COMMANDS)
def test_the_examples_of_requests_are_understood(name: str) -> None:
    payload = {key: value for key, value in example(COMMANDS[name].request).items() if value is not None}
    assert read_request(COMMANDS[name].request, {}, json.dumps(payload).encode()) == COMMANDS[name].example


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "asyncapi"]) == 0
    printed = YAML(typ="safe").load(StringIO(capsys.readouterr().out))
    assert printed == DOCUMENT
