"""The base class of every settings object: strict, immutable, with units in the field names.

Every sub-package keeps its own settings (``camnet.estimation.settings`` and so on) with its defaults;
``camnet.config`` puts them together and reads them from YAML.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = [
    "Finite",
    "Fraction",
    "NonNegative",
    "Positive",
    "Quaternion",
    "Seed",
    "Settings",
    "Vector2",
    "Vector3",
]

#: largest magnitude of any setting, in the SI unit or pixels that its name says
_LARGEST = 1e9
Positive = Annotated[float, Field(gt=0, le=_LARGEST, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=_LARGEST, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
#: seeds that every generator here takes (NumPy's, Numba's, JSON readers' exact integers)
Seed = Annotated[int, Field(ge=0, lt=2**53)]
Vector2 = tuple[Finite, Finite]
Vector3 = tuple[Finite, Finite, Finite]
#: unit quaternion, Hamilton, scalar first
Quaternion = tuple[Finite, Finite, Finite, Finite]


class Settings(BaseModel):
    """Base of all settings: unknown keys are errors, values are frozen, strings are never taken for numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, str_strip_whitespace=True)
