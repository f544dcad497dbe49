"""Catalogues of cameras that a design may choose from: lens, resolution and price, as strict YAML.

A camera's focal length is width / (2 tan(fov / 2)) pixels, and it sees as far as it has the pixels per metre that are
asked for (``geometry.pixel_density``).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import Field

import camnet
from camnet.config.diagnose import Problem, raise_problems, show, validate
from camnet.config.yaml_nodes import Origin, parse_yaml
from camnet.errors import ConfigError, DataError
from camnet.geometry.settings import CameraModel, Intrinsics
from camnet.settings import Positive, Settings
from camnet.storage.reading import read_bounded

__all__ = ["Catalogue", "CatalogueCamera", "load_catalogue"]

#: the catalogue that ships
_SHIPPED = Path(camnet.__file__).parent / "worlds" / "cameras.yaml"
_MOST_BYTES = 1_000_000


class CatalogueCamera(Settings):
    """One kind of camera: image size, angle of view across it, price, and what it can be focused on.

    ``far_m`` caps the range that follows from the pixels.
    """

    name: Annotated[str, Field(min_length=1)]
    width_px: Annotated[int, Field(gt=0, le=20_000)]
    height_px: Annotated[int, Field(gt=0, le=20_000)]
    fov_deg: Annotated[float, Field(ge=1.0, le=160.0)]
    price: Positive
    near_m: Positive = 0.5
    far_m: Positive | None = None

    def model(self, pixels_per_m: float) -> CameraModel:
        """Return the camera as a world's model, with the range at which it has ``pixels_per_m``.

        Raises
        ------
        ConfigError
            That range is not beyond its near range.
        """
        focal = round(0.5 * self.width_px / math.tan(math.radians(0.5 * self.fov_deg)), 3)
        far = min(focal / pixels_per_m, math.inf if self.far_m is None else self.far_m)
        if far <= self.near_m:
            raise ConfigError(
                f"camera {self.name!r} has {pixels_per_m:g} px/m up to {far:.3g} m only, nearer than its near_m = "
                f"{self.near_m:g}: leave it out of the catalogue or ask for fewer pixels per metre"
            )
        intrinsics = Intrinsics(
            width_px=self.width_px,
            height_px=self.height_px,
            fx_px=focal,
            fy_px=focal,
            cx_px=0.5 * self.width_px,
            cy_px=0.5 * self.height_px,
        )
        return CameraModel(
            name=self.name, intrinsics=intrinsics, near_m=self.near_m, far_m=math.floor(1e3 * far) / 1e3
        )


class Catalogue(Settings):
    """The cameras of a catalogue."""

    cameras: Annotated[tuple[CatalogueCamera, ...], Field(min_length=1, max_length=100)]


def load_catalogue(path: Path | None = None) -> tuple[CatalogueCamera, ...]:
    """Read a catalogue; None: the one that ships.

    Raises
    ------
    ConfigError
        With file, line, field, value and advice for every problem found.
    """
    path = _SHIPPED if path is None else path
    try:
        text = read_bounded(path, _MOST_BYTES).decode("utf-8-sig")
    except (DataError, UnicodeDecodeError) as error:
        raise ConfigError(f"catalogue {path}: {error}") from None
    root = parse_yaml(text, Origin(str(path), 1, path.parent))
    if not isinstance(root.value, dict):
        raise ConfigError(
            f"{path}: value {root.plain()!r}: a list of cameras under the key 'cameras' was expected"
        )
    cameras = validate(Catalogue, root).cameras
    names = [camera.name for camera in cameras]
    twice = (
        Problem(("cameras", k, "name"), show(name), "there twice: names are unique")
        for k, name in enumerate(names)
        if name in names[:k]
    )
    raise_problems(twice, root)
    return cameras
