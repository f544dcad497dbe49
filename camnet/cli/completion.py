"""``camnet completion``: a script that completes commands, options and their values in a shell."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from camnet.cli.common import add_messages

__all__ = ["add_parser", "script"]

_DESCRIPTION = """Print a script that completes camnet's commands, options, choices and shipped worlds; other words are
completed as files.

  camnet completion bash    for ~/.bashrc: source <(camnet completion bash)
  camnet completion zsh     into a folder of $fpath, as _camnet
  camnet completion fish    into ~/.config/fish/completions/camnet.fish"""


@dataclass(frozen=True, slots=True)
class _Option:
    """An option: its long and short names, help on one line, whether it takes a value, and which ones."""

    names: tuple[str, ...]
    words: str
    takes_value: bool
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Command:
    """A command: its help on one line, options, and what its own words may be, besides files."""

    name: str
    words: str
    options: tuple[_Option, ...]
    values: tuple[str, ...]


def add_parser(commands: Any) -> None:  # noqa: ANN401 - argparse publishes no type for it
    """Register the command."""
    parser = commands.add_parser(
        "completion",
        help="completion of commands and options in bash, zsh, fish",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("shell", choices=tuple(_WRITERS), metavar="SHELL", help="bash, zsh or fish")
    add_messages(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from camnet.cli.main import build_parser

    print(script(args.shell, build_parser()), end="")
    return 0


def script(shell: str, program: argparse.ArgumentParser) -> str:
    """Return the script of a shell for a program with commands."""
    from camnet import worlds

    return _WRITERS[shell](_commands(program, tuple(worlds.names())))


def _commands(program: argparse.ArgumentParser, worlds: tuple[str, ...]) -> list[_Command]:
    (action,) = [a for a in program._actions if isinstance(a, argparse._SubParsersAction)]
    help_of = {choice.dest: choice.help or "" for choice in action._choices_actions}
    return [_command(name, help_of.get(name, ""), parser, worlds) for name, parser in action.choices.items()]


def _command(name: str, words: str, parser: argparse.ArgumentParser, worlds: tuple[str, ...]) -> _Command:
    options: list[_Option] = []
    values: list[str] = []
    for action in parser._actions:
        choices = tuple(map(str, action.choices or ()))
        if action.dest in ("config", "world") or (name == "worlds" and action.dest == "name"):
            choices = worlds
        if action.option_strings:
            text = " ".join((action.help or "").replace("%%", "%").split())
            options.append(_Option(tuple(action.option_strings), text, action.nargs != 0, choices))
        else:
            values += choices
    return _Command(name, " ".join(words.split()), tuple(options), tuple(values))


def _bash(commands: Sequence[_Command]) -> str:
    cases, of_options = [], []
    for c in commands:
        names = " ".join(n for o in c.options for n in o.names)
        cases.append(
            f"    {c.name}) options={shlex.quote(names)}; values={shlex.quote(' '.join(c.values))} ;;"
        )
        for o in c.options:
            if o.takes_value:
                patterns = "|".join(f'"{c.name} {n}"' for n in o.names)
                of_options.append(f"    {patterns}) values={shlex.quote(' '.join(o.values))}; of_option=1 ;;")
    return "\n".join(
        [
            "_camnet() {",
            "  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} command=${COMP_WORDS[1]}",
            "  local options= values= of_option=",
            '  if [ "$COMP_CWORD" -eq 1 ]; then',
            f'    COMPREPLY=($(compgen -W {shlex.quote(" ".join(c.name for c in commands))} -- "$word"))',
            "    return",
            "  fi",
            "  case $command in",
            *cases,
            "  esac",
            '  case "$command $before" in',
            *of_options,
            "  esac",
            '  if [ -z "$of_option" ] && [[ $word == -* ]]; then',
            '    COMPREPLY=($(compgen -W "$options" -- "$word"))',
            "  else",
            '    COMPREPLY=($(compgen -W "$values" -- "$word"))',
            '    [ -n "$of_option" ] && [ -n "$values" ] || COMPREPLY+=($(compgen -f -- "$word"))',
            "  fi",
            "}",
            "complete -o filenames -F _camnet camnet",
            "",
        ]
    )


def _zsh(commands: Sequence[_Command]) -> str:
    def text(words: str) -> str:
        for sign in ("\\", "[", "]", ":"):
            words = words.replace(sign, f"\\{sign}")
        return words

    def values(of: _Option | _Command) -> str:
        return f"({' '.join(of.values)})" if of.values else "_files"

    lines = ["#compdef camnet", "_camnet() {", "  local -a commands", "  commands=("]
    lines += [f"    {shlex.quote(f'{c.name}:{text(c.words)}')}" for c in commands]
    lines += ["  )", "  if (( CURRENT == 2 )); then _describe command commands; return; fi"]
    lines += ["  local command=$words[2]", "  shift words; (( CURRENT-- ))", "  case $command in"]
    for c in commands:
        lines.append(f"    {c.name}) _arguments \\")
        for o in c.options:
            for name in o.names:
                value = f":value:{values(o)}" if o.takes_value else ""
                lines.append(f"      {shlex.quote(f'*{name}[{text(o.words)}]{value}')} \\")
        own = (
            f'_alternative "names:name:({" ".join(c.values)})" "files:file:_files"' if c.values else "_files"
        )
        lines.append(f"      {shlex.quote(f'*:word:{{{own}}}' if c.values else '*:file:_files')} ;;")
    return "\n".join([*lines, "  esac", "}", '_camnet "$@"', ""])


def _fish(commands: Sequence[_Command]) -> str:
    lines = []
    for c in commands:
        lines.append(f"complete -c camnet -n __fish_use_subcommand -f -a {c.name} -d {_fish_text(c.words)}")
        here = f"complete -c camnet -n '__fish_seen_subcommand_from {c.name}'"
        if c.values:
            lines.append(f"{here} -a {_fish_text(' '.join(c.values))}")
        for o in c.options:
            names = " ".join(f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in o.names)
            value = (
                f" -x -a {_fish_text(' '.join(o.values))}" if o.values else (" -r" if o.takes_value else "")
            )
            lines.append(f"{here} {names}{value} -d {_fish_text(o.words)}")
    return "\n".join([*lines, ""])


def _fish_text(words: str) -> str:
    escaped = words.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


_WRITERS: dict[str, Callable[[Sequence[_Command]], str]] = {"bash": _bash, "zsh": _zsh, "fish": _fish}
