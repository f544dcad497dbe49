r"""Premises of ``sound`` that contradict each other: a certificate from them is about no target and no estimator.

| symbol | name | unit | premise |
| --- | --- | --- | --- |
| W_bar sigma_bar + eps_bar | | 1/s | largest pose rate that the model can express; the class reaches norm(etadot) |
| W_bar | ``weight_bound`` | 1/s | bounds the learned weights too: no smaller than the projection's outer radius |
| sigma_bar | ``sigma_bar`` | | bounds norm(sigma) wherever the target is, at the kernels' centres too |

With etadot = W^T sigma + eps, norm(W) <= W_bar, norm(sigma) <= sigma_bar and norm(eps) <= eps_bar no target is faster
than W_bar sigma_bar + eps_bar; a class that is faster has no W within the bound (docs/theory.md, section 1).
"""

from __future__ import annotations

from camnet.certification.constants import EstimatorBounds

__all__ = ["contradictions"]

_SLACK = 1e-9


def contradictions(
    bounds: EstimatorBounds,
    *,
    v_max_mps: float,
    pose_rate: float,
    projection_radius: float,
    sigma_attained: float,
    ideal_radius: float | None = None,
) -> tuple[str, ...]:
    """Return the contradictions between the premises of ``sound``, in words; empty where there are none.

    Parameters
    ----------
    bounds : the premises
    v_max_mps : bound of the targets' speed, m/s
    pose_rate : bound of the norm of the pose's rate that the class allows, 1/s
    projection_radius : outer radius of the estimator's projection of the weights
    sigma_attained : largest norm of the basis that is known to occur
    ideal_radius : bound of the ideal weights where it is smaller than that of the learned ones: the projection keeps
        its promise for weights inside its inner radius only; None: the same
    """
    out = []
    ideal = bounds.weight_bound if ideal_radius is None else min(bounds.weight_bound, ideal_radius)
    fastest = ideal * bounds.sigma_bar + bounds.eps_bar
    if fastest < max(v_max_mps, pose_rate) * (1.0 - _SLACK):
        what = (
            f"v_max = {v_max_mps:g}" if fastest < v_max_mps else f"the class's pose rate {pose_rate:.4g} 1/s"
        )
        out.append(
            f"W_bar sigma_bar + eps_bar = {ideal:g} x {bounds.sigma_bar:.4g} + {bounds.eps_bar:g} = "
            f"{fastest:.4g} < {what}: no weights within the bound move the target that fast"
        )
    if bounds.weight_bound < projection_radius * (1.0 - _SLACK):
        out.append(
            f"certificate.weight_bound = {bounds.weight_bound:g} is below the outer radius {projection_radius:.4g} of "
            "the estimator's projection: the learned weights may be larger (lower estimator.weight_bound, or leave "
            "certificate.weight_bound out)"
        )
    if bounds.sigma_bar < sigma_attained * (1.0 - _SLACK):
        out.append(
            f"certificate.sigma_bar = {bounds.sigma_bar:g} is below norm(sigma) = {sigma_attained:.4g} at one of the "
            "kernels' centres"
        )
    if bounds.etadot_max < pose_rate * (1.0 - _SLACK):
        out.append(
            f"certificate.etadot_max = {bounds.etadot_max:g} is below the pose rate {pose_rate:.4g} 1/s that v_max and "
            "w_max allow"
        )
    return tuple(out)
