"""Workers give results in any order, and end with whatever ends them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from camnet.errors import ConfigError, WorkerError
from camnet.processes import Workers
from camnet.processes.tied import tied_command

sys.path.insert(0, str(Path(__file__).parent))  # the workers look for their functions here, too
import pool_programs as programs

posix = pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and is not waited for does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{pid}/stat")
    return not (state.is_file() and state.read_text().rpartition(")")[2].split()[0] == "Z")


def until(condition: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return condition()


@pytest.mark.parametrize("jobs", [1, 3])
def test_every_task_is_done_once(jobs: int) -> None:
    with Workers(jobs) as workers:
        found = dict(workers.finished(programs.square, range(7)))
    assert found == {k: k * k for k in range(7)}
    with Workers(jobs) as workers:
        assert dict(workers.finished(programs.square, [])) == {}
        assert dict(workers.finished(programs.square, [5])) == {0: 25}


def test_workers_are_other_processes_with_the_same_caches() -> None:
    from camnet.cache_folder import cache_folders

    with Workers(2) as workers:
        results = [result for _, result in workers.finished(programs.who, range(6))]
    assert sorted(task for task, _, _ in results) == list(range(6))
    pids = {pid for _, pid, _ in results}
    assert os.getpid() not in pids
    assert len(pids) == 2
    assert {cache for _, _, cache in results} == {str(cache_folders().write)}
    assert until(lambda: not any(alive(pid) for pid in pids), 1.0)


def test_the_first_error_ends_everything() -> None:
    start = time.monotonic()
    with pytest.raises(ConfigError, match="x = 1: give another"), Workers(2) as workers:
        list(workers.finished(programs.refuse, range(20)))
    assert time.monotonic() - start < 30.0  # the others would sleep for ten minutes


@posix
def test_a_worker_that_is_killed_is_an_error_that_says_so() -> None:
    with pytest.raises(WorkerError, match=r"ended by SIGKILL with 0 of 4 tasks done"), Workers(2) as workers:
        list(workers.finished(programs.vanish, range(4)))


@posix
@pytest.mark.parametrize("function", [programs.linger, programs.deaf])
def test_leaving_the_block_ends_the_workers(tmp_path: Path, function: Callable[[Path], None]) -> None:
    def stop() -> None:
        with Workers(2) as workers:
            results = workers.finished(function, [tmp_path] * 8)
            # a signal to this process while it waits, as Ctrl-C would be
            waiter = subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    f"import os, signal, time, pathlib\n"
                    f"while len(list(pathlib.Path({str(tmp_path)!r}).iterdir())) < 2: time.sleep(0.05)\n"
                    f"os.kill({os.getpid()}, signal.SIGINT)",
                ]
            )
            try:
                next(results)
            finally:
                waiter.wait()

    with pytest.raises(KeyboardInterrupt):
        stop()
    left = [int(path.name) for path in tmp_path.iterdir()]
    if function is programs.linger:
        assert left == []  # the work was unwound
    else:
        assert len(left) == 2  # killed
        assert until(lambda: not any(alive(pid) for pid in left), 1.0)


_PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, {here!r})
from camnet.processes import TerminatedError, Workers, stop_on_signals, tied
import pool_programs

if __name__ == "__main__":
    try:
        with stop_on_signals(), Workers(2) as workers:
            list(workers.finished(pool_programs.linger, [Path({folder!r})] * 8))
    except (TerminatedError, KeyboardInterrupt) as error:
        print(repr(error), flush=True)
        sys.exit(1)
"""


def _start(tmp_path: Path) -> tuple[subprocess.Popen[str], list[int], Path]:
    """Start a program with two workers; returns it, the workers and the folder of their marks."""
    folder = tmp_path / "marks"
    folder.mkdir()
    program = tmp_path / "program.py"
    program.write_text(_PROGRAM.format(here=str(Path(__file__).parent), folder=str(folder)))
    process = subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert until(lambda: len(list(folder.iterdir())) == 2, 60.0)
    return process, [int(path.name) for path in folder.iterdir()], folder


@posix
def test_workers_die_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    process, workers, _ = _start(tmp_path)
    process.kill()
    process.wait()
    assert until(lambda: not any(alive(pid) for pid in workers), 5.0)


@posix
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("group", [False, True], ids=["process", "group"])
def test_a_signal_ends_all(tmp_path: Path, number: signal.Signals, group: bool) -> None:
    process, workers, folder = _start(tmp_path)
    if group:
        os.killpg(process.pid, number)
    else:
        os.kill(process.pid, number)
    said, _ = process.communicate(timeout=20.0)
    assert process.returncode == 1
    assert said.strip() == (
        "KeyboardInterrupt()" if number == signal.SIGINT else f"TerminatedError({int(number)})"
    )
    assert until(lambda: not any(alive(pid) for pid in workers), 1.0)
    assert list(folder.iterdir()) == []  # the work was unwound


_ORPHAN = """
import multiprocessing, os, signal, sys, time
from pathlib import Path
from camnet.processes import tied

def work(parent, mark):
    tied.set_death_signal = lambda: None  # as on a system without it
    tied.die_with_parent(parent)
    Path(mark).write_text(str(os.getpid()))
    time.sleep(60.0)

if __name__ == "__main__":
    multiprocessing.get_context("spawn").Process(target=work, args=(os.getpid(), sys.argv[1])).start()
    while not Path(sys.argv[1]).is_file():
        time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@posix
def test_a_worker_notices_by_itself_that_its_parent_is_gone(tmp_path: Path) -> None:
    program, mark = tmp_path / "orphan.py", tmp_path / "mark"
    program.write_text(_ORPHAN)
    subprocess.run([sys.executable, str(program), str(mark)], check=False)
    assert until(lambda: not alive(int(mark.read_text())), 5.0)


_DEAF = """
import hashlib
from camnet.processes import stop_on_signals
with stop_on_signals():
    print("ready", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**8)  # no instruction of Python's meanwhile, as in a long compilation
"""


@posix
def test_a_program_inside_compiled_code_is_ended(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _DEAF], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.3)
    process.send_signal(signal.SIGTERM)
    time.sleep(0.1)
    said = process.communicate(timeout=20.0)[1]
    assert process.returncode == 1
    assert said == "camnet: ended by SIGTERM inside compiled code\n"


_STARTS = """
import subprocess, sys
from camnet.processes.tied import tied_command
command = [sys.executable, "-c", "import os, time; print(os.getpid(), flush=True); time.sleep(60.0)"]
subprocess.run(tied_command(command), check=False)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the signal at a parent's death is Linux's")
def test_another_program_dies_with_the_one_that_started_it() -> None:
    process = subprocess.Popen([sys.executable, "-c", _STARTS], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    started = int(process.stdout.readline())
    assert alive(started)
    process.kill()
    process.wait()
    assert until(lambda: not alive(started), 5.0)


def test_a_tied_program_gets_its_arguments_and_gives_its_status() -> None:
    program = "import sys; print(sys.argv[1:]); sys.exit(7)"
    done = subprocess.run(
        tied_command([sys.executable, "-c", program, "a b", "--c"]),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (7, "['a b', '--c']\n")
