"""What a case is: files, a command, and the answers that are right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from random import Random

__all__ = ["Answer", "Case", "Command", "Generator", "Nature", "changed"]


class Nature(Enum):
    """What was done to a valid input."""

    BROKEN = "broken"  #: not even well-formed
    MEANING = "meaning"  #: well-formed, and wrong only in what it says
    HARMLESS = "harmless"  #: written differently, means the same


class Answer(Enum):
    """What a command may answer."""

    UNCHANGED = "unchanged"  #: exit 0, with the result of the unchanged input
    REFUSED = "refused"  #: exit 2, with a message
    FAILED = "failed"  #: exit 1, with a stated verdict or resource limit


@dataclass(frozen=True, slots=True)
class Command:
    """A command of the program on the files of the stage.

    Attributes
    ----------
    name : of this combination of command and input
    argv : words of the command line; the working directory holds the files
    files : names of the files that it needs; a name that ends in ``/`` is a folder
    result : file that holds its result; None: the JSON object on standard output
    """

    name: str
    argv: tuple[str, ...]
    files: tuple[str, ...]
    result: str | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """One input and the answers that are right.

    Attributes
    ----------
    kind, label : of input; of what was done to it
    nature : see `Nature`
    command : what is run
    files : content by name, in place of the stage's; None takes a file away
    extra : words added to the command line
    answers : every answer that is right
    mentions : words, at least one of which the message of a refusal must hold
    """

    kind: str
    label: str
    nature: Nature
    command: Command
    files: dict[str, bytes | None] = field(default_factory=dict)
    extra: tuple[str, ...] = ()
    answers: frozenset[Answer] = frozenset({Answer.REFUSED})
    mentions: tuple[str, ...] = ()


#: makes one case at random
Generator = Callable[[Random], Case]


def changed(
    kind: str, label: str, nature: Nature, command: Command, name: str, content: str | bytes, *mentions: str
) -> Case:
    """Return the case of one changed file with the answer that its nature asks for."""
    answer = Answer.UNCHANGED if nature is Nature.HARMLESS else Answer.REFUSED
    data = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
    return Case(kind, label, nature, command, {name: data}, (), frozenset({answer}), mentions)
