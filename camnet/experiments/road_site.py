"""A city's roads for certification: every lane and every turning path of a SUMO network as directed arcs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camnet.certification.road_arcs import RoadArcs, arcs_from_lanes
from camnet.certification.transitions import RoadTargetClass
from camnet.importers.sumo_lanes import LaneEdge, LaneNetwork, read_lane_network
from camnet.types import Array

__all__ = ["RoadSite", "read_road_site", "site_of"]


@dataclass(frozen=True, eq=False)
class RoadSite:
    """A road network for certification.

    Attributes
    ----------
    roads : arcs: first one for each edge, with all its lanes, then one for each turning path over a junction
    streets : (A,) names of the arcs: the edge's, or ``from > to`` for a turn
    junctions : (J, 2) places of junctions, m
    speed_mps : (A,) speed limit of each arc
    edges : number of arcs that are edges
    """

    roads: RoadArcs
    streets: list[str]
    junctions: Array
    speed_mps: Array
    edges: int

    @property
    def edges_km(self) -> float:
        """Length of all edges, turns left out, km."""
        return float(self.roads.length_m[: self.edges].sum() / 1000.0)

    def paced(self, v_lo_mps: float) -> RoadArcs:
        """Return the arcs in metres of a target at ``v_lo_mps``: those with a lower speed limit count as longer.

        The least speed on an arc is ``v_lo_mps`` or its limit, whichever is less, so that a way of length L takes
        L / v_lo_mps at most while the target moves.
        """
        factor = v_lo_mps / np.minimum(v_lo_mps, self.speed_mps)
        if (factor == 1.0).all():
            return self.roads
        of = factor[self.roads.piece_arc]
        lines = np.repeat(of, np.diff(self.roads.line_ptr))
        return replace(
            self.roads,
            direction_xy=self.roads.direction_xy / of[:, None],
            piece_length_m=self.roads.piece_length_m * of,
            piece_offset_m=self.roads.piece_offset_m * of,
            length_m=self.roads.length_m * factor,
            line_direction_xy=self.roads.line_direction_xy / lines[:, None],
        )

    def with_limits(self, target: RoadTargetClass) -> RoadTargetClass:
        """Return a class whose greatest speed is the highest speed limit of the network."""
        return replace(target, v_max_mps=max(target.v_lo_mps, float(self.speed_mps.max())))


def read_road_site(path: Path) -> RoadSite:
    """Read the lanes of a SUMO network as directed arcs.

    Raises
    ------
    ConfigError
        ``sumolib`` is not installed.
    DataError
        The file is not a SUMO network, or has no lane for road vehicles.
    """
    return site_of(read_lane_network(path))


def site_of(network: LaneNetwork) -> RoadSite:
    """Build the arcs of a lane network.

    Every way is as long as its longest lane. Vehicles that change lanes drive a little further: on each edge they may
    cross the whole carriageway once, which is added to its length.
    """
    n = len(network.edges)
    lanes = [[lane.points for lane in edge.lanes] for edge in network.edges]
    extra = [_across_m(edge) for edge in network.edges]
    streets = [edge.id for edge in network.edges]
    speed = [min(lane.speed_mps for lane in edge.lanes) for edge in network.edges]
    following: list[list[int]] = [[] for _ in network.edges]
    for turn in network.turns:
        if turn.lane is None:
            following[turn.source].append(turn.target)
            continue
        following[turn.source].append(len(lanes))
        following.append([turn.target])
        lanes.append([turn.lane.points])
        extra.append(0.0)
        streets.append(f"{network.edges[turn.source].id} > {network.edges[turn.target].id}")
        speed.append(turn.lane.speed_mps)
    following = [list(dict.fromkeys(of)) for of in following]
    roads = arcs_from_lanes(lanes, following, extra)
    junctions = np.array(list(network.junctions.values()))
    return RoadSite(roads, streets, junctions, np.array(speed), n)


def _across_m(edge: LaneEdge) -> float:
    """Return the largest distance between the middles of two lanes at their beginnings, m."""
    starts = np.array([lane.points[0] for lane in edge.lanes])
    return float(np.linalg.norm(starts[:, None] - starts[None], axis=2).max())
