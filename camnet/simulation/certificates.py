"""The dwell-time certificates of a network, from its scenario."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry import Polygon

from camnet.certification.constants import EstimatorBounds
from camnet.certification.network import (
    DwellCertificates,
    NetworkGap,
    certify_dwell,
    dwell_report,
    estimator_bounds,
    pose_rate_bound,
    working_radius,
)
from camnet.certification.premises import contradictions
from camnet.errors import CertificateError
from camnet.estimation.concurrent_learning import LAYER_SHARE
from camnet.geometry.frustum import Frustum
from camnet.simulation.network import Network
from camnet.simulation.sound_settings import sampling_of, settings_outside

__all__ = [
    "feature_extent",
    "network_certificates",
    "network_gaps",
    "network_report",
    "premise_faults",
    "view_radius",
]


#: kernels at which the norm of the basis is evaluated, and other views that each view's gaps are listed to
_CENTRES, _NEIGHBOURS = 200, 16


def feature_extent(network: Network) -> float:
    """Largest distance of a target's feature from its reference point, ``max_i ||p_mi - p_m||``, m."""
    return max(float(np.linalg.norm(t.features_m, axis=1).max()) for t in network.description.targets)


def view_radius(network: Network, camera: int) -> float:
    """Radius of the ball about the target that fits a camera's view at working range, less the extent, m.

    Of an agent that may lose its pose it is ``R - e(T)``, so that ``V_hi = (R - e)^2 / 2``: where it believes its view
    to be, its view is, but for e(T) (`camnet.certification.outage`).

    Raises
    ------
    CertificateError
        e(T) leaves nothing of R.
    """
    whole, own = _whole_radius(network, camera), network.own_error_m(camera)
    if own >= whole:
        raise CertificateError(
            f"agent {network.regions[camera].name!r}: its own position may be off by {own:.3g} m at the end of an "
            "outage, and "
            f"its view holds a ball of {whole:.3g} m: shorten its outages or state tighter bounds (pose.bounds)"
        )
    return whole - own


def _whole_radius(network: Network, camera: int) -> float:
    """Radius R of a camera that knows where it is, m."""
    model = network.cameras[camera]
    range_m = network.scenario.certificate.working_range_m or _working_range(network, camera)
    half_angle = float(Frustum.from_camera(model).smallest_half_angle())
    return working_radius([half_angle], range_m, model.near_m, model.far_m, feature_extent(network))


def _working_range(network: Network, camera: int) -> float:
    """Distance at which a camera watches: from the middle of its flying height, else the middle of its range."""
    model = network.cameras[camera]
    middle = 0.5 * (model.near_m + model.far_m)
    if camera >= network.n_agents:
        return middle
    top = float(network.regions[camera].height[1]) - network.scenario.controller.region_margin_m
    return float(np.clip(top, 1.01 * model.near_m, middle))


def _bounds(network: Network) -> EstimatorBounds:
    """Premises of the certificates: gains of the estimator and bounds of the fastest target."""
    estimator = network.scenario.estimator
    return estimator_bounds(
        network.scenario.certificate,
        k=estimator.k1_per_s,
        kcl=estimator.kcl,
        gamma=estimator.gamma,
        alpha=estimator.alpha,
        window_s=estimator.stack.window_s,
        stack_size=estimator.stack.size,
        excitation=estimator.stack.excitation_threshold,
        weight_bound=_projection_radius(network),
        kernel_spacing_m=estimator.basis.spacing_m,
        kernel_width_m=estimator.basis.width_m,
        v_max_mps=max(t.v_max_mps for t in network.scenario.targets),
        w_max_radps=max(t.w_max_radps for t in network.scenario.targets),
        switching=estimator.switching,
        switching_gain=estimator.k2,
        boundary_layer=estimator.boundary_layer,
        sampling=sampling_of(network),
    )


def network_certificates(network: Network) -> DwellCertificates:
    """Both certificates' dwell times for the smallest view and the fastest target; ``sound`` has none if refused."""
    estimator, bounds = network.scenario.estimator, _bounds(network)
    radius = min(view_radius(network, j) for j in range(len(network.cameras)))
    pair = certify_dwell(
        bounds,
        radius,
        mobile=network.n_agents > 0,
        v_lo=network.scenario.certificate.v_lo,
        shared_model=estimator.share,
    )
    faults = premise_faults(network)
    if not faults:
        return pair
    refused = replace(pair.sound.constants, refusal="; ".join(faults))
    return replace(pair, sound=replace(pair.sound, constants=refused))


def premise_faults(network: Network) -> tuple[str, ...]:
    """Why ``sound`` is refused, in words: settings outside its proof, premises that contradict each other."""
    v_max = max(t.v_max_mps for t in network.scenario.targets)
    w_max = max(t.w_max_radps for t in network.scenario.targets)
    centres = network.basis.centres
    some = centres[
        :: max(1, len(centres) // _CENTRES)
    ]  # any of them will do: a lower bound of the largest norm
    delta = some[:, None] - centres
    kernels = np.exp(-0.5 * np.einsum("nki,kij,nkj->nk", delta, network.basis.precision, delta))
    return settings_outside(network) + contradictions(
        _bounds(network),
        v_max_mps=v_max,
        pose_rate=pose_rate_bound(v_max, w_max),
        projection_radius=_projection_radius(network),
        sigma_attained=float(np.linalg.norm(kernels, axis=1).max(initial=0.0)),
        ideal_radius=network.scenario.estimator.weight_bound,
    )


def _projection_radius(network: Network) -> float:
    return network.scenario.estimator.weight_bound * (1.0 + LAYER_SHARE)


def network_gaps(network: Network) -> list[NetworkGap]:
    """Distances on the ground between what each camera can see of targets and what its nearest neighbours can, m."""
    top = max(float(t.features_m[:, 2].max()) for t in network.description.targets)
    seen = [(region.name, Polygon(region.slab_outline(0.0, top))) for region in network.regions]
    names, shapes = [name for name, _ in seen], np.array([shape for _, shape in seen], dtype=object)
    out = []
    for i in np.flatnonzero(~shapely.is_empty(shapes)).tolist():
        away = np.where(shapely.is_empty(shapes), np.inf, shapely.distance(shapes[i], shapes))
        away[i] = np.inf
        near = np.sort(np.argsort(away, kind="stable")[:_NEIGHBOURS])
        for j in near[np.isfinite(away[near])].tolist():
            overlap = _overlap_m(shapes[i], shapes[j]) if away[j] == 0.0 else 0.0
            out.append(NetworkGap(names[i], names[j], float(away[j]), overlap))
    return out


def _overlap_m(a: Polygon, b: Polygon) -> float:
    """How deep inside b one can be on the border of a, m: where a target leaves a while it is in b."""
    shared = a.exterior.intersection(b)
    if shared.is_empty or shared.length == 0.0:
        return 0.0
    places = shapely.get_coordinates(shapely.segmentize(shared, max(0.01, shared.length / 256.0)))
    return float(shapely.distance(shapely.points(places), b.exterior).max())


def network_report(network: Network) -> dict[str, object]:
    """Return the dwell-time report of ``camnet certify``."""
    return dwell_report(
        network_certificates(network),
        v_max_mps=max(t.v_max_mps for t in network.scenario.targets),
        extent_m=feature_extent(network),
        gaps=network_gaps(network),
        faults=premise_faults(network),
    )
