"""Makes the table of malformed inputs available to the tests."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


def _table() -> ModuleType:
    name = "malformed_cases"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("malformed_cases.py"))
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for ``malformed`` once for every case of the table."""
    if "malformed" in metafunc.fixturenames:
        cases = _table().CASES
        metafunc.parametrize("malformed", cases, ids=[case.id for case in cases])


@pytest.fixture(scope="session")
def valid_inputs() -> ModuleType:
    """The table's module, for its valid base files."""
    return _table()
