"""Options, markers and paths shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

# Two processes that compile one kernel at the same time can leave a cache that Numba then misreads ("descr is NULL"):
# each worker of pytest-xdist keeps a cache of its own. This must be set before Numba is imported.
if _worker := os.environ.get("PYTEST_XDIST_WORKER"):
    _cache = Path(__file__).resolve().parent.parent / ".pytest_cache" / f"numba-{_worker}"
    os.environ.setdefault("NUMBA_CACHE_DIR", str(_cache))

import pytest
from hypothesis import settings

settings.register_profile("camnet", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("camnet")

ROOT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long reproductions too")


#: what compiles the same large kernels runs in one worker, since each worker compiles for itself
_TOGETHER = {
    "batch": ("batch/", "training/"),
    "adate": ("adate/", "visual/", "estimation/test_adate_filter.py"),
}


def _keep_together(items: list[pytest.Item]) -> None:
    for item in items:
        place = item.path.relative_to(ROOT / "tests").as_posix()
        for name, places in _TOGETHER.items():
            if place.startswith(places):
                item.add_marker(pytest.mark.xdist_group(name))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    _keep_together(items)
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
