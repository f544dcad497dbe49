"""Code on disk is taken only while all that was compiled into it is as it was."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from camnet import cache_folder
from camnet.compiled import store

_MAIN = """
from camnet.compiled import cached_njit
import kernels_helper as helper
from kernels_helper import SCALE, inner

@cached_njit
def outer(pair, x):
    return SCALE * inner(x) + pair.a + helper.SHIFT
"""
_HELPER = '''
from typing import NamedTuple
from camnet.geometry.triples import size
from numba import njit

SCALE, SHIFT, POWER = 2.0, 0.0, 10.0


class Pair(NamedTuple):
    """Two numbers."""

    a: float
    b: float


@njit
def deep(x):
    """Deep."""
    return x * POWER * size(1.0, 0.0, 0.0)


@njit
def inner(x):
    return deep(x)


def make():
    return Pair(a=1.0, b=2.0)
'''


class Program:
    """Two files with a kernel, imported anew at every run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.main = _MAIN

    def run(self, helper: str) -> tuple[float, bool]:
        """Return what the kernel says, and whether its code came from the disk."""
        (self.folder / "kernels_main.py").write_text(self.main)
        (self.folder / "kernels_helper.py").write_text(helper)
        for name in ("kernels_main", "kernels_helper"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        main, now = (importlib.import_module(name) for name in ("kernels_main", "kernels_helper"))
        value = main.outer(now.make(), 3.0)
        return value, bool(main.outer.stats.cache_hits)

    def kept(self) -> list[Path]:
        """Files of the kernel's code."""
        return sorted(self.folder.glob("cache/kernels/kernels_main.outer-*.kernel"))


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Program]:
    """Program whose kernel has been compiled once: 2 * (10 * 3) + 1."""
    monkeypatch.setenv("CAMNET_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache_folder, "_chosen", None)
    monkeypatch.setattr(store, "_saving", True)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # files of the same second and size look the same
    monkeypatch.syspath_prepend(tmp_path)
    made = Program(tmp_path)
    assert made.run(_HELPER) == (61.0, False)
    assert made.run(_HELPER) == (61.0, True)
    assert len(made.kept()) == 1
    yield made
    for name in ("kernels_main", "kernels_helper"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("old", "new", "value"),
    [
        ("x * POWER", "x * POWER + 1.0", 63.0),  # a function two files away
        ("POWER = 2.0, 0.0, 10.0", "POWER = 2.0, 0.0, 20.0", 121.0),  # a constant that only that one reads
        ("SCALE, SHIFT, POWER = 2.0, 0.0", "SCALE, SHIFT, POWER = 2.0, 5.0", 66.0),  # read as helper.SHIFT
        ("    a: float\n    b: float", "    b: float\n    a: float", 61.0),  # same types, other places
        ("Pair", "Couple", 61.0),  # another class
    ],
)
def test_a_change_in_another_file_is_compiled(program: Program, old: str, new: str, value: float) -> None:
    assert old in _HELPER
    changed = _HELPER.replace(old, new)
    assert program.run(changed) == (value, False)
    assert program.run(changed) == (value, True)


def test_two_versions_share_a_folder(program: Program) -> None:
    changed = _HELPER.replace("x * POWER", "x * POWER + 1.0")
    assert program.run(changed) == (63.0, False)
    assert program.run(_HELPER) == (61.0, True)
    assert program.run(changed) == (63.0, True)


def test_options_of_the_compiler_count(program: Program) -> None:
    program.main = _MAIN.replace("@cached_njit", "@cached_njit(error_model='numpy')")
    assert program.run(_HELPER) == (61.0, False)
    assert program.run(_HELPER) == (61.0, True)


def test_what_is_not_compiled_does_not_count(program: Program) -> None:
    changed = _HELPER.replace('"""Deep."""', '"""Other words."""').replace("a=1.0", "a=0.5 + 0.5")
    assert program.run("# a comment\n" + changed) == (61.0, True)
    program.main = "# a comment\n" + _MAIN
    assert program.run(_HELPER) == (61.0, True)


@pytest.mark.parametrize("damage", ["short", "empty", "changed"])
def test_a_damaged_file_counts_as_absent(program: Program, damage: str) -> None:
    (path,) = program.kept()
    content = path.read_bytes()
    middle = len(content) // 2
    path.write_bytes(
        {
            "short": content[:-20],
            "empty": b"",
            "changed": content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :],
        }[damage]
    )
    assert program.run(_HELPER) == (61.0, False)
    assert program.kept() == [path]
    assert program.run(_HELPER) == (61.0, True)


def test_a_class_that_is_gone_counts_as_absent(program: Program) -> None:
    (path,) = program.kept()
    program.run(_HELPER.replace("Pair", "Couple"))
    (other,) = set(program.kept()) - {path}
    path.write_bytes(other.read_bytes())  # whole, but of a class that the next program does not have
    assert program.run(_HELPER) == (61.0, False)
    assert program.run(_HELPER) == (61.0, True)
