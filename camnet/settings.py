"""The base class of every settings object: strict, immutable, with units in the field names.

Every sub-package keeps its own settings (``camnet.estimation.settings`` and so on) with its defaults;
``camnet.config`` puts them together and reads them from YAML.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = [
    "Fraction",
    "NonNegative",
    "Positive",
    "Quaternion",
    "Settings",
    "Vector2",
    "Vector3",
]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector2 = tuple[_Finite, _Finite]
Vector3 = tuple[_Finite, _Finite, _Finite]
#: unit quaternion, Hamilton, scalar first
Quaternion = tuple[_Finite, _Finite, _Finite, _Finite]


class Settings(BaseModel):
    """Base of all settings: unknown keys are errors, values are frozen, strings are never taken for numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, str_strip_whitespace=True)
