"""Valid inputs, as small as they can be, made in code."""

from __future__ import annotations

import copy
import math
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

__all__ = [
    "CAMERAS",
    "GPX_WORLD",
    "NORTH",
    "SOUTH",
    "TRACK_WORLD",
    "WORLD",
    "dump",
    "fixes",
    "gpx",
    "krtd",
    "network",
    "policy",
    "table",
]

#: two cameras on quadrotors, a robot on a loop through both regions
WORLD: dict[str, Any] = {
    "name": "yard",
    "description": "two regions and a loop",
    "cameras": [
        {
            "name": "lens",
            "intrinsics": {
                "width_px": 640,
                "height_px": 480,
                "fx_px": 420.0,
                "fy_px": 421.5,
                "cx_px": 320.25,
                "cy_px": 240.0,
            },
            "near_m": 0.3,
            "far_m": 8.0,
        }
    ],
    "regions": [
        {"name": "east", "shape": {"type": "box", "min_m": [0.75, -2.0, 0.0], "max_m": [4.75, 2.0, 3.5]}},
        {"name": "west", "shape": {"type": "box", "min_m": [-4.75, -2.0, 0.0], "max_m": [-0.75, 2.0, 3.5]}},
    ],
    "agents": [
        {
            "name": "camera_0",
            "region": "east",
            "camera": "lens",
            "start_m": [2.75, 0.0, 2.5],
            "start_yaw_rad": 0.25,
        },
        {"name": "camera_1", "region": "west", "camera": "lens", "start_m": [-2.75, 0.0, 2.5]},
    ],
    "occluders": [
        {
            "name": "crate",
            "shape": {"type": "cylinder", "center_m": [0.0, 3.0], "radius_m": 0.5, "z_m": [0.0, 1.0]},
        }
    ],
    "roads": [
        {
            "name": "loop",
            "closed": True,
            "points_m": [[3.0, -1.0], [3.75, 0.0], [3.0, 1.0], [-3.0, 1.0], [-3.75, 0.0], [-3.0, -1.0]],
        }
    ],
    "targets": [
        {
            "name": "robot",
            "motion": {"kind": "vector_field", "field": "loop", "road": "loop", "speed_mps": 0.5},
            "start_m": [3.0, -1.0],
            "start_heading_rad": 1.57,
        }
    ],
    "run": {"duration_s": 0.5, "decision_hz": 10.0},
    "sensing": {"position_noise_m": 0.0125, "rate_hz": 30.0},
}


def _with_motion(**motion: Any) -> dict[str, Any]:
    world = copy.deepcopy(WORLD)
    target = world["targets"][0]
    target["motion"] = {"kind": "track", **motion}
    del target["start_m"], target["start_heading_rad"]
    target["v_max_mps"] = 3.0
    return world


TRACK_WORLD = _with_motion(file="walk.csv", id="a")
GPX_WORLD = _with_motion(file="walk.gpx", format="gpx", id="a", origin=[44.0, 11.0, 50.0])

CAMERAS = "name,x,y\nsouth,50,0\nnorth,52.5,100\n"
#: place, m, and direction of two cameras that look at each other's ground, rad
NORTH, SOUTH = (0.0, 30.0, -1.5), (0.0, -30.0, 1.5)
_SIDE_M = 100.0


def dump(data: Any) -> str:
    """Write plain data as YAML."""
    text: str = yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)
    return text


def fixes() -> list[tuple[str, float, float, float]]:
    """Return identity, time and place of two people who walk past each other."""
    rows = [("a", float(k), 0.75 * k - 5.0, 0.125 * k) for k in range(16)]
    return rows + [("b", k + 0.5, 6.0 - 0.75 * k, 2.0 - 0.25 * k) for k in range(16)]


def table(rows: list[tuple[str, float, float, float]], head: str = "id,t_s,x_m,y_m") -> str:
    """Write fixes as CSV."""
    return "\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n"


def gpx(points: int = 12) -> list[tuple[str, str, str]]:
    """Return latitude, longitude and time of a walk through the yard."""
    degree_m = 111_120.0
    return [
        (
            f"{44.0 + (0.25 * k - 1.0) / degree_m:.8f}",
            f"{11.0 + (3.0 + 0.25 * k) / (degree_m * math.cos(math.radians(44.0))):.8f}",
            f"2020-05-01T12:00:{k:02d}Z",
        )
        for k in range(points)
    ]


def krtd(x_m: float, y_m: float, turn_rad: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
    """Return K, R, T, D of a camera 5 m high that looks down at 30 degrees into a direction."""
    c, s, down = math.cos(turn_rad), math.sin(turn_rad), math.radians(30.0)
    forward = np.array([c * math.cos(down), s * math.cos(down), -math.sin(down)])
    right = np.array([s, -c, 0.0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    k = np.array([[1500.0, 0.0, 960.0], [0.0, 1502.5, 540.0], [0.0, 0.0, 1.0]])
    return k, rotation, -rotation @ np.array([x_m, y_m, 5.0]), [-0.05, 0.005, 0.0, 0.0]


def network() -> dict[str, Any]:
    """Return a block of four streets, both ways, as elements of a SUMO network."""
    corners = {"a": (0.0, 0.0), "b": (_SIDE_M, 0.0), "c": (_SIDE_M, _SIDE_M), "d": (0.0, _SIDE_M)}
    pairs = ["ab", "bc", "cd", "da", "ba", "cb", "dc", "ad"]
    edges = []
    for name in pairs:
        (x0, y0), (x1, y1) = corners[name[0]], corners[name[1]]
        lane = {"id": f"{name}_0", "index": "0", "speed": "13.9", "length": f"{_SIDE_M:.2f}"}
        lane["shape"] = f"{x0:.2f},{y0:.2f} {x1:.2f},{y1:.2f}"
        edges.append({"id": name, "from": name[0], "to": name[1], "priority": "1", "lanes": [lane]})
    turns = [(p, q) for p in pairs for q in pairs if p[1] == q[0] and p[0] != q[1]]
    connections = [
        {"from": p, "to": q, "fromLane": "0", "toLane": "0", "dir": "s", "state": "M"} for p, q in turns
    ]
    junctions = [
        {
            "id": name,
            "type": "priority",
            "x": f"{x:.2f}",
            "y": f"{y:.2f}",
            "incLanes": " ".join(f"{p}_0" for p in pairs if p[1] == name),
            "intLanes": "",
            "shape": f"{x:.2f},{y:.2f} {x + 1.0:.2f},{y:.2f} {x:.2f},{y + 1.0:.2f}",
        }
        for name, (x, y) in corners.items()
    ]
    return {"edges": edges, "junctions": junctions, "connections": connections}


def policy() -> bytes:
    """Return a policy file of random weights."""
    from camnet.agents.features import FEATURES
    from camnet.agents.policy_file import PolicyHeader, PolicyNet, save_policy

    rng = np.random.default_rng(0)
    sizes = [len(FEATURES), 4, 5]
    net = PolicyNet(
        PolicyHeader(features=tuple(FEATURES)),
        np.zeros(sizes[0]),
        np.ones(sizes[0]),
        tuple(rng.normal(size=pair) for pair in pairwise(sizes)),
        tuple(rng.normal(size=n) for n in sizes[1:]),
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.npz"
        save_policy(path, net)
        return path.read_bytes()
