"""The parser of all commands: no abbreviations, one-line errors, suggestions for what was mistyped."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

__all__ = ["Parser", "suggestion"]

#: a value such as -85.5,39 or -3: argparse takes only plain negative numbers for values
_MINUS_VALUE = re.compile(r"-[0-9.]")


def suggestion(given: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Return ``did you mean 'x'?`` for the closest known name, else the list of them."""
    names = list(known)
    lower = {name.lower(): name for name in names}
    close = difflib.get_close_matches(given.lower(), lower, 1, cutoff)
    return f"did you mean {lower[close[0]]!r}?" if close else f"known are {', '.join(names)}"


class Parser(argparse.ArgumentParser):
    """An argument parser that ends with status 2 and one line: what is wrong, and what would be right."""

    def __init__(self, *args: Any, **options: Any) -> None:  # noqa: ANN401 - those of argparse
        options.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        options.setdefault("allow_abbrev", False)
        super().__init__(*args, **options)

    def parse_known_args(  # type: ignore[override] # argparse overloads it for namespaces of one's own
        self,
        args: Sequence[str] | None = None,
        namespace: Any = None,  # noqa: ANN401
    ) -> tuple[Any, list[str]]:
        """Parse; what is not known is an error here, where its own command can advise."""
        words = self._prepared(list(sys.argv[1:] if args is None else args))
        known, rest = super().parse_known_args(words, namespace)
        if rest:
            self.error(f"{rest[0]!r}: one argument too many")
        return known, rest

    def error(self, message: str) -> NoReturn:
        """Print one line and end with status 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:  # noqa: ANN401 - as argparse has it
        if action.choices is not None and value not in action.choices:
            name = action.metavar or "/".join(action.option_strings) or action.dest
            raise argparse.ArgumentError(
                None, f"{name} {value!r}: unknown; {suggestion(str(value), map(str, action.choices))}"
            )

    def _prepared(self, words: list[str]) -> list[str]:
        """Return the words with values that start with a minus joined to their options.

        Ends with an error at an option that does not exist: argparse would name what is missing because of it instead.
        """
        options = self._option_string_actions
        has_commands = any(isinstance(action, argparse._SubParsersAction) for action in self._actions)
        result: list[str] = []
        for k, word in enumerate(words):
            if word == "--" or (has_commands and not word.startswith("-")):
                return result + words[k:]
            before = options.get(words[k - 1]) if k else None
            takes_value = before is not None and before.nargs is None
            if takes_value and _MINUS_VALUE.match(word):
                result[-1] = f"{result[-1]}={word}"
                continue
            if word.startswith("--") and " " not in word.partition("=")[0]:
                self._check_option(word.partition("=")[0], has_commands)
            result.append(word)
        return result

    def _check_option(self, name: str, has_commands: bool) -> None:
        options = self._option_string_actions
        if name in options:
            return
        if has_commands and any(name in p._option_string_actions for p in self._commands()):
            self.error(f"{name}: options come after the command, as in camnet simulate quickstart {name}")
        known = [option for option in options if option.startswith("--")]
        self.error(f"{name}: no such option; {suggestion(name, known)}")

    def _commands(self) -> list[Parser]:
        actions = [a for a in self._actions if isinstance(a, argparse._SubParsersAction)]
        return [parser for action in actions for parser in action.choices.values()]
