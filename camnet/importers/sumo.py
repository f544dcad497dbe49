"""SUMO: the roads of a ``.net.xml`` network, and traces made by running the simulator.

Both parts of SUMO are optional (``pip install 'camnet[sumo]'``): ``sumolib`` reads networks, the ``sumo`` program of
the ``eclipse-sumo`` wheel runs scenarios. Traces are read by `fcd_tracks`, without either.
"""

from __future__ import annotations

import importlib.util
import math
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camnet.errors import ConfigError, DataError
from camnet.geometry.settings import Road
from camnet.importers._reading import number, open_binary, parse_xml
from camnet.importers.sumo_checks import check_network
from camnet.processes.tied import tied_command
from camnet.storage.partial import scratch_folder
from camnet.types import Array

__all__ = ["SumoEdge", "SumoNetwork", "network_file", "read_sumo_network", "roads_of", "run_sumo"]

_INSTALL = "install the extra: pip install 'camnet[sumo]'"
_SHOWN_ERROR_LINES = 5


@dataclass(frozen=True, eq=False, slots=True)
class SumoEdge:
    """One direction of one street between two junctions.

    Attributes
    ----------
    id, start, end : names of the edge and of the junctions that it leaves and reaches
    points : (n, 2) centre line in the network's metres, from junction to junction
    width_m : of all lanes together
    speed_mps : limit
    successors : edges that cars may turn into at its end
    """

    id: str
    start: str
    end: str
    points: Array
    width_m: float
    speed_mps: float
    successors: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class SumoNetwork:
    """Streets open to cars, and where junctions lie: name -> (x, y) in m."""

    edges: tuple[SumoEdge, ...]
    junctions: dict[str, tuple[float, float]]


def read_sumo_network(path: str | Path) -> SumoNetwork:
    """Read the streets of a ``.net.xml`` (``.gz`` allowed) that passenger cars may use.

    Raises
    ------
    ConfigError
        ``sumolib`` is not installed.
    DataError
        The file is not a SUMO network, breaks a rule of `camnet.importers.sumo_checks`, or has no street for cars.
    """
    try:
        import sumolib
    except ImportError:
        raise ConfigError(f"{path}: reading a SUMO network needs sumolib; {_INSTALL}") from None
    path = Path(path)
    check_network(path)
    try:
        net = sumolib.net.readNet(str(path))
    except Exception as error:  # sumolib lets anything through: KeyError, ValueError, AttributeError, ...
        raise DataError(f"{path}: not a SUMO network that sumolib can read ({error!r})") from None
    edges = tuple(_edge(edge) for edge in net.getEdges() if _for_cars(edge))
    if not edges:
        raise DataError(f"{path}: has no edge that passenger cars may use")
    used = {name for edge in edges for name in (edge.start, edge.end)}
    junctions = {node.getID(): tuple(node.getCoord()[:2]) for node in net.getNodes() if node.getID() in used}
    return SumoNetwork(edges, junctions)


def roads_of(network: SumoNetwork) -> tuple[Road, ...]:
    """Return the streets as roads of a world: the two directions of one street become one road.

    Roads that meet share an end point exactly, as world files ask.
    """
    seen: dict[frozenset[str], list[SumoEdge]] = {}
    roads = []
    for edge in network.edges:
        others = seen.setdefault(frozenset((edge.start, edge.end)), [])
        if any(_is_reverse(edge, other) for other in others):
            continue
        others.append(edge)
        points = tuple((float(x), float(y)) for x, y in edge.points)
        roads.append(Road(name=edge.id, points_m=points, width_m=edge.width_m))
    return tuple(roads)


def run_sumo(
    config: str | Path, out: str | Path, duration_s: float, seed: int = 0, step_s: float = 1.0
) -> Path:
    """Run a SUMO scenario and write its floating-car data.

    The scenario's folder is only read: its own outputs are left out, and everything else that SUMO writes goes to
    a folder that is deleted. ``out`` appears complete or not at all.

    Parameters
    ----------
    config : the ``.sumocfg``
    out : FCD file to write; ``.gz`` packs it
    duration_s : simulated time from the scenario's begin
    seed : SUMO's seed
    step_s : simulation step, and interval of the fixes

    Raises
    ------
    ConfigError
        SUMO is not installed, or a number is out of range.
    DataError
        The scenario cannot be read, or SUMO refuses it (its last words are quoted).
    """
    config, out = Path(config), Path(out)
    _check_run(duration_s, seed, step_s)
    program = _sumo_program()
    scenario, begin_s = _scenario(config)
    out.parent.mkdir(parents=True, exist_ok=True)
    with scratch_folder(out.absolute(), "sumo") as stage:
        _stage_inputs(config, scenario, stage)
        fcd = stage / ("fcd.xml.gz" if out.suffix == ".gz" else "fcd.xml")
        arguments = {
            "--configuration-file": stage / "camnet.sumocfg",
            "--fcd-output": fcd,
            "--fcd-output.attributes": "x,y,angle,speed",  # what the reader takes; an hour of a city is large
            "--begin": begin_s,
            "--end": begin_s + duration_s,
            "--step-length": step_s,
            "--seed": seed,
            "--no-step-log": "true",
            "--no-warnings": "true",
        }
        command = [program, *(str(word) for pair in arguments.items() for word in pair)]
        done = subprocess.run(tied_command(command), capture_output=True, text=True, cwd=stage, check=False)
        if done.returncode != 0 or not fcd.is_file():
            words = (done.stderr.strip() or done.stdout.strip()).splitlines()[-_SHOWN_ERROR_LINES:]
            raise DataError(f"{config}: sumo ended with status {done.returncode}: {' | '.join(words)}")
        os.replace(fcd, out)
    return out


def network_file(config: Path) -> Path:
    """Return the network that a ``.sumocfg`` names."""
    element = _scenario(config)[0].find(".//net-file")
    name = None if element is None else element.get("value")
    if not name:
        raise DataError(f"{config}: net-file is missing: the scenario names its .net.xml there")
    return config.parent / name


def _for_cars(edge: Any) -> bool:  # noqa: ANN401 (sumolib has no types)
    return bool(edge.getFunction() in ("", "normal") and edge.allows("passenger"))


def _edge(edge: Any) -> SumoEdge:  # noqa: ANN401 (sumolib has no types)
    start, end = edge.getFromNode(), edge.getToNode()
    line = [start.getCoord()[:2], *(point[:2] for point in edge.getShape()), end.getCoord()[:2]]
    points = np.array([p for k, p in enumerate(line) if k == 0 or p != line[k - 1]], dtype=np.float64)
    points.setflags(write=False)
    return SumoEdge(
        id=edge.getID(),
        start=start.getID(),
        end=end.getID(),
        points=points,
        width_m=float(sum(lane.getWidth() for lane in edge.getLanes())),
        speed_mps=float(edge.getSpeed()),
        successors=tuple(sorted(other.getID() for other in edge.getOutgoing() if _for_cars(other))),
    )


def _is_reverse(edge: SumoEdge, other: SumoEdge) -> bool:
    """Whether two edges between the same junctions run the opposite ways along one street.

    They do if their carriageways touch halfway, give or take a metre; wide medians make two roads.
    """
    if (edge.start, edge.end) != (other.end, other.start):
        return False
    apart_m = 0.5 * (edge.width_m + other.width_m) + 1.0
    middles = [
        np.array([np.interp(0.5, _fractions(e.points), e.points[:, k]) for k in (0, 1)])
        for e in (edge, other)
    ]
    return bool(np.linalg.norm(middles[0] - middles[1]) <= apart_m)


def _fractions(points: Array) -> Array:
    """Arc length at each point over the whole length."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return arc / max(float(arc[-1]), 1e-12)


def _check_run(duration_s: float, seed: int, step_s: float) -> None:
    for name, value in (("duration_s", duration_s), ("step_s", step_s)):
        if not (math.isfinite(value) and value > 0):
            raise ConfigError(f"{name} is {value}; a positive time in seconds was expected")
    if not 0 <= seed < 2**31:
        raise ConfigError(f"seed is {seed}; SUMO takes 0 to {2**31 - 1}")


def _sumo_program() -> str:
    """Find ``sumo``: in the wheel of this environment, beside the interpreter, on the path."""
    spec = importlib.util.find_spec("sumo")
    wheel = [Path(place) / "bin" for place in (spec.submodule_search_locations or ())] if spec else []
    for folder in (*wheel, Path(sys.executable).parent, None):
        found = shutil.which("sumo", path=None if folder is None else str(folder))
        if found:
            return found
    raise ConfigError(f"making a trace needs the program sumo, which is not there; {_INSTALL}")


def _scenario(config: Path) -> tuple[ET.ElementTree[ET.Element], float]:
    """Read a ``.sumocfg`` and the time at which it begins."""
    parse_xml(config, "sumoConfiguration", lambda *_: None)
    with open_binary(config) as stream:
        tree = ET.parse(stream)
    begin = tree.find(".//begin")
    text = "0" if begin is None else begin.get("value", "0")
    return tree, number(text, str(config), "<begin>")


def _stage_inputs(config: Path, tree: ET.ElementTree[ET.Element], stage: Path) -> None:
    """Copy the scenario's configuration without its outputs, and link its files beside it.

    Additional files may name outputs of their own; SUMO puts those beside the file that names them, so the
    links keep them out of the scenario's folder.
    """
    folder = config.resolve().parent
    for entry in folder.iterdir():
        _link(entry, stage / entry.name)
    root = tree.getroot()
    for section in ("output", "report"):
        for element in root.findall(section):
            root.remove(element)
    for element in root.iter():
        names = element.get("value", "").split(",")
        if any(name.startswith("..") for name in names):
            absolute = [str((folder / name).resolve()) if name.startswith("..") else name for name in names]
            element.set("value", ",".join(absolute))
    tree.write(stage / "camnet.sumocfg", encoding="utf-8", xml_declaration=True)


def _link(source: Path, target: Path) -> None:
    try:
        target.symlink_to(source)
    except OSError:  # file systems and users that may not link
        if source.is_file():
            shutil.copy(source, target)
