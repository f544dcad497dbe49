"""Build the wheel, install it in a clean environment in another folder, and run every command from there.

The commands are those of the program's own parser: one without a run here is a failure. Each run has to end with the
status that is stated for it, and what prints ``--json`` has to print one JSON object and nothing else. Neither the
checkout nor kernels that were compiled before are used.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import _environment

_LIST_COMMANDS = """
import argparse, json, camnet
from camnet.cli.main import build_parser
choices = next(a.choices for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
with_json = {name: "--json" in parser._option_string_actions for name, parser in choices.items()}
print(json.dumps({"commands": with_json, "package": camnet.__file__}))
"""
#: six photographs of a checkerboard, drawn
_DRAW_BOARD = """
import cv2, numpy as np
from pathlib import Path
from camnet.geometry.pinhole import Pinhole
from camnet.geometry.rotations import exp
from camnet.geometry.settings import Intrinsics
from camnet.sensing.textured_planes import TexturedPlane, checkerboard, draw_planes
lens = Pinhole.from_settings(Intrinsics(width_px=320, height_px=240, fx_px=280, fy_px=280, cx_px=159.5, cy_px=119.5))
corner, across, down = np.array([-0.3, -0.225, 0]), np.array([0.6, 0, 0]), np.array([0, 0.45, 0])
board = TexturedPlane(corner, across, down, checkerboard(10, 7, 20, 20))
Path("board").mkdir()
for k in range(6):
    x, y = 0.35 * np.cos(0.15 + 0.9 * k), 0.35 * np.sin(0.15 + 0.9 * k)
    picture = draw_planes([board], lens, np.array([x, y, -0.75]), exp(np.array([1.2 * y, -1.2 * x, 0])))
    cv2.imwrite(f"board/{k}.png", picture.astype(np.uint8))
"""
#: two people who cross, one of whom stands for a while
_PEOPLE = ["id,t,x,y"]
_PEOPLE += [f"a,{t},{min(t, 40) + max(t - 70, 0)},0" for t in range(0, 111, 10)]
_PEOPLE += [f"b,{t},40,{t - 40}" for t in range(0, 81, 10)]
#: a target that two stations see
_SEEN = [
    "t,observer,x,y,sd",
    *(f"{t},{name},{1.2 * t + 0.3 * (t % 3)},{t % 2},1" for t in range(30) for name in "ab"),
]
#: status of bad input, which prints no JSON
_REFUSED = 2
_TRAIN_LITTLE = [
    f"--set={setting}"
    for setting in (
        "environments=2", "max_cycles=60", "imitation_steps=400", "imitation_epochs=2", "rollout_steps=32",
        "chunk_steps=256", "minibatch=64", "hidden=[8]", "estimator=ekf",
    )
]  # fmt: skip


@dataclass(frozen=True)
class Smoke:
    """One run of a command: its words, its status, and files that it leaves."""

    words: str
    status: int = 0
    leaves: tuple[str, ...] = ()


#: two rows of runs, side by side; in a row a run may use what an earlier one left
_ROWS = (
    (
        Smoke("simulate quickstart --duration 4 --out run", leaves=("run/report.html", "run/video.mp4")),
        Smoke("report run --no-video"),
        Smoke("log run --describe"),
        Smoke("track-video run/video.mp4 --box 100,100,60,60 --out tracked", leaves=("tracked/boxes.csv",)),
        Smoke("track seen.csv --out track", leaves=("track/track.csv", "track/report.html")),
        Smoke("identify none.yaml", status=2),  # recordings of people are not for a smoke test
        Smoke("futures none.yaml", status=2),
        Smoke("structure board --board 9x6 --out path", leaves=("path/points.ply", "path/structure.mp4")),
        Smoke("certify quickstart --out certified", status=1, leaves=("certified/report.html",)),  # nothing is promised
        Smoke("coverage stationary_certified --origin 50,8,0 --out covered", leaves=("covered/coverage.geojson",)),
        Smoke("falsify patrol --trials 20 --out falsified"),
        Smoke("reproduce adate-navigation --seeds 1 --out reproduced"),
        Smoke("warm-up certify"),
        Smoke("worlds"),
        Smoke("completion bash"),
    ),
    (
        Smoke(f"train --steps 512 {' '.join(_TRAIN_LITTLE)} --out trained", leaves=("trained/policy.npz",)),
        Smoke("evaluate --world quickstart --agents static,trained/policy.npz --episodes 2 --cycles 50 --out scores"),
        Smoke("design --tracks people.csv --off-max 45 --footprint 10 --out design", leaves=("design/map.png",)),
        Smoke("bench history-selection --out bench"),
    ),
)  # fmt: skip


def build(folder: Path) -> Path:
    """Build the wheel of a copy of the sources, so that nothing of an earlier build comes along."""
    hidden = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "runs")
    shutil.copytree(_environment.ROOT, folder / "source", symlinks=True, ignore=hidden)
    pip(sys.executable, "wheel", "--no-deps", "--wheel-dir", str(folder), str(folder / "source"))
    shutil.rmtree(folder / "source")
    (wheel,) = folder.glob("camnet-*.whl")
    return wheel


def install(wheel: Path, folder: Path) -> Path:
    """Install the wheel, with the extra that one command needs, in a new environment; return its scripts' folder."""
    venv.create(folder, with_pip=True)
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    pip(scripts / "python", "install", "--no-compile", f"camnet[train] @ {wheel.as_uri()}")
    return scripts


def pip(python: str | Path, *words: str) -> None:
    """Run pip, which says nothing but its errors; leave if it fails."""
    subprocess.run([str(python), "-m", "pip", *words, "-qq", "--disable-pip-version-check"], check=True)


def environment(folder: Path) -> dict[str, str]:
    """Return the variables of a run: nothing points to the checkout, and kernels are kept in ``folder``."""
    own = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PYTHON", "CAMNET", "NUMBA"))
    }
    return {**own, **_environment.THREADS, "CAMNET_CACHE": str(folder / "cache")}


def commands(scripts: Path, folder: Path) -> dict[str, bool]:
    """Commands of the installed program, and whether each prints JSON; leave if it is not the installed one."""
    done = subprocess.run(
        [str(scripts / "python"), "-c", _LIST_COMMANDS],
        cwd=folder, env=environment(folder), stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    found = json.loads(done.stdout)
    if not Path(found["package"]).is_relative_to(scripts.parent):
        raise SystemExit(f"camnet was imported from {found['package']}, which is not the wheel's environment")
    return dict(found["commands"])


def fault(smoke: Smoke, prints_json: bool, scripts: Path, folder: Path) -> str | None:
    """Run one command; say what is wrong with it, if anything is."""
    words = [*smoke.words.split(), *(["--json"] if prints_json else [])]
    done = subprocess.run(
        [str(scripts / "camnet"), *words], cwd=folder, env=environment(folder), capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if done.returncode != smoke.status:
        return f"status {done.returncode} where {smoke.status} is expected\n{done.stderr}"
    if smoke.status == _REFUSED and (done.stdout or not done.stderr.startswith("camnet: ")):
        return f"bad input is not answered in a line of words: {done.stdout[:200]!r}, {done.stderr[:400]!r}"
    if prints_json and smoke.status != _REFUSED:
        try:
            content = json.loads(done.stdout)
        except ValueError as error:
            return f"standard output is no JSON ({error}): {done.stdout[:200]!r}"
        if not isinstance(content, dict):
            return f"standard output is no JSON object: {done.stdout[:200]!r}"
    missing = [name for name in smoke.leaves if not (folder / name).is_file()]
    return f"no {', '.join(missing)}" if missing else None


def run_row(row: tuple[Smoke, ...], known: dict[str, bool], scripts: Path, folder: Path) -> list[str]:
    """Run the commands of a row one after another; return the faults."""
    faults = []
    for smoke in row:
        began = time.monotonic()
        wrong = fault(smoke, known[smoke.words.split()[0]], scripts, folder)
        print(
            f"{'FAILED' if wrong else 'ok':6s} {time.monotonic() - began:5.0f} s  camnet {smoke.words}",
            flush=True,
        )
        if wrong:
            print(wrong, flush=True)
            faults.append(f"camnet {smoke.words}")
    return faults


def main() -> None:
    """Build, install, and run every command."""
    with tempfile.TemporaryDirectory(prefix="camnet-wheel-") as name:
        folder = Path(name).resolve()
        print("building the wheel and installing it in a clean environment ...", flush=True)
        scripts = install(build(folder), folder / "venv")
        work = folder / "work"
        work.mkdir()
        (work / "people.csv").write_text("\n".join(_PEOPLE) + "\n")
        (work / "seen.csv").write_text("\n".join(_SEEN) + "\n")
        draw = [str(scripts / "python"), "-c", _DRAW_BOARD]
        subprocess.run(draw, cwd=work, env=environment(work), check=True)
        known, tried = commands(scripts, work), {smoke.words.split()[0] for row in _ROWS for smoke in row}
        if set(known) != tried:
            raise SystemExit(
                f"commands without a run here: {set(known) - tried}; unknown ones: {tried - set(known)}"
            )
        with ThreadPoolExecutor(len(_ROWS)) as pool:
            rows = list(pool.map(lambda row: run_row(row, known, scripts, work), _ROWS))
    faults = [each for row in rows for each in row]
    if faults:
        raise SystemExit("\n".join(["wheel: FAILED", *faults]))
    print(f"wheel: all {len(known)} commands passed")


if __name__ == "__main__":
    main()
