"""What happened when a case ran."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Outcome"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Exit status (negative: ended by that signal), texts, times and files.

    Attributes
    ----------
    status : exit status
    stdout, stderr : texts
    wall_s, cpu_s : time that it took
    peak_bytes : largest memory in use
    before, after : digest of every file and folder of the working directory, by name
    result : content of the command's result file, if it has one
    """

    status: int
    stdout: str
    stderr: str
    wall_s: float
    cpu_s: float
    peak_bytes: int
    before: dict[str, str]
    after: dict[str, str]
    result: str | None = None
