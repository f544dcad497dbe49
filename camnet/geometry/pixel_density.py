"""Pixels per metre at a place, and the classes of EN 62676-4:2015 (video surveillance systems, part 4, annex B).

| symbol | name | unit | meaning |
| --- | --- | --- | --- |
| f | ``focal_px`` | px | the smaller focal length of the intrinsics |
| z | ``depth_m`` | m | distance of the place along the optical axis |
| f / z | | px/m | pixels on a metre that is perpendicular to the line of sight |

Of all directions perpendicular to the line of sight the one around the optical axis gets the fewest pixels, f / z; the
one away from it gets f / (z cos theta), theta the angle off the axis. So f / z is what every such metre has at least,
and the places with at least d px/m are those nearer than the plane z = f / d. Lens distortion is left out of it.
"""

from __future__ import annotations

from camnet.errors import ConfigError
from camnet.geometry.pixel_classes import PIXEL_CLASSES
from camnet.geometry.settings import CameraModel, Intrinsics

__all__ = ["class_range_m", "focal_px", "pixels_per_metre", "with_class_range"]


def focal_px(intrinsics: Intrinsics) -> float:
    """Return the smaller of both focal lengths, px."""
    return min(intrinsics.fx_px, intrinsics.fy_px)


def pixels_per_metre(name: str) -> float:
    """Return the least px/m of a class; ConfigError where there is no such class."""
    if name not in PIXEL_CLASSES:
        raise ConfigError(f"class {name!r} is unknown: give one of {', '.join(PIXEL_CLASSES)}")
    return PIXEL_CLASSES[name]


def class_range_m(intrinsics: Intrinsics, name: str) -> float:
    """Return the distance along the optical axis up to which a camera has the pixels of a class, m."""
    return focal_px(intrinsics) / pixels_per_metre(name)


def with_class_range(camera: CameraModel, name: str) -> CameraModel:
    """Return a camera whose far range ends where the class does, or where its own does if that is nearer.

    Raises
    ------
    ConfigError
        The class ends before the camera's near range.
    """
    reach = class_range_m(camera.intrinsics, name)
    if not camera.near_m < reach:
        raise ConfigError(
            f"class {name!r}: camera {camera.name!r} has {pixels_per_metre(name):g} px/m up to {reach:.3g} m only, and "
            f"its view begins at near_m {camera.near_m:g}: it never sees anything in this class"
        )
    return camera.model_copy(update={"far_m": min(camera.far_m, reach)})
