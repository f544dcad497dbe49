"""Options, markers and paths shared by all tests."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("camnet", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("camnet")

# started in the background (nohup, a shell without job control) the tests would ignore Ctrl-C, and so would every
# program that they start; several of them send it
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long reproductions too")


#: What needs the same large kernels runs in one worker, in the order of the row: what two workers need at the same
#: moment is compiled twice, so the estimators in rows come early in one and late in the other. The longest row first.
_TOGETHER = {
    "batch": ("batch/test_batch_estimator", "batch/", "training/"),
    "flight": ("robustness/", "cli/test_simulate", "control/", "simulation/", "cli/", "agents/", "env/"),
    "adate": ("adate/", "visual/", "kalman/", "planner/", "estimation/test_adate_filter.py"),
    "structure": ("structure/", "experiments/test_distance_observers"),
    "certificates": ("certification/", "experiments/", "sensing/"),
}


def _place(nodeid: str) -> tuple[str, int]:
    """What a test runs together with (a row of the table, else its file), and where in the row it is."""
    path = nodeid.removeprefix("tests/").split("::")[0]
    for name, row in _TOGETHER.items():
        for k, start in enumerate(row):
            if path.startswith(start):
                return name, k
    return path, 0


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object | None:
    """Hand out whole groups with ``--dist loadscope`` (the marks of ``loadgroup`` are lost on pytest 9.2)."""
    if config.getvalue("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return _place(nodeid)[0]

    config.option.loadscopereorder = False  # in the order of collection
    return Groups(config, log)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    rank = {name: k for k, name in enumerate(_TOGETHER)}
    items.sort(key=lambda item: (rank.get((at := _place(item.nodeid))[0], len(rank)), at[1]))
    if config.getoption("--slow"):
        return
    skip = pytest.mark.skip(reason="long reproduction: run with --slow")
    for item in items:
        if "slow" in item.keywords:
            item.add_marker(skip)


#: reasons of skips for a package that is missing: those of `pytest.importorskip`, and ours
_MISSING = re.compile("could not import|No module named|is not installed")
#: a folder of peers that no extra installs together
_PEERS = ROOT / "tests" / "ecosystem"


def _fail_if_a_package_is_missing(report: pytest.TestReport | pytest.CollectReport, path: Path) -> None:
    """Where CI is set the extra ``test`` has all that tests need: what they skip for is a fault of the extra."""
    if not report.skipped or os.environ.get("CI", "false").lower() in ("", "0", "false"):
        return
    reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
    if _MISSING.search(reason) and not path.is_relative_to(_PEERS):
        report.outcome = "failed"
        report.longrepr = f"{path}: {reason}: a package that the tests need belongs to the extra 'test'"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    _fail_if_a_package_is_missing(report, item.path)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    _fail_if_a_package_is_missing(report, collector.path)
    return report


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


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """Name of an X display: the present one, or a virtual one."""
    if importlib.util.find_spec("_tkinter") is None:  # built with Python or not, on no package index
        pytest.skip("Python was built without a window toolkit: Debian has it in python3-tk")
    if os.environ.get("DISPLAY"):
        yield os.environ["DISPLAY"]
        return
    program = shutil.which("Xvfb")
    if program is None:
        pytest.skip("no display, and no virtual one: Debian has it in xvfb")
    read, write = os.pipe()
    command = [program, "-displayfd", str(write), "-screen", "0", "1024x768x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=(write,), stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as numbers:
            number = numbers.readline().strip()
        if not number:
            pytest.skip("Xvfb does not start here")
        os.environ["DISPLAY"] = f":{number}"
        yield os.environ["DISPLAY"]
    finally:
        os.environ.pop("DISPLAY", None)
        server.terminate()
        server.wait()
