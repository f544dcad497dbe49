"""Options, markers and paths shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

# The workers of pytest-xdist share what they compile. This must be set before Numba is imported.
if "PYTEST_XDIST_WORKER" in os.environ:
    _cache = Path(__file__).resolve().parent.parent / ".pytest_cache" / "numba"
    os.environ.setdefault("NUMBA_CACHE_DIR", str(_cache))

import pytest
from hypothesis import settings

settings.register_profile("camnet", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("camnet")

ROOT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long reproductions too")


#: What needs the same large kernels runs in one worker, one after the other: what two need at the same moment is
#: compiled twice. The longest first; all else is handed out by the file.
_TOGETHER = {
    "batch": ("batch/", "training/"),
    "flight": ("cli/", "env/", "agents/", "simulation/", "control/"),
    "adate": ("adate/", "visual/", "kalman/", "planner/", "estimation/test_adate_filter.py"),
    "certificates": ("certification/", "experiments/", "sensing/"),
}


def _group(nodeid: str) -> str:
    """Name of what a test runs together with: a line of the table, else its file."""
    place = nodeid.removeprefix("tests/")
    named = (name for name, places in _TOGETHER.items() if place.startswith(places))
    return next(named, place.split("::")[0])


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object | None:
    """Hand out whole groups with ``--dist loadscope`` (the marks of ``loadgroup`` are lost on pytest 9.2)."""
    if config.getvalue("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return _group(nodeid)

    config.option.loadscopereorder = False  # in the order of collection
    return Groups(config, log)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    order = list(_TOGETHER)
    items.sort(key=lambda item: order.index(g) if (g := _group(item.nodeid)) in order else len(order))
    if config.getoption("--slow"):
        return
    skip = pytest.mark.skip(reason="long reproduction: run with --slow")
    for item in items:
        if "slow" in item.keywords:
            item.add_marker(skip)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded inputs beside the checkout; tests that need it are skipped without it."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no recorded inputs at {folder}")
    return folder


@pytest.fixture(scope="session")
def project_root() -> Path:
    return ROOT
