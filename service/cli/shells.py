"""The scripts that complete the command line, for each shell."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence

from lumpwatch.service.cli.grammar import Grammar, Option, Value, files_or_words, values
from lumpwatch.service.cli.overview import GROUPS

_TOP = ("--help", "--version")
_SAID = {name: text for group in GROUPS.values() for name, text in group.items()}


def bash(commands: Sequence[Grammar]) -> str:
    """For bash 4 and later."""
    after, words = [], []
    for command in commands:
        for option, value in values(command):
            names = "|".join(f"{command.name}:{name}" for name in option.names)
            files, choices = value.file, " ".join(value.choices)
            does = (
                f"_lumpwatch_words {shlex.quote(choices)}"
                if choices
                else "_lumpwatch_files"
                if files
                else ":"
            )
            after.append(f"    {names}) {does}; return;;")
        files, places = files_or_words(command.places)
        options = " ".join(name for option in command.options for name in option.names)
        more = "; _lumpwatch_files" if files else ""
        words.append(
            f"    {command.name}) if [[ $cur == -* ]]; then _lumpwatch_words {shlex.quote(options)}; "
            f"else _lumpwatch_words {shlex.quote(' '.join(places))}{more}; fi;;"
        )
    names = " ".join([*(command.name for command in commands), *_TOP])
    return "\n".join(
        [
            "# bash completion of lumpwatch; written by: lumpwatch completion bash",
            '_lumpwatch_words() { local IFS=$\' \\n\'; COMPREPLY+=($(compgen -W "$1" -- "$cur")); }',
            "_lumpwatch_files() {",
            "  local found",
            '  while IFS= read -r found; do COMPREPLY+=("$found"); done < <(compgen -f -- "$cur")',
            "  compopt -o filenames 2>/dev/null",
            "}",
            "_lumpwatch() {",
            '  local cur="${COMP_WORDS[COMP_CWORD]}" prev="${COMP_WORDS[COMP_CWORD-1]}" command="${COMP_WORDS[1]}"',
            "  COMPREPLY=()",
            f"  if ((COMP_CWORD == 1)); then _lumpwatch_words {shlex.quote(names)}; return; fi",
            '  case "$command:$prev" in',
            *after,
            "  esac",
            '  case "$command" in',
            *words,
            "  esac",
            "}",
            "complete -F _lumpwatch lumpwatch",
            "",
        ]
    )


def zsh(commands: Sequence[Grammar]) -> str:
    """For zsh with its completion system (compinit)."""
    lines = [
        "#compdef lumpwatch",
        "# zsh completion of lumpwatch; written by: lumpwatch completion zsh",
        "_lumpwatch() {",
        "  if (( CURRENT == 2 )); then",
        "    local -a commands",
        f"    commands=({' '.join(shlex.quote(f'{one.name}:{_SAID[one.name]}') for one in commands)})",
        "    _describe command commands",
        "    return",
        "  fi",
        "  shift words",
        "  (( CURRENT-- ))",
        '  case "$words[1]" in',
    ]
    for command in commands:
        specs = [spec for option in command.options for spec in _zsh_option(option)]
        specs += [_zsh_place(k, place) for k, place in enumerate(command.places, start=1)]
        lines.append(f"    {command.name}) _arguments {' '.join(map(shlex.quote, specs))};;")
    return "\n".join(
        [
            *lines,
            "  esac",
            "}",
            'if [ "$funcstack[1]" = _lumpwatch ]; then _lumpwatch "$@"; else',
            "  compdef _lumpwatch lumpwatch",
            "fi",
            "",
        ]
    )


def _zsh_option(option: Option) -> list[str]:
    text = _zsh_text(option.help)
    return [f"{name}[{text}]{_zsh_value(option.value)}" for name in option.names]


def _zsh_place(number: int, place: Value) -> str:
    return f"{'*' if place.many else number}{_zsh_value(place)}"


def _zsh_value(value: Value | None) -> str:
    if value is None:
        return ""
    action = f"({' '.join(value.choices)})" if value.choices else "_files" if value.file else " "
    return f":{_zsh_text(value.name)}:{action}"


def _zsh_text(text: str) -> str:
    for sign in "\\[]:":
        text = text.replace(sign, f"\\{sign}")
    return text


def fish(commands: Sequence[Grammar]) -> str:
    """For fish 3 and later."""
    lines = [
        "# fish completion of lumpwatch; written by: lumpwatch completion fish",
        "function __lumpwatch_at",
        "    set -l given (commandline -opc)",
        '    test (count $given) -ge 2; and test "$given[2]" = "$argv[1]"',
        "end",
        "function __lumpwatch_first",
        "    test (count (commandline -opc)) -eq 1",
        "end",
        "complete -c lumpwatch -f",
        *(f"complete -c lumpwatch -n __lumpwatch_first -l {name.removeprefix('--')}" for name in _TOP),
    ]
    for command in commands:
        said = _fish_text(_SAID[command.name])
        lines.append(f"complete -c lumpwatch -n __lumpwatch_first -a {command.name} -d {said}")
        at = f"complete -c lumpwatch -n '__lumpwatch_at {command.name}'"
        lines += [
            f"{at} {_fish_names(option)}{_fish_value(option.value)} -d {_fish_text(option.help)}"
            for option in command.options
        ]
        files, places = files_or_words(command.places)
        if places:
            lines.append(f"{at} -a {_fish_text(' '.join(places))}")
        if files:
            lines.append(f"{at} -F")
    return "\n".join([*lines, ""])


def _fish_names(option: Option) -> str:
    return " ".join(
        f"-l {name.removeprefix('--')}" if name.startswith("--") else f"-s {name.removeprefix('-')}"
        for name in option.names
    )


def _fish_value(value: Value | None) -> str:
    if value is None:
        return ""
    if value.choices:
        return f" -x -a {_fish_text(' '.join(value.choices))}"
    return " -r -F" if value.file else " -x"


def _fish_text(text: str) -> str:
    """Quoted for fish, which knows two escapes between single quotes."""
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


SHELLS: dict[str, Callable[[Sequence[Grammar]], str]] = {"bash": bash, "zsh": zsh, "fish": fish}
"""By name of the shell."""
