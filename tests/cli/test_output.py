"""Output folders: made at the start, whole or absent, locked, and never at the cost of somebody's files."""

from __future__ import annotations

import argparse
import errno
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from camnet.cli.output import output_folder, resumed_folder
from camnet.errors import ConfigError, OutputError
from camnet.storage.lock import FolderBusyError, folder_lock
from camnet.storage.marker import MARKER, read_marker, write_marker
from camnet.storage.names import short_name, temporary_name
from camnet.storage.whole_file import check_writable, sweep_files, whole_file, write_json


def wish(out: Path | str | None, force: bool = False) -> argparse.Namespace:
    return argparse.Namespace(out=None if out is None else str(out), force=force)


def write(
    out: Path,
    force: bool = False,
    words: str = "new",
    stands: bool = False,
    then: Callable[[], object] = lambda: None,
) -> None:
    """Write a folder as a command does, and do something with it open."""
    with output_folder(wish(out, force), "simulate") as output:
        assert output is not None
        (output.path / "result.txt").write_text(words)
        if stands:
            output.results_stand()
        then()


def fail(error: BaseException) -> Callable[[], object]:
    def then() -> None:
        raise error

    return then


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_folder_is_whole_marked_and_alone(tmp_path: Path) -> None:
    write(tmp_path / "run")
    assert names(tmp_path) == {"run"}
    assert names(tmp_path / "run") == {"result.txt", MARKER}
    marker = read_marker(tmp_path / "run")
    assert marker is not None
    assert (marker.kind, marker.files) == ("simulate", ("result.txt",))


def test_the_temporary_folder_is_there_before_anything_is_computed(tmp_path: Path) -> None:
    with output_folder(wish(tmp_path / "run"), "simulate") as output:
        assert output is not None
        assert output.path.parent == tmp_path
        assert str(os.getpid()) in output.path.name
        assert not (tmp_path / "run").exists()


def test_without_out_and_name_there_is_no_folder() -> None:
    with output_folder(wish(None), "bench") as output:
        assert output is None


def test_default_names_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for expected in ("x", "x-2", "x-3"):
        with output_folder(wish(None), "simulate", "x") as output:
            assert output is not None
            (output.path / "result.txt").write_text("")
        assert output.folder == tmp_path / "runs" / expected
    assert names(tmp_path / "runs") == {"x", "x-2", "x-3"}


def test_a_default_name_that_is_being_written_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with (
        output_folder(wish(None), "simulate", "x") as first,
        output_folder(wish(None), "simulate", "x") as second,
    ):
        assert first is not None
        assert second is not None
        assert (first.folder.name, second.folder.name) == ("x", "x-2")


def test_force_replaces_what_camnet_wrote(tmp_path: Path) -> None:
    write(tmp_path / "run", words="old")
    with pytest.raises(ConfigError, match="not empty"):
        write(tmp_path / "run")
    write(tmp_path / "run", force=True)
    assert (tmp_path / "run" / "result.txt").read_text() == "new"
    assert names(tmp_path) == {"run"}


def test_force_spares_what_camnet_did_not_write(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "thesis.tex").write_text("mine")
    with pytest.raises(ConfigError, match="did not write"):
        write(folder, force=True)
    (folder / "thesis.tex").unlink()
    write(folder)
    (folder / "deep").mkdir()
    (folder / "deep" / "thesis.tex").write_text("mine")
    with pytest.raises(ConfigError, match=r"deep/thesis\.tex"):
        write(folder, force=True)
    assert (folder / "deep" / "thesis.tex").read_text() == "mine"
    assert names(tmp_path) == {"run"}


def test_somebodys_files_that_come_during_the_run_are_spared(tmp_path: Path) -> None:
    def somebody_writes() -> None:
        (tmp_path / "run").mkdir()
        (tmp_path / "run" / "mine.txt").write_text("mine")

    with pytest.raises(OutputError, match="failed-"):
        write(tmp_path / "run", then=somebody_writes)
    assert names(tmp_path / "run") == {"mine.txt"}
    (kept,) = tmp_path.glob("run.failed-*")
    assert (kept / "result.txt").read_text() == "new"


@pytest.mark.parametrize("out", [".", "", "/", "..", "../..", "~home"])
@pytest.mark.parametrize("force", [False, True])
def test_places_that_hold_the_run_itself_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, out: str, force: bool
) -> None:
    home, here = tmp_path / "home", tmp_path / "a" / "b"
    home.mkdir()
    here.mkdir(parents=True)
    write_marker(home, "simulate", ())
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(here)
    with (
        pytest.raises(ConfigError, match="give a folder of its own"),
        output_folder(wish(str(home) if out == "~home" else out, force), "simulate"),
    ):
        pass


def test_links_and_files_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "real")
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "nowhere").symlink_to("gone")
    (tmp_path / "file").write_text("mine")
    for out in ("link", "nowhere"):
        with pytest.raises(ConfigError, match="is a link to"):
            write(tmp_path / out, force=True)
    for out in ("file", "file/run"):
        with pytest.raises(ConfigError, match="is a file"):
            write(tmp_path / out, force=True)
    assert (tmp_path / "real" / "result.txt").exists()
    assert (tmp_path / "file").read_text() == "mine"


def test_a_second_run_on_one_folder_is_refused_at_the_start(tmp_path: Path) -> None:
    with output_folder(wish(tmp_path / "run"), "simulate") as output:
        assert output is not None
        with pytest.raises(FolderBusyError, match="another run"):
            write(tmp_path / "run")
        with (
            pytest.raises(FolderBusyError, match="another run"),
            resumed_folder(tmp_path / "run", "evaluate", (), False),
        ):
            pass
        write(tmp_path / "other")  # its sweep leaves us alone
        (output.path / "result.txt").write_text("first")
    assert (tmp_path / "run" / "result.txt").read_text() == "first"


_HOLDER = """
import argparse, sys, time
from camnet.cli.output import output_folder
with output_folder(argparse.Namespace(out=sys.argv[1], force=False), "simulate") as output:
    (output.path / "result.txt").write_text("half")
    print("ready", flush=True)
    time.sleep(60)
"""


def test_a_killed_run_blocks_nobody_and_its_leftovers_go(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _HOLDER, str(tmp_path / "run")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        with pytest.raises(FolderBusyError):
            write(tmp_path / "run")
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    assert len(names(tmp_path)) == 2  # the partial folder and the lock file
    write(tmp_path / "other")
    assert names(tmp_path) == {"other"}


def test_what_was_moved_aside_comes_back_after_a_kill_between_the_renames(tmp_path: Path) -> None:
    write(tmp_path / "run", words="old")
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True
    )
    aside = temporary_name("run", "replaced").replace(str(os.getpid()), gone.stdout.decode().strip())
    (tmp_path / "run").rename(tmp_path / aside)
    write(tmp_path / "other")
    assert names(tmp_path) == {"run", "other"}
    assert (tmp_path / "run" / "result.txt").read_text() == "old"


def test_folders_that_only_look_like_leftovers_stay(tmp_path: Path) -> None:
    mine = tmp_path / temporary_name("run").replace(str(os.getpid()), "999999999")
    mine.mkdir()
    (mine / "mine.txt").write_text("mine")
    write(tmp_path / "run")
    assert (mine / "mine.txt").exists()


def test_a_failed_write_keeps_what_was_written_and_says_where(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "log.parquet")
    with pytest.raises(OutputError, match="the disk is full") as caught:
        write(tmp_path / "run", then=fail(full))
    (kept,) = tmp_path.iterdir()
    assert str(kept) in str(caught.value)
    assert (kept / "result.txt").read_text() == "new"
    write(tmp_path / "other")
    assert kept.exists()  # nothing sweeps it


def test_wrong_input_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="wrong"):
        write(tmp_path / "new" / "run", then=fail(ConfigError("wrong")))
    assert names(tmp_path) == set()


@pytest.mark.parametrize("failure", [ValueError("no"), OSError(errno.ENOSPC, "full"), KeyboardInterrupt()])
def test_results_that_stand_survive_what_fails_after_them(tmp_path: Path, failure: BaseException) -> None:
    with pytest.raises((OutputError, KeyboardInterrupt)):
        write(tmp_path / "run", stands=True, then=fail(failure))
    assert names(tmp_path) == {"run"}
    assert (tmp_path / "run" / "result.txt").read_text() == "new"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_shows_at_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, *_: object, **__: object) -> int:
        with Path("/dev/full").open("wb", buffering=0) as stream:
            return stream.write(b"x")

    monkeypatch.setattr(Path, "write_text", full)
    with (
        pytest.raises(OutputError, match="the disk is full"),
        output_folder(wish(tmp_path / "run"), "simulate"),
    ):
        pytest.fail("nothing may be computed")
    assert names(tmp_path) == set()


def test_long_names(tmp_path: Path) -> None:
    write(tmp_path / ("n" * 255))
    write(tmp_path / ("ü" * 127), force=True)
    assert {len(name) for name in names(tmp_path)} == {255, 127}
    with pytest.raises(OutputError, match="the name is too long"):
        write(tmp_path / ("n" * 256))
    assert short_name("a" * 200 + ".mp4").endswith(".mp4")


def test_resumed_folders_keep_their_kind_and_content(tmp_path: Path) -> None:
    folder = tmp_path / "scores"
    with resumed_folder(folder, "evaluate", ("*.txt",), False) as inside:
        (inside / "one.txt").write_text("1")
        (inside / temporary_name("two.txt")).write_text("half")
    with resumed_folder(folder, "evaluate", ("*.txt",), False) as inside:
        assert names(inside) == {MARKER, "one.txt"}
        with pytest.raises(FolderBusyError), resumed_folder(folder, "evaluate", ("*.txt",), False):
            pass
    (folder / "one.txt").rename(tmp_path / "one.txt")  # the marker alone
    with (
        pytest.raises(ConfigError, match="camnet evaluate wrote"),
        resumed_folder(folder, "train", (), False),
    ):
        pass
    (tmp_path / "one.txt").rename(folder / "one.txt")
    with resumed_folder(folder, "evaluate", ("*.txt",), True) as inside:
        assert names(inside) == {MARKER}
    assert names(tmp_path) == set()  # nothing was written


def test_resumed_folders_are_not_made_of_others(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    for anew in (False, True):
        with (
            pytest.raises(ConfigError, match="did not write it"),
            resumed_folder(tmp_path, "evaluate", ("*.txt",), anew),
        ):
            pass
    assert names(tmp_path) == {"mine.txt"}
    (tmp_path / "run").mkdir()
    write_marker(tmp_path / "run", "evaluate", ("*.json",))
    (tmp_path / "run" / "mine.txt").write_text("mine")
    with (
        pytest.raises(ConfigError, match=r"mine\.txt"),
        resumed_folder(tmp_path / "run", "evaluate", ("*.json",), True),
    ):
        pass


def test_whole_files_are_whole_or_absent(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"x": 1})
    with pytest.raises(TypeError):
        write_json(tmp_path / "a.json", {"x": object()})
    with pytest.raises(FileNotFoundError), whole_file(tmp_path / "b.json"):
        pass  # nothing was written
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": 1}
    assert names(tmp_path) == {"a.json"}
    left = tmp_path / temporary_name("b.json").replace(str(os.getpid()), "999999999")
    left.write_text("half")
    (tmp_path / temporary_name("c.json")).write_text("ours, being written")
    sweep_files(tmp_path)
    assert names(tmp_path) == {"a.json", temporary_name("c.json")}


def test_check_writable_touches_nothing(tmp_path: Path) -> None:
    (tmp_path / "model.npz").write_text("old")
    check_writable(tmp_path / "model.npz")
    check_writable(tmp_path / "new.npz")
    assert names(tmp_path) == {"model.npz"}
    assert (tmp_path / "model.npz").read_text() == "old"
    with pytest.raises(OSError):
        check_writable(tmp_path / ("n" * 300))


def test_locks_are_let_go_also_on_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no"), folder_lock(tmp_path / "run"):
        raise ValueError("no")
    with folder_lock(tmp_path / "run"):
        pass
    assert names(tmp_path) == set()
