"""Settings of the correlation tracker; the defaults are those of li2019, section V.C."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from camnet.settings import NonNegative, Positive, Settings

__all__ = ["CorrelationSettings", "ScaleSettings"]

_Rate = Annotated[float, Field(gt=0, le=1)]


class ScaleSettings(Settings):
    """The one-dimensional filter over the target's size.

    ``scales`` patches are taken, at steps chosen so that they span the same range as ``interpolated_scales`` steps of
    ``step``. ``model_area_px`` bounds the size to which each is brought.
    """

    scales: Annotated[int, Field(ge=3, le=101)] = 17
    interpolated_scales: Annotated[int, Field(ge=3, le=201)] = 33
    step: Annotated[float, Field(gt=1, le=1.2)] = 1.02
    sigma_factor: Positive = 1.0 / 16.0
    regularisation: Positive = 0.01
    learning_rate: _Rate = 0.025
    cell_px: Annotated[int, Field(ge=1, le=4)] = 2
    model_area_px: Annotated[int, Field(ge=64, le=16384)] = 512


class CorrelationSettings(Settings):
    """The two-dimensional filter over the target's place.

    ``padding`` is the width of the context relative to the target, so that the patch is ``1 + padding`` targets wide;
    ``sigma_factor`` the width of the wanted response relative to the target. The patch is brought to a
    size at which the target has an area between ``min_target_px`` and ``max_target_px``. Below a
    peak-to-sidelobe ratio of ``min_psr`` the target counts as lost: nothing is learnt and the box stays where it was
    sought.
    """

    padding: Annotated[float, Field(gt=0, le=8)] = 2.0
    cell_px: Annotated[int, Field(ge=1, le=4)] = 4
    components: Annotated[int, Field(ge=1, le=31)] = 18
    sigma_factor: Positive = 1.0 / 16.0
    regularisation: Positive = 0.01
    learning_rate: _Rate = 0.025
    min_target_px: Annotated[int, Field(ge=64)] = 400
    max_target_px: Annotated[int, Field(ge=256, le=1_000_000)] = 10_000
    min_psr: NonNegative = 15.0
    scale: ScaleSettings = ScaleSettings()
