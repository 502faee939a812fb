"""Who may do what on the bus: zenoh's access control, made from the roles of the configuration.

The hub judges every message of every link by the common name of the peer's certificate. What no rule
allows is dropped in silence: to the sender it looks as if nobody were there.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Protocol

from lumpwatch.service.bus.keys import Kind, on_every_site
from lumpwatch.service.config import AccessConfig

INTERNAL = (Kind.TEST_FRAME, Kind.BLEND)
"""What the daemon's processes exchange among themselves."""
READABLE = tuple(kind for kind in Kind if kind not in INTERNAL)
"""What everyone with a certificate may receive."""
GATEWAY_COMMANDS = ("ack", "shelve", "unshelve")
"""The operators' commands that a gateway to the plant's control system may give, beside the plant's signals."""

_READ = ["declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"]
_SEEN = ["put", "delete", "reply", "liveliness_token", "declare_subscriber", "declare_queryable"]
_ALL = [*dict.fromkeys([*_READ, *_SEEN])]
# `**` does not stand for parts that begin with @, in which liveliness and the publishers' caches live.
_ANYTHING = ["**", "**/@alive/**", "**/@adv/**"]


class Role(StrEnum):
    """Who may give a command."""

    ANYONE = "anyone"
    """Whoever has a certificate: the command only reads."""
    OPERATOR = "operator"
    PLANT = "plant"
    """Plant control."""


class Commandable(Protocol):
    """What the rules need of a command; the rows of the command table have it."""

    @property
    def name(self) -> str:
        """The last part of its key."""

    @property
    def role(self) -> Role:
        """Who may give it."""

    @property
    def puts(self) -> bool:
        """Whether a plain put does it too."""


def access_control(access: AccessConfig, commands: Iterable[Commandable]) -> dict[str, object]:
    """The `access_control` part of a hub's zenoh configuration; nobody but a daemon may send other commands."""
    given = tuple(commands)
    to_all = [command.name for command in given if command.role is Role.ANYONE]
    to_operators = [command.name for command in given if command.role is Role.OPERATOR]
    to_plants = [command.name for command in given if command.role is Role.PLANT]
    from_gateways = [command.name for command in given if command.name in GATEWAY_COMMANDS]
    put = [command.name for command in given if command.role is Role.PLANT and command.puts]
    rules = [
        _rule("everything", _ALL, _ANYTHING, "ingress", "egress"),
        _rule("read", _READ, _of([*READABLE, *to_all]), "ingress"),
        _rule("receive", _SEEN, _ANYTHING, "egress"),
        _rule("command", ["query"], _of(to_operators), "ingress"),
        _rule("signal", ["query"], _of(to_plants), "ingress"),
        _rule("put", ["put"], _of(put), "ingress"),
        _rule("pass_on", ["query"], _of(from_gateways), "ingress"),
    ]
    rules = [rule for rule in rules if rule["key_exprs"]]
    known = {rule["id"] for rule in rules}
    roles = {
        "daemons": (access.daemons, ["everything"]),
        "operators": (access.operators, ["command"]),
        "plants": (access.plants, ["signal", "put"]),
        "gateways": (access.gateways, ["pass_on", "signal", "put"]),
    }
    named = {role: (names, [rule for rule in may if rule in known]) for role, (names, may) in roles.items()}
    named = {role: given for role, given in named.items() if all(given)}
    everyone = {"id": "everyone"}  # no attribute: every certificate matches
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [
            everyone,
            *({"id": role, "cert_common_names": names} for role, (names, _) in named.items()),
        ],
        "policies": [
            {"rules": ["read", "receive"], "subjects": ["everyone"]},
            *({"rules": allowed, "subjects": [role]} for role, (_, allowed) in named.items()),
        ],
    }


def _rule(name: str, messages: list[str], keys: list[str], *flows: str) -> dict[str, object]:
    return {"id": name, "flows": list(flows), "messages": messages, "key_exprs": keys, "permission": "allow"}


def _of(kinds: Iterable[str]) -> list[str]:
    """The keys of some kinds on every site, with the caches of their publishers."""
    kinds = tuple(kinds)
    caches = [f"{on_every_site(kind)}/@adv/**" for kind in kinds if kind != Kind.ALIVE]
    return [*(on_every_site(kind) for kind in kinds), *caches]
