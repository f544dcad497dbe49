"""Dwell times of agents that learn structure from their own motion, of a world that states their errors.

Part of the report of ``camnet certify`` where ``certificate.structure`` is there or agents fly by key frames: the
times of bell2019, chapters 4 and 5, as ``published``, ``sound`` and ``learned`` side by side. ``learned`` comes from
stretches simulated with errors drawn within the bounds, and holds for 95 % of the cases with 95 % confidence.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from camnet.certification.bell_dwell import (
    MovingTargetConstants,
    landmark_off_max,
    landmark_off_max_learned,
    landmark_off_max_sound,
    landmark_on_min_first,
    landmark_on_min_later,
    moving_target_initial_max,
    moving_target_off_max,
)
from camnet.certification.dwell import DwellTime
from camnet.certification.outage import bounds_of
from camnet.certification.structure_dwell import (
    TargetErrors,
    inscribed_radius,
    target_off_max_learned,
    target_off_max_sound,
)
from camnet.certification.structure_settings import StructureBounds
from camnet.experiments.structure_stretches import point_stretches, target_stretches
from camnet.geometry.frustum import Frustum
from camnet.simulation.certificates import feature_extent
from camnet.simulation.network import Network

__all__ = ["structure_assumptions", "structure_bounds", "structure_report"]

#: simulated stretches are at most so long, s
_LONGEST_S = 120.0
_Rows = dict[str, dict[str, Any]]


def structure_report(network: Network, allowed_s: float | None) -> dict[str, Any]:
    """Return the dwell times, and whether a target may be out of view for ``allowed_s``.

    Raises
    ------
    CertificateError
        A bound of ``certificate.structure`` cannot be.
    """
    s = structure_bounds(network)
    assert s is not None  # asked only where there are some
    speed = s.camera_speed_mps or network.scenario.physics.quadrotor.v_max_mps
    range_m, ball = _view(network)
    margin = ball - feature_extent(network)
    errors = _errors(s, max(t.v_max_mps for t in network.scenario.targets), range_m)
    rng = np.random.default_rng(0)
    rows = _landmark(s, speed, rng) | _target(s, errors, margin, speed, rng)
    off = rows["target_out_of_view"]
    return {
        "dwell_times": rows,
        "view": {"range_m": range_m, "ball_m": ball, "margin_m": margin},
        "allowed_off_s": allowed_s,
        "verdicts": {name: _verdict(time, allowed_s) for name, time in off.items()},
        "stated": s.model_dump(mode="json"),
    }


def structure_assumptions(network: Network) -> list[str]:
    """Return what the dwell times rest on, in words."""
    s = structure_bounds(network)
    assert s is not None
    return [
        f"structure: velocities are measured to {s.speed_error_mps:g} m/s and {s.rate_error_radps:g} rad/s; when a "
        f"target leaves the view its position is known to {s.target.position_m:g} m, and its model is right to "
        f"{s.target.error:g} {'m/s' if s.target.slope_per_s2 is None else 'm/s^2'}",
        "structure: times in view are accumulated time of informative motion after a distance is learned, of all "
        "features that remain",
    ]


def structure_bounds(network: Network) -> StructureBounds | None:
    """Return the bounds that a world states, else those of its agents that fly by key frames; None if it has neither.

    Of these agents, the scale that calibration leaves, at the speed of their references, and the gyro's bias. Noise
    that adds ``n`` of position in one second has moved it by ``n sqrt(t) <= n (1 + t) / 2`` after t: half of that is
    there from the beginning.
    """
    stated = network.scenario.certificate.structure
    sources = [a.pose for a in network.scenario.agents if a.pose.source == "key_frames"]
    if stated is not None or not sources:
        return stated
    speed = network.scenario.controller.reference_v_max_mps
    whole = [bounds_of(source, 1.0, speed) for source in sources]
    noise = max(0.5 * b.bounds.sigmas * b.walk_p_m for b in whole)
    turn = max(0.5 * b.bounds.sigmas * b.walk_th_rad for b in whole)
    default = StructureBounds()
    room = default.landmark.error_hi_m - math.sqrt(2.0) * (noise + turn * default.landmark.distance_max_m)
    return StructureBounds(
        speed_error_mps=max(b.bounds.scale for b in whole) * speed + noise,
        rate_error_radps=max(b.bounds.gyro_bias_radps for b in whole) + turn,
        camera_speed_mps=speed,
        landmark=default.landmark.model_copy(update={"error_hi_m": max(room, 1e-6)}),
        target=default.target.model_copy(
            update={"position_m": default.target.position_m + noise + turn * _view(network)[0]}
        ),
    )


def _view(network: Network) -> tuple[float, float]:
    """Range and radius of the ball of the agents' smallest view, m; of all cameras where there are no agents."""
    cameras = network.cameras[: network.n_agents] or network.cameras
    found = []
    for model in cameras:
        half_angle = float(Frustum.from_camera(model).smallest_half_angle())
        ball = min(inscribed_radius(model.far_m, half_angle), 0.5 * (model.far_m - model.near_m))
        found.append((model.far_m, ball))
    return min(found, key=lambda one: one[1])


def _errors(s: StructureBounds, v_max_mps: float, range_m: float) -> TargetErrors:
    t = s.target
    return TargetErrors(
        t.position_m, t.velocity_mps, t.slope_per_s2, t.damping_per_s, t.error, v_max_mps, s.speed_error_mps,
        s.rate_error_radps, range_m,
    )  # fmt: skip


def _landmark(s: StructureBounds, speed: float, rng: np.random.Generator) -> _Rows:
    """Chapter 4. The printed times in view hold, read as accumulated informative time."""
    m = s.landmark
    first = landmark_on_min_first(m.lambda_a, m.kx_min_per_s, m.distance_max_m, m.error_lo_m)
    later = landmark_on_min_later(m.lambda_a, m.kx_min_per_s, m.error_lo_m, m.error_hi_m)
    errors = s.speed_error_mps, s.rate_error_radps
    if max(errors) > 0.0:
        sound = landmark_off_max_sound(m.error_lo_m, m.error_hi_m, *errors, m.distance_max_m)
    else:
        sound = DwellTime(None, "bell2019 ch. 4, out of view", "exact velocities: the error does not grow")
    span = min(2.0 * sound.seconds, _LONGEST_S) if sound.seconds else 10.0
    found = point_stretches(rng, s.stretches, span, errors, m.distance_max_m, m.error_lo_m, speed)
    learned = landmark_off_max_learned(m.error_lo_m, m.error_hi_m, found.growths_mps().tolist())
    return {
        "landmark_first_visit": _row(first, first),
        "landmark_later_visits": _row(later, later),
        "landmark_out_of_view": _row(landmark_off_max(m.error_lo_m, m.error_hi_m, speed), sound, learned),
    }


def _target(
    s: StructureBounds, errors: TargetErrors, margin: float, speed: float, rng: np.random.Generator
) -> _Rows:
    """Chapter 5. ``repaired``: the printed theorems with what is wrong in them put right."""
    bounds = s.printed.model_dump()
    noise = bounds.pop("velocity_noise")
    printed = MovingTargetConstants.from_bounds(**bounds)
    repaired = MovingTargetConstants.from_bounds(**bounds, repaired=True, velocity_noise=noise)
    v0 = 0.5 * (
        errors.position_m**2 + errors.velocity_mps**2 + s.printed.gamma_inv_max * s.printed.weight_bound**2
    )
    sound = target_off_max_sound(errors, margin)
    longest = min(2.0 * sound.seconds + 1.0, _LONGEST_S) if sound.seconds else 10.0
    kept = target_stretches(rng, s.stretches, errors, margin, longest, speed)
    return {
        "target_before_learning": _row(
            moving_target_initial_max(printed, v0, margin), None, None,
            moving_target_initial_max(repaired, v0, margin),
        ),
        "target_out_of_view": _row(
            moving_target_off_max(printed, s.on_s, margin), sound, target_off_max_learned(kept.tolist()),
            moving_target_off_max(repaired, s.on_s, margin),
        ),
    }  # fmt: skip


def _row(
    published: DwellTime,
    sound: DwellTime | None,
    learned: DwellTime | None = None,
    repaired: DwellTime | None = None,
) -> dict[str, Any]:
    there = {"published": published, "repaired": repaired, "sound": sound, "learned": learned}
    return {name: time.as_dict() for name, time in there.items() if time is not None}


def _verdict(time: dict[str, Any], allowed_s: float | None) -> str:
    if time["seconds"] is None:
        return "unsatisfiable"
    if allowed_s is None:
        return "not asked for"
    return "certified" if time["seconds"] >= allowed_s else "not certified"
