"""Settings of the learning estimator, its basis, its history stack and the remedies of the gap problem."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from camnet.settings import Fraction, NonNegative, Positive, Settings

__all__ = ["BasisSettings", "EstimatorSettings", "GapSettings", "StackSettings"]


class BasisSettings(Settings):
    """Radial basis functions over position (and heading), placed by ``placement``.

    ``road``: along the roads of the world and their margins; ``grid``: over the bounding box of all regions.
    """

    placement: Literal["auto", "grid", "road"] = "auto"
    inputs: Literal["position", "position_heading"] = "position"
    spacing_m: Positive = 0.5
    width_m: Positive = 0.5
    margin_m: NonNegative = 1.0
    max_kernels: Annotated[int, Field(gt=0)] = 400


class StackSettings(Settings):
    """History stack: ``size`` windows of ``window_s``; ``rule`` chooses which to keep (spec 01)."""

    size: Annotated[int, Field(gt=0)] = 600
    window_s: Positive = 0.2
    rule: Literal["lambda_min", "d_optimal"] = "d_optimal"
    excitation_threshold: Positive = 1e-3
    regularisation: Positive = 1e-3


class GapSettings(Settings):
    """Remedies of the gap problem (spec 01): what carries the prediction where nothing was measured."""

    prior: Literal["none", "constant_velocity", "constant_turn"] = "constant_turn"
    learn_across: bool = True


class EstimatorSettings(Settings):
    """Update laws (3-6)-(3-12), (4-16)-(4-20): gains ``k1_per_s``, ``k2``, ``kcl``, ``gamma``, mix ``alpha``.

    ``form: twist`` learns [v; w] and multiplies by B(q); ``stacked`` learns the seven rates of the papers.
    """

    form: Literal["twist", "stacked"] = "twist"
    k1_per_s: Positive = 3.0
    k2: NonNegative = 0.1
    kcl: Positive = 1.0
    gamma: Positive = 1.0
    alpha: Fraction = 1.0
    switching: Literal["sign", "sat", "tanh"] = "tanh"
    boundary_layer: Positive = 0.05
    weight_bound: Positive = 20.0
    basis: BasisSettings = BasisSettings()
    stack: StackSettings = StackSettings()
    gap: GapSettings = GapSettings()
