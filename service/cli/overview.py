"""`lumpwatch --help`: the commands in groups. Written here, so that no command has to be imported to list them."""

from __future__ import annotations

from difflib import get_close_matches

GROUPS: dict[str, dict[str, str]] = {
    "begin": {
        "demo": "the whole product on a simulated crusher",
        "init": "five questions, a commented configuration file",
        "check": "is the configuration right; what calibrations mean; what cameras send",
        "bench": "how many such cameras this machine carries",
        "snapshot": "a still of a camera",
        "record": "a clip of a camera",
        "completion": "of the command line in bash, zsh, fish",
        "lens": "how much a lens bends the picture",
        "reference": "learn what a fit picture looks like",
    },
    "train and judge": {
        "train": "learn a region from labelled clips, or propose labels",
        "refine": "learn anew from confirmed clips, in shadow",
        "priors": "versions of what was learned: list, try, promote, go back",
        "labels": "labelled clips from judged alarms",
        "replay": "run the pipeline on a recording",
        "backtest": "compare configurations over an archive",
        "evaluate": "how well tracks fit the truth",
        "simulate": "render a simulated feed with labels",
    },
    "run": {
        "run": "the daemon",
        "console": "the operator's page",
        "users": "who may use it",
        "gateway": "to the control system",
        "health": "does the daemon decide",
        "proof": "test a running daemon with a synthetic lump",
        "deploy": "run the daemon as a container",
        "schema": "JSON Schemas and AsyncAPI",
    },
    "operate": {
        "alarms": "follow alarms; says SILENT when nothing is heard",
        "ack": "acknowledge an alarm",
        "reset": "reset a latched alarm",
        "shelve": "not announce an alarm for a time",
        "unshelve": "end that",
        "service": "take an alarm out of service, or back",
        "events": "the event log",
        "evidence": "clips and stills of alarms",
        "verdict": "say whether an alarm was true",
        "report": "the report of a shift",
    },
}
"""By group: each command in a few words."""


def overview() -> str:
    """The help of the command as a whole."""
    lines = [
        "usage: lumpwatch [-h] [--version] COMMAND ...",
        "",
        "Watches the feed of a crusher and says in time that a large lump is coming.",
    ]
    for title, commands in GROUPS.items():
        lines += ["", f"{title}:", *(f"  {name:<10} {text}" for name, text in commands.items())]
    return "\n".join([*lines, "", "lumpwatch COMMAND --help says more, with an example.", ""])


def unknown(command: str, known: list[str]) -> str:
    """One line about a command that there is not, with the one that was probably meant."""
    near = get_close_matches(command, known, n=1)
    meant = f"; did you mean {near[0]}?" if near else ""
    return f"lumpwatch: there is no command '{command}'{meant} (see lumpwatch --help)\n"
