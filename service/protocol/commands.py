"""What operators and the plant may ask of an alarm over the bus: parameters of a query -> what is done."""

from __future__ import annotations

import json
from collections.abc import Callable

from lumpwatch.service.bus import Kind
from lumpwatch.service.core import (
    Act,
    AlarmClass,
    AlarmRequestError,
    acknowledge,
    all_of,
    put_back,
    reset,
    shelve,
    suppress,
    take_out,
    unshelve,
    unsuppress,
)
from lumpwatch.service.protocol.requests import (
    AckRequest,
    Request,
    ResetRequest,
    ServiceRequest,
    ShelveRequest,
    SuppressRequest,
    UnshelveRequest,
)

Parameters = dict[str, str]
_LONGEST = 128, 500
"""Characters that are kept of a name, and of a reason."""


def read(parameters: Parameters, payload: bytes | None) -> Parameters:
    """The parameters of a query, or those that its payload, or a put, carries as a JSON object.

    Raises AlarmRequestError for a payload that is something else.
    """
    if not payload:
        return parameters
    try:
        carried = json.loads(payload)
    except ValueError as error:
        raise AlarmRequestError("the payload is not JSON") from error
    if not isinstance(carried, dict):
        raise AlarmRequestError("the payload is not a JSON object")
    return {str(name): str(value) for name, value in carried.items()} | parameters


def act_of(kind: Kind, parameters: Parameters) -> tuple[AlarmClass, Act]:
    """Which alarm is meant, and what is to be done to it. Raises AlarmRequestError."""
    model, make = _KINDS[kind]
    names = model.names()
    if unknown := sorted(set(parameters) - names):
        has = ", ".join([*sorted(names - {"class"}), "class"])
        raise AlarmRequestError(f"{unknown[0]}: is no parameter of {kind} (has {has})")
    wanted = parameters.get("class", AlarmClass.LUMP.value)
    if wanted not in tuple(AlarmClass):
        raise AlarmRequestError(f"class: '{wanted}' is none of {', '.join(AlarmClass)}")
    return AlarmClass(wanted), make(parameters)


def text_of(parameters: Parameters, name: str, longest: int) -> str:
    """A parameter without needless white space, cut at `longest`. Raises AlarmRequestError where it is missing."""
    value = " ".join(parameters.get(name, "").split())[:longest]
    if not value:
        raise AlarmRequestError(f"{name}: is missing")
    return value


def _actor(parameters: Parameters) -> str:
    return text_of(parameters, "actor", _LONGEST[0])


def _reason(parameters: Parameters) -> str:
    return text_of(parameters, "reason", _LONGEST[1])


def _seconds(parameters: Parameters, name: str) -> float:
    text = text_of(parameters, name, _LONGEST[0])
    try:
        return float(text)
    except ValueError:
        raise AlarmRequestError(f"{name}: '{text}' is not a number of seconds") from None


def _acknowledge(parameters: Parameters) -> Act:
    actor = _actor(parameters)
    return lambda alarm, _, now_s: all_of(acknowledge(alarm, actor, now_s))


def _reset(parameters: Parameters) -> Act:
    actor = _actor(parameters)
    return lambda alarm, _, now_s: all_of(reset(alarm, actor, now_s))


def _shelve(parameters: Parameters) -> Act:
    actor, reason, for_s = _actor(parameters), _reason(parameters), _seconds(parameters, "for_s")
    return lambda alarm, rules, now_s: all_of(shelve(alarm, rules, now_s, actor, reason, for_s))


def _unshelve(parameters: Parameters) -> Act:
    actor = _actor(parameters)
    return lambda alarm, _, now_s: unshelve(alarm, now_s, actor)


def _service(parameters: Parameters) -> Act:
    actor, state = _actor(parameters), text_of(parameters, "state", _LONGEST[0])
    if state == "in":
        return lambda alarm, _, now_s: put_back(alarm, now_s, actor)
    if state != "out":
        raise AlarmRequestError(f"state: '{state}' is neither in nor out")
    reason = _reason(parameters)
    return lambda alarm, _, now_s: all_of(take_out(alarm, now_s, actor, reason))


def _suppress(parameters: Parameters) -> Act:
    signal, valid_s = text_of(parameters, "signal", _LONGEST[0]), _seconds(parameters, "valid_s")
    if valid_s == 0.0:
        return lambda alarm, _, now_s: unsuppress(alarm, now_s, signal)
    return lambda alarm, rules, now_s: all_of(suppress(alarm, rules, now_s, signal, valid_s))


_KINDS: dict[Kind, tuple[type[Request], Callable[[Parameters], Act]]] = {
    Kind.ACK: (AckRequest, _acknowledge),
    Kind.RESET: (ResetRequest, _reset),
    Kind.SHELVE: (ShelveRequest, _shelve),
    Kind.UNSHELVE: (UnshelveRequest, _unshelve),
    Kind.SERVICE: (ServiceRequest, _service),
    Kind.SUPPRESS: (SuppressRequest, _suppress),
}
