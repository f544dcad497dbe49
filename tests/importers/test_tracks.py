from __future__ import annotations

import gzip
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camnet.errors import DataError
from camnet.importers.geodesy import enu_from_geodetic
from camnet.importers.tracks import Origin, Track, TrackOptions, load_tracks, only_track, read_tracks
from camnet.motion.settings import TrackTarget

SITE = Origin(39.04977294, -85.52924953, 205.0)
CSV = "id,t,x,y\na,0,1,2\na,1,2,3\nb,0,5,5\n"
GPX = """<?xml version="1.0"?>
<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1" creator="t"><trk><name>a</name><trkseg>
<trkpt lat="39.05" lon="-85.529"><ele>210</ele><time>2018-03-11T18:20:06Z</time></trkpt>
<trkpt lat="39.0501" lon="-85.529"><ele>215</ele><time>2018-03-11T18:20:16Z</time></trkpt>
</trkseg></trk></gpx>
"""
ETH = "0 1.0 1.5 2.5\n10 1.0 2.5 2.5\n0 2.0 0 0\n"
FCD = """<?xml version="1.0"?>
<fcd-export>
<timestep time="0.00"><vehicle id="v" x="1" y="2" angle="90" type="t" speed="3" lane="l"/></timestep>
<timestep time="1.00"><vehicle id="v" x="4" y="2" angle="0" type="t" speed="3" lane="l"/></timestep>
</fcd-export>
"""
SAMPLES = {"csv": CSV, "gpx": GPX, "eth": ETH, "fcd": FCD}


def written(folder: Path, text: str, name: str = "file.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


# ------------------------------------------------------------------ geodesy


def radii_of_curvature(latitude_rad: float) -> tuple[float, float]:
    """Meridian and prime-vertical radii of WGS84, by hand."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    w = math.sqrt(1 - e2 * math.sin(latitude_rad) ** 2)
    return a * (1 - e2) / w**3, a / w


@given(
    st.floats(-80, 80),
    st.floats(-179, 179),
    st.floats(-0.004, 0.004),
    st.floats(-0.004, 0.004),
    st.floats(-50, 50),
)
def test_small_offsets_follow_the_radii_of_curvature(
    lat: float, lon: float, dlat: float, dlon: float, h: float
) -> None:
    origin = Origin(lat, lon, 100.0)
    enu = enu_from_geodetic(np.array([lat + dlat]), np.array([lon + dlon]), np.array([100.0 + h]), origin)[0]
    m, n = radii_of_curvature(math.radians(lat))
    east = (n + 100 + h) * math.cos(math.radians(lat + dlat)) * math.radians(dlon)
    north = (m + 100 + h) * math.radians(dlat)
    # second-order terms: meridian convergence in north, curvature in up
    north += 0.5 * n * math.sin(math.radians(lat)) * math.cos(math.radians(lat)) * math.radians(dlon) ** 2
    up = h - (east**2 + north**2) / 2 / 6.371e6
    np.testing.assert_allclose(enu, [east, north, up], atol=2e-3)


def test_cameras_and_people_of_one_site_share_its_frame(shared_data: Path) -> None:
    tracks = read_tracks(shared_data / "meva/tracks.csv.gz", "csv", TrackOptions(SITE))
    assert len(tracks) == 53
    assert sum(track.t_s.size for track in tracks) == 130369
    everywhere = np.vstack([track.p_world for track in tracks])
    assert np.median(np.hypot(everywhere[:, 0], everywhere[:, 1])) < 150
    assert np.all(everywhere[:, 2] == 0.0)


# ------------------------------------------------------------------ formats


@pytest.mark.parametrize("format", SAMPLES)
def test_every_format_gives_increasing_frozen_tracks(tmp_path: Path, format: str) -> None:
    plain = read_tracks(written(tmp_path, SAMPLES[format]), format, TrackOptions(SITE))  # type: ignore[arg-type]
    packed = tmp_path / "file.txt.gz"
    packed.write_bytes(gzip.compress(SAMPLES[format].encode()))
    unpacked = read_tracks(packed, format, TrackOptions(SITE))  # type: ignore[arg-type]
    assert [t.id for t in plain] == [t.id for t in unpacked]
    for one, two in zip(plain, unpacked, strict=True):
        assert np.all(np.diff(one.t_s) > 0)
        assert not one.p_world.flags.writeable
        np.testing.assert_array_equal(one.p_world, two.p_world)


def test_csv_values_land_in_their_columns(tmp_path: Path) -> None:
    a, b = read_tracks(written(tmp_path, CSV), "csv", TrackOptions(height_m=0.5))
    np.testing.assert_array_equal(a.p_world, [[1, 2, 0.5], [2, 3, 0.5]])
    np.testing.assert_array_equal(b.t_s, [0])
    text = "Y;TIME;X;junk;z_m\n2;2020-01-01T00:00:01+01:00;1;?;7\n3;2020-01-01T00:00:02+01:00;1;?;7\n"
    (only,) = read_tracks(written(tmp_path, text, "walk.csv"), "csv")
    assert only.id == "walk"
    np.testing.assert_array_equal(only.t_s, [1577833201, 1577833202])
    np.testing.assert_array_equal(only.p_world[0], [1, 2, 7])


def test_fcd_angles_turn_from_compass_to_mathematics(tmp_path: Path) -> None:
    (track,) = read_tracks(written(tmp_path, FCD), "fcd")
    np.testing.assert_allclose(track.heading_rad, [0.0, math.pi / 2])
    np.testing.assert_array_equal(track.speed_mps, [3, 3])


def test_eth_frames_become_seconds(tmp_path: Path, shared_data: Path) -> None:
    one, _ = read_tracks(written(tmp_path, ETH), "eth")
    np.testing.assert_allclose(one.t_s, [0, 0.4])
    for path in (shared_data / "ethucy").glob("*.txt"):
        tracks = read_tracks(path, "eth", TrackOptions(min_fixes=2))
        steps = np.concatenate(
            [np.linalg.norm(np.diff(t.p_world, axis=0), axis=1) / np.diff(t.t_s) for t in tracks]
        )
        # people walk; the published biwi_eth file runs fast, its frame step is not the 0.4 s of the others
        assert 0.2 < np.median(steps) < (2.0 if path.stem != "biwi_eth" else 3.0)


def test_gpx_sample_agrees_with_the_csv_of_the_same_site(shared_data: Path) -> None:
    gpx = read_tracks(shared_data / "meva/sample.gpx", "gpx", TrackOptions(SITE))
    csv = {t.id: t for t in read_tracks(shared_data / "meva/tracks.csv.gz", "csv", TrackOptions(SITE))}
    common = [(t, csv[t.id]) for t in gpx if t.id in csv]
    assert common
    gaps = []
    for short, long in common:
        inside = (short.t_s >= long.t_s[0]) & (short.t_s <= long.t_s[-1])
        there = np.column_stack([np.interp(short.t_s[inside], long.t_s, long.p_world[:, k]) for k in (0, 1)])
        gaps += np.linalg.norm(there - short.p_world[inside, :2], axis=1).tolist()
    assert len(gaps) > 100
    assert np.median(gaps) < 3.0


def test_gpx_heights_are_used_on_request_only(tmp_path: Path) -> None:
    path = written(tmp_path, GPX)
    (flat,) = read_tracks(path, "gpx", TrackOptions(SITE, height_m=1.0))
    (high,) = read_tracks(path, "gpx", TrackOptions(SITE, use_altitude=True))
    np.testing.assert_array_equal(flat.p_world[:, 2], [1, 1])
    np.testing.assert_allclose(high.p_world[:, 2], [5, 10], atol=0.01)


# ------------------------------------------------------------------ cleaning


def test_rows_are_sorted_and_repeated_times_dropped(tmp_path: Path) -> None:
    text = "t,x,y\n2,20,0\n0,0,0\n2,29,0\n1,10,0\n"
    (track,) = read_tracks(written(tmp_path, text), "csv")
    np.testing.assert_array_equal(track.p_world[:, 0], [0, 10, 20])
    with pytest.raises(DataError, match=r"steps back in time from 2\.0 to 0\.0 s"):
        read_tracks(written(tmp_path, text), "csv", TrackOptions(order="error"))
    with pytest.raises(
        DataError, match=r"two places at 2 s, 79 m apart; different targets need different names"
    ):
        read_tracks(written(tmp_path, text.replace("29", "99")), "csv")


@given(st.lists(st.floats(0.1, 50), min_size=1, max_size=40), st.floats(1, 30))
def test_splitting_keeps_every_fix_and_leaves_no_long_gap(
    tmp_path_factory: pytest.TempPathFactory, steps: list[float], limit: float
) -> None:
    times = np.cumsum(steps)
    text = "t,x,y\n" + "".join(f"{t!r},{k},0\n" for k, t in enumerate(times.tolist()))
    tracks = read_tracks(written(tmp_path_factory.mktemp("s"), text), "csv", TrackOptions(max_gap_s=limit))
    np.testing.assert_array_equal(np.concatenate([t.t_s for t in tracks]), times)
    assert all(np.all(np.diff(t.t_s) <= limit) for t in tracks)
    assert all(b.t_s[0] - a.t_s[-1] > limit for a, b in pairwise(tracks))


def test_settings_choose_identity_and_name_the_others(tmp_path: Path) -> None:
    written(tmp_path, CSV)
    settings = TrackTarget(kind="track", file=Path("file.txt"), id="a")
    assert only_track(load_tracks(settings, tmp_path), "file.txt").id == "a"
    pieces = load_tracks(settings, tmp_path, max_gap_s=0.5)
    assert [piece.id for piece in pieces] == ["a#1", "a#2"]
    with pytest.raises(DataError, match=r"no track 'c'; it has a, b"):
        load_tracks(settings.model_copy(update={"id": "c"}), tmp_path)
    with pytest.raises(DataError, match="holds 2 tracks where one was expected; choose an id: a, b"):
        only_track(load_tracks(settings.model_copy(update={"id": None}), tmp_path), "file.txt")


# ------------------------------------------------------------------ faults

FAULTS = [
    ("csv", CSV, "", r"file\.txt: is empty"),
    ("csv", CSV, "id,t,x,y\n", r"holds no track"),
    ("csv", "id,t,x,y", "id,tt,x,y", r"line 1: no time among the columns \['id', 'tt', 'x', 'y'\]"),
    ("csv", "id,t,x,y", "id,t,x,q", r"line 1: no position among"),
    ("csv", "id,t,x,y", "id,t,x,x", r"line 1: the columns 'x' and 'x' mean the same"),
    ("csv", "a,1,2,3", "a,1,2", r"line 3: 3 fields 'a,1,2'; the header has 4"),
    ("csv", "a,1,2,3", "a,1,two,3", r"line 3: x is 'two'; a decimal number"),
    ("csv", "a,1,2,3", "a,1,inf,3", r"line 3: x is 'inf'; a finite number"),
    ("csv", "a,1,2,3", "a,yesterday,2,3", r"line 3: t is 'yesterday'"),
    ("csv", "a,1,2,3", "a,2018-13-01,2,3", r"line 3: t is '2018-13-01'; seconds or a time such as"),
    ("csv", "a,1,2,3", ",1,2,3", r"line 3: the identity is ''"),
    ("csv", "a,1,2,3", 'a,1,"2,3', r"line \d: not a CSV row"),
    ("csv", CSV, "id,t,lat,lon\na,0,91,0\n", r"line 2: lat is '91'; -90 to 90 degrees"),
    ("csv", CSV, "id,t,lat,lon\na,0,9,-181\n", r"line 2: lon is '-181'; -180 to 180 degrees"),
    ("gpx", "<gpx ", "<kml ", r"not well-formed|outermost element is <kml>; <gpx> was expected"),
    ("gpx", 'lat="39.05" ', "", r"line 3: <trkpt> has no lat"),
    ("gpx", 'lat="39.05"', 'lat="139.05"', r"line 3: lat is '139.05'"),
    ("gpx", "<time>2018-03-11T18:20:06Z</time>", "", r"line 3: <trkpt> has no <time>"),
    ("gpx", "2018-03-11T18:20:06Z", "noon", r"line 3: <time> is 'noon'"),
    ("gpx", "</trk>", "", r"not well-formed XML \(mismatched tag\)"),
    ("gpx", "<trk>", "<rte>", r"not well-formed|no track point"),
    ("gpx", GPX, '<!DOCTYPE g [<!ENTITY a "b">]><gpx/>', r"line 1: declares the entity 'a'"),
    ("gpx", GPX, "<gpx/>", r"has no track point"),
    ("eth", "10 1.0 2.5 2.5", "10 1.0 2.5", r"line 2: 3 fields '10 1.0 2.5'; frame, identity, x and y"),
    ("eth", "10 1.0 2.5 2.5", "10 1.0 2.5 y", r"line 2: y is 'y'"),
    ("fcd", 'x="1"', 'x="east"', r"line 3: x is 'east'"),
    ("fcd", 'x="1" ', "", r"line 3: <vehicle> has no attribute x; it has id, y, angle"),
    ("fcd", 'time="0.00"', "", r"line 3: <timestep> has no attribute time; it has none"),
    ("fcd", FCD, "<fcd-export/>", r"has no vehicle"),
    ("fcd", FCD, '<fcd-export><vehicle id="v"/></fcd-export>', r"stands outside of a <timestep>"),
]


@pytest.mark.parametrize(("format", "old", "new", "message"), FAULTS)
def test_a_wrong_file_is_named_quoted_and_corrected(
    tmp_path: Path, format: str, old: str, new: str, message: str
) -> None:
    assert old in SAMPLES[format]
    path = written(tmp_path, SAMPLES[format].replace(old, new, 1))
    with pytest.raises(DataError, match=message) as caught:
        read_tracks(path, format, TrackOptions(SITE))  # type: ignore[arg-type]
    assert str(path) in str(caught.value)


def test_latitudes_need_an_origin(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no origin was given"):
        read_tracks(written(tmp_path, GPX), "gpx")
    with pytest.raises(DataError, match=r"origin latitude is 91"):
        Origin(91.0, 0.0)
    with pytest.raises(DataError, match=r"origin longitude is 200"):
        Origin(0.0, 200.0)


def test_unreadable_files_are_data_errors(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_tracks(tmp_path / "none.csv", "csv")
    broken = tmp_path / "b.csv.gz"
    broken.write_bytes(b"not gzip")
    with pytest.raises(DataError, match="not a whole gzip file"):
        read_tracks(broken, "csv")
    broken.write_bytes(gzip.compress(CSV.encode())[:-12])
    with pytest.raises(DataError, match="not a whole gzip file"):
        read_tracks(broken, "csv")
    with pytest.raises(DataError, match="format 'kml' is unknown; one of csv, gpx, fcd, eth"):
        read_tracks(tmp_path, "kml")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="max_gap_s is -1"):
        TrackOptions(max_gap_s=-1)


@pytest.mark.parametrize(
    ("t_s", "p_world", "message"),
    [
        ([], np.empty((0, 3)), "holds no fix"),
        ([0, 1], [[0, 0, 0]], r"p_world has shape \(1, 3\); \(2, 3\) was expected"),
        ([0, 0], [[0, 0, 0]] * 2, r"t_s\[1\] = 0.0 does not follow 0.0"),
        ([0, np.nan], [[0, 0, 0]] * 2, r"t_s\[1\] is nan"),
        ([0, 1], [[0, 0, 0], [0, np.inf, 0]], r"p_world\[1\] is .*inf"),
    ],
)
def test_a_track_checks_its_arrays(t_s: list[float], p_world: object, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Track("a", np.array(t_s), np.array(p_world))
