"""The closed loop of one simulation, one decision period at a time.

    setpoints -> C1 references -> sliding mode (4-6) -> world -> visibility on the truth -> measurements
              -> estimators side by side -> entries into the regions -> next setpoints

Rates: physics inside the world, control at ``controller.rate_hz``, sensing at ``sensing.rate_hz``, decisions at
``run.decision_hz``; each is a whole multiple of the next slower one's period in control steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from camnet.control.autopilot import Autopilot
from camnet.control.monitor import DisturbanceMonitor
from camnet.control.references import ReferenceGenerator
from camnet.control.sliding_mode import SlidingModeController
from camnet.copies import ExactCopies
from camnet.errors import ConfigError
from camnet.estimation.delayed import DelayedFilter
from camnet.estimation.own_pose import ConsideredFilter
from camnet.estimation.persistence import load_models
from camnet.estimation.protocol import Rollout, TargetFilter
from camnet.estimation.structure.moving.size_from_motion import SizeFromMotion
from camnet.sensing.pose_sensor import PoseSensor
from camnet.sensing.settings import SensingSettings
from camnet.sensing.survey import Lookout, Survey, first_seers
from camnet.sensing.visibility import VisibilityTest
from camnet.sensing.vision_sensor import build_sensor
from camnet.simulation.certificates import network_certificates
from camnet.simulation.entries import Entry, predict_entries
from camnet.simulation.exits import ExitBudgets
from camnet.simulation.filters import TargetTruth
from camnet.simulation.gaps import GapRecorder, miss
from camnet.simulation.handoff import HandoffTracker
from camnet.simulation.models import start_from
from camnet.simulation.named_filters import named_filters
from camnet.simulation.network import Network
from camnet.simulation.own_pose import own_poses
from camnet.simulation.perception import Perceived, Perceiver
from camnet.simulation.statistics import RunStatistics
from camnet.simulation.truth import TruthRecord, truth_of
from camnet.types import Array, BoolArray, PoseMeasurement, Snapshot
from camnet.world.protocol import CameraCommand, Steers, World

__all__ = ["FilterMaker", "NetworkSimulation", "Setpoints"]

#: makes one estimator for each target, from the network and what may be known of the targets' truth
FilterMaker = Callable[[Network, Sequence[TargetTruth]], Sequence[TargetFilter]]


@dataclass(frozen=True, eq=False, slots=True)
class Setpoints:
    """What every agent is asked to do: position (N,3) in the world, m, and gaze (N,2) = (pan, tilt), rad."""

    p_world: Array
    gaze_rad: Array


class NetworkSimulation(ExactCopies):
    """One camera network in closed loop; copies go on like the original, in a world of their own.

    Parameters
    ----------
    network : the built scenario
    world : the physics back end
    filters : names of the estimators to run on the same measurements; the first one drives the agents
    seed : fixes the whole run
    makers : for names that are not in `camnet.simulation.filters.FILTERS` (or stand for something else here)
    every_entry : whether every entry into a region counts as a handoff (`camnet.simulation.handoff`)
    cameras_on : whether cameras see anything at all
    """

    def __init__(
        self,
        network: Network,
        world: World,
        filters: Sequence[str],
        seed: int,
        makers: Mapping[str, FilterMaker] | None = None,
        every_entry: bool = False,
        cameras_on: bool = True,
    ) -> None:
        scenario = network.scenario
        self._makers = dict(makers or {})
        self._every_entry, self._cameras_on = every_entry, cameras_on
        self.network, self.world, self.filter_names = network, world, tuple(filters)
        self.control_dt_s = 1.0 / scenario.controller.rate_hz
        self.sense_every = _whole_ratio("sensing", scenario.controller.rate_hz, scenario.sensing.rate_hz)
        self.decide_every = _whole_ratio("decision", scenario.controller.rate_hz, scenario.run.decision_hz)
        self._visibility = VisibilityTest(
            network.cameras,
            [target.features_m for target in network.description.targets],
            [None] * len(network.cameras),  # regions are asked once for everybody, in _sense
        )
        self._lookout = Lookout(*network.boxes, network.n_agents, self._visibility.packed)
        self._rays_clear = world.rays_clear if network.can_occlude else None
        self._certificates = network_certificates(network)
        self._saved = [] if scenario.run.model is None else load_models(scenario.run.model)
        #: called after every sensing instant
        self.watchers: list[Callable[[NetworkSimulation], None]] = []
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Start again; every generator is derived from ``seed``."""
        scenario, network = self.network.scenario, self.network
        world_rng, self._sensor_rng, own_rng = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)
        )
        self._record = TruthRecord(self.world.reset(world_rng), _frames_late(scenario.sensing) + 2)
        self.count = 0
        self._controller = SlidingModeController(scenario.controller)
        self._references = ReferenceGenerator(
            scenario.controller,
            network.flight_regions,
            np.array([a.start_yaw_rad for a in network.description.agents]),
            self.control_dt_s,
            network.detours(),
        )
        #: where agents believe to be, if any may lose its pose; the sizes of targets of unknown size, by number
        self.own = own_poses(network, self.control_dt_s, self.snapshot, own_rng)
        self.exits = ExitBudgets(network) if network.exits else None
        self._reference_state = self._references.start(self.believed_p_world)
        targets = enumerate(scenario.targets)
        self.sizes = {m: SizeFromMotion(t.assumed_size) for m, t in targets if t.assumed_size is not None}
        features = [target.features_m for target in network.description.targets]
        self._sensor = build_sensor(scenario.sensing, network.cameras, features, self.world.render)
        self.disturbance = DisturbanceMonitor(scenario.controller, network.n_agents)
        self._autopilot = self._build_autopilot()
        self.filters: dict[str, list[TargetFilter]] = {
            name: self._build_filters(name) for name in self.filter_names
        }
        #: what came of the last sensing instant, where it is all one call
        self.perceived: Perceived | None = None
        self._perceiver = self._all_at_once()
        if scenario.run.model is not None:
            start_from(self._saved, scenario.run.model, self.filters, network.basis, network.n_models)
        self.trackers = [
            HandoffTracker(m, scenario.handoff.grace_s, self._every_entry) for m in range(network.n_targets)
        ]
        handoff = scenario.handoff
        self.gaps = [
            GapRecorder(m, network.regions, handoff.lookahead_s, handoff.rollout_dt_s)
            for m in range(network.n_targets)
        ]
        self.visible: BoolArray = np.zeros((len(network.cameras), network.n_targets), dtype=bool)
        self.target_region = np.full(network.n_targets, -1)
        self.spacing_m = math.inf  # least distance between two agents at the last sensing step
        self._outside: tuple[Snapshot | None, BoolArray] = (None, np.zeros(network.n_agents, dtype=bool))
        #: which cameras work; one that does not sees nothing
        self.working: BoolArray = np.full(len(network.cameras), self._cameras_on)
        self._entries: list[list[Entry | None]] = []
        self._next_plan_s = -math.inf
        self.statistics = RunStatistics(self, self._certificates)
        self._sense()

    def _build_autopilot(self) -> Autopilot | None:
        """Return what flies the agents in compiled code; None where the parts have to be asked one by one."""
        world = self.world if isinstance(self.world, Steers) and self.own is None else None
        self._steers = world if world is not None and world.can_steer and self._references.plain else None
        if self.network.n_agents == 0 or self._steers is None:
            return None
        return Autopilot(self._references, self._controller, self.disturbance, self._reference_state)

    def _build_filters(self, name: str) -> list[TargetFilter]:
        network, scenario = self.network, self.network.scenario
        truths = [truth_of(self._record, self.world, m) for m in range(network.n_targets)]
        if name in self._makers:
            return list(self._makers[name](network, truths))
        filters = named_filters(name, network, truths)
        latency_s = scenario.sensing.latency_s
        if name == "oracle":  # it asks no measurement
            return filters
        if latency_s:
            filters = [DelayedFilter(f, latency_s) for f in filters]
        return [ConsideredFilter(f) for f in filters] if network.own_poses else filters

    @property
    def believed_p_world(self) -> Array:
        """Where the agents' cameras are (N,3), m, as their agents believe."""
        p_world = self.snapshot.camera_p_world if self.own is None else self.own.p_world
        return p_world[: self.network.n_agents]

    @property
    def snapshot(self) -> Snapshot:
        """The truth now."""
        return self._record.now

    @snapshot.setter
    def snapshot(self, now: Snapshot) -> None:
        self._record.now = now

    @property
    def driving(self) -> list[TargetFilter]:
        """The estimators whose output the agents act on, one per target."""
        return self.filters[self.filter_names[0]]

    def advance(self, setpoints: Setpoints) -> None:
        """Run one decision period under constant setpoints."""
        if self.exits is not None:
            self.exits.decide(self, self._references)
        if self._autopilot is not None and self._steers is not None:
            self._fly(self._steers, self._autopilot, setpoints)
            return
        for _ in range(self.decide_every):
            self._control_step(setpoints)
            if self.count % self.sense_every == 0:
                self._sense()

    def _fly(self, world: Steers, autopilot: Autopilot, setpoints: Setpoints) -> None:
        """Do what `_control_step` does, all periods up to the next sensing in a row."""
        autopilot.ask(setpoints.p_world, setpoints.gaze_rad)
        left = self.decide_every
        while left > 0:
            periods = min(left, self.sense_every - self.count % self.sense_every)
            flown = world.fly(autopilot, periods)
            left -= periods
            self.count += periods
            self.snapshot = flown.snapshot
            self.statistics.after_flight(self, flown)
            if self.count % self.sense_every == 0:
                self._sense()

    def advance_commanded(self, pilot: Callable[[Snapshot], CameraCommand]) -> None:
        """Run one decision period under velocity commands of ``pilot``, asked every control period.

        References and sliding mode are out of the loop, and so is the monitor of their envelope.
        """
        for _ in range(self.decide_every):
            self.snapshot = self.world.step(pilot(self.snapshot))
            self.count += 1
            self.statistics.after_control(self)
            if self.count % self.sense_every == 0:
                self._sense()

    def _control_step(self, setpoints: Setpoints) -> None:
        n, before, own = self.network.n_agents, self.snapshot, self.own
        reference = self._references.reference(self._reference_state)
        p_world, q_world = before.camera_p_world, before.camera_q_world
        if own is not None:
            p_world, q_world = own.p_world, own.q_world
        control = self._controller.control(p_world[:n], q_world[:n], reference)
        v_world, a_world = control.v_world, control.a_world
        if own is not None:
            v_world, a_world = own.turned_back(v_world), own.turned_back(a_world)
        self.snapshot = self.world.step(CameraCommand(v_world, control.w_cam, a_world))
        self.count += 1
        if own is not None:
            own.step(self.snapshot)
        after = (self.snapshot.camera_p_world, self.snapshot.camera_q_world)
        if own is not None:  # what is flown is what is believed
            after = (own.p_world, own.q_world)
        self.disturbance.update_poses((p_world, q_world, *after), self.control_dt_s, control)
        self._reference_state = self._references.step(
            self._reference_state, setpoints.p_world, setpoints.gaze_rad
        )
        self.statistics.after_control(self)

    def reference_p_world(self, j: int) -> Array:
        """Return the present position reference (3,) of agent ``j``, m."""
        return np.array(self._reference_state.p_world[j])

    def _sense(self) -> None:
        snapshot, network = self.snapshot, self.network
        exceptions = network.exceptions(snapshot.target_p_world, snapshot.agent_p_world)
        self._record.past.append(snapshot)
        if self._perceiver is not None:
            self.perceived = self._perceiver.perceive(snapshot, exceptions, self.working, self._sensor_rng)
            self._survey(snapshot, self.perceived.survey)
            self._follow_gaps(self.perceived)
        else:
            self._survey(snapshot, self._lookout.look(snapshot, exceptions, self.working))
            self._measure(snapshot)
        for m, tracker in enumerate(self.trackers):
            tracker.update(snapshot.t_s, int(self.target_region[m]), self._seen_by[m])
        self.statistics.after_sense(self)
        for watch in self.watchers:
            watch(self)

    def _all_at_once(self) -> Perceiver | None:
        """Return estimators that look and measure for themselves; None where that is done one thing after the other."""
        source = getattr(self.driving[0], "bank", None) if self.driving else None
        late = self.network.scenario.sensing.latency_s > 0.0
        alone = len(self.filter_names) == 1 and type(self._sensor) is PoseSensor and not late
        alone = alone and self.own is None and self.exits is None and not self.sizes
        if not (alone and self._rays_clear is None and isinstance(source, Perceiver)):
            return None
        source.connect(self._lookout, self._sensor)
        return source

    def _follow_gaps(self, perceived: Perceived) -> None:
        """Note sightings and gaps of all targets."""
        t_s, name = self.snapshot.t_s, self.filter_names[0]
        for m, camera in enumerate(perceived.camera):
            if camera >= 0:
                missed = {name: perceived.miss_m[m]}
                self.gaps[m].seen(t_s, camera, self.snapshot.target_p_world[m], missed)
            else:
                self.gaps[m].unseen(t_s, {name: self.driving[m]})

    def _measure(self, snapshot: Snapshot) -> None:
        """Measure, and advance all estimators of all targets to now."""
        measurements = self._sensor.measure(snapshot, self.visible, self._sensor_rng)
        if self.own is not None:
            measurements = self.own.report(snapshot.t_s, self._outside[1], measurements)
        if self.sizes:
            measurements = [
                self.sizes[z.target].take(z) if z.target in self.sizes else z for z in measurements
            ]
        one = len(self.trackers) == 1
        for m in range(len(self.trackers)):
            self._estimate(m, _nearest(measurements if one else [z for z in measurements if z.target == m]))

    def _survey(self, snapshot: Snapshot, found: Survey) -> None:
        """Take over who is where, and who sees whom."""
        self.visible, self.target_region, self.spacing_m = found.visible, found.region, found.spacing_m
        self._outside, self._seen_by = (snapshot, found.outside), found.seen_by
        if self.exits is not None and self.exits.sees(snapshot, self._visibility, self.working, self.visible):
            self._seen_by = first_seers(self.visible)
        if self._rays_clear is not None:
            self._visibility.clear(snapshot, self.visible, self._rays_clear)
            self._seen_by = first_seers(self.visible)

    def _estimate(self, m: int, best: PoseMeasurement | None) -> None:
        """Advance all estimators of target ``m`` to now, with the measurement ``best`` if there is one."""
        filters = {name: self.filters[name][m] for name in self.filter_names}
        now = self.snapshot.t_s
        if best is not None:
            gap, p_world = self.gaps[m], self.snapshot.target_p_world[m]
            missed = {name: miss(f, now, p_world) for name, f in filters.items()} if gap.is_open else {}
            gap.seen(now, best.camera, p_world, missed)
        for filter_ in filters.values():
            if best is not None:
                filter_.correct(best, best.camera)
            if best is None or best.t_s < now:
                filter_.predict(now)
        if best is None:
            self.gaps[m].unseen(now, filters)

    def seen_by(self, m: int) -> int:
        """Index of a camera that truly sees target ``m`` (-1: none)."""
        return self._seen_by[m]

    def agents_outside(self) -> BoolArray:
        """Which agents (N,) are outside their operating regions."""
        when, outside = self._outside
        if when is not self.snapshot:
            outside = np.asarray(~np.diagonal(self.network.containment(self.snapshot.agent_p_world)))
            self._outside = self.snapshot, outside
        return outside

    def rollout(self, m: int) -> Rollout:
        """Predicted future of target ``m`` by the driving estimator."""
        handoff = self.network.scenario.handoff
        return self.driving[m].rollout(handoff.lookahead_s, handoff.rollout_dt_s)

    def entries(self) -> list[list[Entry | None]]:
        """Predicted entries, ``[m][j]``, of every target into every region; renewed every ``handoff.replan_s``."""
        if self.snapshot.t_s >= self._next_plan_s:
            self._next_plan_s = self.snapshot.t_s + self.network.scenario.handoff.replan_s - 1e-9
            self._entries = [self._predict(m) for m in range(self.network.n_targets)]
        return self._entries

    def _predict(self, m: int) -> list[Entry | None]:
        if not math.isfinite(self.driving[m].estimate.last_seen_s):
            return [None] * len(self.network.regions)
        return predict_entries(self.rollout(m), self.network.regions)


def _nearest(measurements: list[PoseMeasurement]) -> PoseMeasurement | None:
    """Of several cameras that measured one target, the nearest one."""
    if len(measurements) < 2:
        return measurements[0] if measurements else None
    return min(measurements, key=lambda z: float(z.p_cam @ z.p_cam))


def _frames_late(sensing: SensingSettings) -> int:
    """Frames between an image and its measurement."""
    return math.ceil(sensing.latency_s * sensing.rate_hz)


def _whole_ratio(what: str, fast_hz: float, slow_hz: float) -> int:
    ratio = fast_hz / slow_hz
    if abs(ratio - round(ratio)) > 1e-9 or ratio < 1:
        raise ConfigError(
            f"controller.rate_hz = {fast_hz:g} must be a whole multiple of the {what} rate {slow_hz:g} Hz"
        )
    return round(ratio)
