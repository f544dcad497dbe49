"""Mounts as GeoJSON: the same as those of a table; whatever is no mount is refused."""

import json

import pymap3d
import pytest

from camnet.errors import DataError
from camnet.importers.geodesy import Origin
from camnet.importers.geojson_mounts import read_geojson_mounts
from camnet.importers.mounts import read_mounts

_ROWS = [("pole", 12.5, -3.25, 5.0, 30.0), ("roof", 240.0, 90.0, 11.0, 0.0)]


def _file(tmp_path, features):
    path = tmp_path / "m.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def _point(coordinates, **properties):
    geometry = {"type": "Point", "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def test_points_are_the_mounts_of_a_table(tmp_path):
    table = tmp_path / "m.csv"
    lines = (f"{n},{x},{y},{z},-90,45,10,60,{c}" for n, x, y, z, c in _ROWS)
    table.write_text("name,x,y,z,pan_min,pan_max,tilt_min,tilt_max,cost\n" + "\n".join(lines) + "\n")
    angles = {"pan_min": -90, "pan_max": 45, "tilt_min": 10, "tilt_max": 60}
    metres = [_point([x, y, z], name=n, cost=c, **angles) for n, x, y, z, c in _ROWS]
    assert read_geojson_mounts(_file(tmp_path, metres), None) == read_mounts(table)
    origin = Origin(48.2, 16.37, 170.0)
    degrees = []
    for n, x, y, z, c in _ROWS:
        lat, lon, _ = pymap3d.enu2geodetic(x, y, 0.0, 48.2, 16.37, 170.0)
        degrees.append(_point([lon, lat], name=n, height=z, cost=c, **angles))
    for own, other in zip(
        read_geojson_mounts(_file(tmp_path, degrees), origin), read_mounts(table), strict=True
    ):
        assert (own.x_m, own.y_m) == pytest.approx((other.x_m, other.y_m), abs=0.01)
        assert (own.name, own.z_m, own.pan_deg, own.tilt_deg) == (
            other.name,
            other.z_m,
            other.pan_deg,
            other.tilt_deg,
        )


def _along(kind, coordinates, **said):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": said}


def test_walls_and_roofs_have_mounts_along_them(tmp_path):
    wall = _along("LineString", [[0, 0], [6, 0], [6, 4]], name="wall", height=4, pan_min=90, pan_max=270)
    roof = _along(
        "Polygon", [[[0, 0], [8, 0], [8, 8], [0, 8], [0, 0]]], name="roof", height=9, spacing=4, cost=50
    )
    found = read_geojson_mounts(_file(tmp_path, [wall, roof]), None)
    assert [(m.x_m, m.y_m) for m in found[:6]] == [(0, 0), (2, 0), (4, 0), (6, 0), (6, 2), (6, 4)]
    assert {(m.z_m, m.pan_deg, m.cost) for m in found[:6]} == {(4.0, (90.0, 270.0), 0.0)}
    assert [m.name for m in found[6:]] == [f"roof {k}" for k in range(1, 9)]
    assert {(m.x_m, m.y_m) for m in found[6:]} == {(x, y) for x in (0, 4, 8) for y in (0, 4, 8)} - {(4, 4)}
    assert {(m.z_m, m.cost) for m in found[6:]} == {(9.0, 50.0)}


@pytest.mark.parametrize(
    ("features", "advice"),
    [
        ([], "points, lines or polygons"),
        ([_point([1.0, 2.0], name="a")], "no height"),
        ([_point([1.0, 2.0, 5.0])], "name is ''"),
        ([_point([1.0, 2.0, 5.0], name="a")] * 2, "no other feature"),
        ([_point([1.0], name="a", height=3)], "finite numbers"),
        ([_point([1.0, 2.0], name="a", height="high")], "z is 'high'"),
        ([_point([1.0, 2.0], name="a", height=3, tilt_max=100)], "-90 to 90"),
        (
            [{"type": "Feature", "geometry": {"type": "MultiPoint", "coordinates": []}}],
            "a point, line or polygon",
        ),
        ([_along("LineString", [], name="a", height=3)], "of 2 to"),
        ([_along("LineString", [[0, 0], [4, 0]], name="a")], "no height"),
        ([_along("LineString", [[0, 0], [4, 0]], height=3)], "name is ''"),
        ([_along("LineString", [[0, 0], [0, 0]], name="a", height=3)], "between 1 and"),
        ([_along("LineString", [[0, 0], [4, 0]], name="a", height=3, spacing=0)], "metres above 0"),
        ([_along("LineString", [[0, 0], [4, 0]], name="a", height=3, spacing=1e-9)], "between 1 and"),
        ([_along("Polygon", [[0, 0], [4, 0], [4, 4]], name="a", height=3)], "finite numbers"),
    ],
)
def test_what_is_no_mount_is_refused(tmp_path, features, advice):
    with pytest.raises(DataError, match=advice):
        read_geojson_mounts(_file(tmp_path, features), None)
