"""Who may do what on the bus: zenoh's access control, made from the roles of the configuration.

The hub judges every message of every link by the common name of the peer's certificate. What no rule
allows is dropped in silence: to the sender it looks as if nobody were there.
"""

from __future__ import annotations

from lumpwatch.service.bus.keys import Kind, on_every_site
from lumpwatch.service.config import AccessConfig

COMMANDS = (Kind.ACK, Kind.RESET, Kind.SHELVE, Kind.UNSHELVE, Kind.SERVICE, Kind.VERDICT, Kind.PROOF)
"""Queries that operators may send."""
SIGNALS = (Kind.SUPPRESS,)
"""Puts and queries that plant control may send."""
INTERNAL = (Kind.TEST_FRAME, Kind.BLEND)
"""What the daemon's processes say among themselves."""
READABLE = (
    Kind.FRAME,
    Kind.JPEG,
    Kind.HEARTBEAT,
    Kind.STATE,
    Kind.ALARM,
    Kind.TEST,
    Kind.LEVEL,
    Kind.EVIDENCE,
    Kind.PRIOR,
    Kind.SHADOW,
    Kind.ALIVE,
)
"""What everyone with a certificate may receive and ask for."""

_READ = ["declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"]
_SEEN = ["put", "delete", "reply", "liveliness_token", "declare_subscriber", "declare_queryable"]
_ALL = [*dict.fromkeys([*_READ, *_SEEN])]
# `**` does not stand for parts that begin with @, in which liveliness and the publishers' caches live.
_ANYTHING = ["**", "**/@alive/**", "**/@adv/**"]


def access_control(access: AccessConfig) -> dict[str, object]:
    """The `access_control` part of a hub's zenoh configuration."""
    rules = [
        {"id": "everything", "flows": ["ingress", "egress"], "messages": _ALL, "key_exprs": _ANYTHING},
        {"id": "read", "flows": ["ingress"], "messages": _READ, "key_exprs": _of(READABLE)},
        {"id": "receive", "flows": ["egress"], "messages": _SEEN, "key_exprs": _ANYTHING},
        {"id": "command", "flows": ["ingress"], "messages": ["query"], "key_exprs": _of(COMMANDS)},
        {"id": "signal", "flows": ["ingress"], "messages": ["query", "put"], "key_exprs": _of(SIGNALS)},
    ]
    roles = {
        "daemons": (access.daemons, ["everything"]),
        "operators": (access.operators, ["command"]),
        "plants": (access.plants, ["signal"]),
    }
    named = {role: given for role, given in roles.items() if given[0]}
    everyone = {"id": "everyone"}  # no attribute: every certificate matches
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule | {"permission": "allow"} for rule in rules],
        "subjects": [
            everyone,
            *({"id": role, "cert_common_names": names} for role, (names, _) in named.items()),
        ],
        "policies": [
            {"rules": ["read", "receive"], "subjects": ["everyone"]},
            *({"rules": allowed, "subjects": [role]} for role, (_, allowed) in named.items()),
        ],
    }


def _of(kinds: tuple[Kind, ...]) -> list[str]:
    """The keys of some kinds on every site, with the caches of their publishers."""
    caches = [f"{on_every_site(kind)}/@adv/**" for kind in kinds if kind is not Kind.ALIVE]
    return [*(on_every_site(kind) for kind in kinds), *caches]
