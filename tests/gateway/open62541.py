"""A client of OPC UA that shares no code with the server: open62541, by the package o6, as a process of its own.

    python -m tests.gateway.open62541 URL CERTIFICATE KEY AUTHORITY [USER PASSWORD]

It reads orders from its input, a JSON list a line, and answers each with a line: `["read", NODE…]`,
`["write", NODE, VALUE]`, `["call", NODE, METHOD, ARGUMENT…]`; with a text where the server refused. Without a licence
of its own the package
ends its process after ten minutes, so nothing else imports it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self


class Open62541:
    """The process, driven."""

    def __init__(self, url: str, folder: Path, name: str, *user: str) -> None:
        """`folder` holds the authority's certificate, and that of `name` with its key."""
        files = [str(folder / file) for file in (f"{name}.pem", f"{name}-key.pem", "ca.pem")]
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, url, *files, *user],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate(timeout=20)

    def ask(self, *order: object) -> Any:
        """One order's answer. Raises ConnectionError where the client has ended, as without a session."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(order) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError as error:
            raise ConnectionError("the client has ended") from error
        if not (line := self._process.stdout.readline()):
            raise ConnectionError("the client has ended")
        return json.loads(line)


def _serve(url: str, certificate: str, key: str, server: str, *user: str) -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # the package greets on its output
    import o6

    named = {"username": user[0], "password": user[1]} if user else {}
    with o6.Client(
        url,
        certificate=certificate,
        privateKey=key,
        trustList=[server],
        securityMode=3,
        securityPolicy="http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256",
        applicationUri="urn:test:client",
        **named,
    ) as client:
        for line in sys.stdin:
            what, *given = json.loads(line)
            try:
                told = _ORDERS[what](client, *given)
            except o6.StatusCodeError as error:
                told = str(error)
            print(json.dumps(told), file=answers, flush=True)


def _read(client: Any, *nodes: str) -> list[dict[str, Any]]:
    """Value, status code, and whether there is a source time, of each."""
    return [
        {
            "value": one.value.item() if hasattr(one.value, "item") else one.value,
            "status": int(one.status or 0),
            "dated": one.sourceTimestamp is not None,
        }
        for one in client.read(list(nodes), valueOnly=False)
    ]


def _write(client: Any, node: str, value: int) -> None:
    """A number of 32 bit."""
    import o6

    client.write(node, o6.UInt32(value))


def _call(client: Any, node: str, method: str, *arguments: object) -> list[Any]:
    """Status code, and what the method of that name gives back."""
    found = next(one for one in client.browse(node) if one.browseName.name == method)
    status, *given = client.call(node, found.nodeId, list(arguments))
    return [int(status), *map(str, given)]


_ORDERS: dict[str, Callable[..., Any]] = {"read": _read, "write": _write, "call": _call}

if __name__ == "__main__":
    _serve(*sys.argv[1:])
