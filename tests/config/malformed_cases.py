"""Malformed inputs as data: the loader's tests and the command line's go through the same table."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

WORLD = """\
name: yard
cameras:
  - name: lens
    intrinsics: {width_px: 640, height_px: 480, fx_px: 420.0, fy_px: 420.0, cx_px: 320.0, cy_px: 240.0}
    near_m: 0.3
    far_m: 8.0
regions:
  - name: east
    shape: {type: box, min_m: [2.0, -2.0, 0.0], max_m: [6.0, 2.0, 3.5]}
  - name: west
    shape: {type: box, min_m: [-6.0, -2.0, 0.0], max_m: [-2.0, 2.0, 3.5]}
agents:
  - {name: camera_0, region: east, camera: lens, start_m: [4.0, 0.0, 2.5]}
  - {name: camera_1, region: west, camera: lens, start_m: [-4.0, 0.0, 2.5]}
occluders:
  - name: crate
    shape: {type: cylinder, center_m: [0.0, 0.0], radius_m: 0.5, z_m: [0.0, 1.0]}
roads:
  - name: loop
    closed: true
    points_m: [[4.0, -1.0], [4.0, 1.0], [-4.0, 1.0], [-4.0, -1.0]]
targets:
  - name: robot
    motion: {kind: vector_field, field: loop, road: loop, speed_mps: 0.3}
    start_m: [4.0, -1.0]
    start_heading_rad: 1.57
run: {duration_s: 60}
"""

TRACK_WORLD = WORLD.replace(
    "{kind: vector_field, field: loop, road: loop, speed_mps: 0.3}", "{kind: track, file: walk.csv, id: a}"
)
TRACK = "id,t_s,x_m,y_m\na,0,4,0\na,1,4.5,0\na,2,5,0\n"

GPX_WORLD = TRACK_WORLD.replace(
    "file: walk.csv, id: a", "file: walk.gpx, format: gpx, origin: [44.0, 11.0, 50.0]"
)
GPX = """\
<gpx version="1.1" creator="x"><trk><name>a</name><trkseg>
<trkpt lat="44.0001" lon="11.0001"><time>2020-01-01T00:00:00Z</time></trkpt>
<trkpt lat="44.0002" lon="11.0001"><time>2020-01-01T00:00:10Z</time></trkpt>
</trkseg></trk></gpx>
"""

SITE = """\
name: site
kind: recorded
tracks: {file: people.csv}
origin: {latitude_deg: 44.0, longitude_deg: 11.0, altitude_m: 50.0}
"""
KRTD = """\
1500 0 960
0 1500 540
0 0 1

1 0 0
0 0 -1
0 1 0

0 3 0

-0.1 0.01 0 0 0
"""
PEOPLE = "id,t,lat,lon\na,0,44.0001,11.0\na,10,44.0002,11.0\n"


@dataclass(frozen=True)
class MalformedCase:
    """Files to write into an empty folder, what to load from it, and what the message must mention.

    ``source`` is a file of that folder or, when there is none of that name, a shipped world's name.
    ``{folder}`` in overrides is that folder.
    """

    id: str
    mentions: tuple[str, ...]
    files: dict[str, str] = field(default_factory=dict)
    source: str = "world.yaml"
    overrides: tuple[str, ...] = ()

    def write(self, folder: Path) -> str:
        """Write the files and return what to load."""
        for name, text in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return str(folder / self.source) if self.source in self.files else self.source

    def arguments(self, folder: Path) -> tuple[str, ...]:
        """Return the overrides for ``--set``."""
        return tuple(text.replace("{folder}", str(folder)) for text in self.overrides)


def _edit(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"{old!r} is {text.count(old)} times in the base file"
    return text.replace(old, new)


def _world(id: str, old: str, new: str, *mentions: str) -> MalformedCase:
    return MalformedCase(id, mentions, {"world.yaml": _edit(WORLD, old, new)})


def _raw(id: str, text: str, *mentions: str) -> MalformedCase:
    return MalformedCase(id, mentions, {"world.yaml": text})


def _set(id: str, override: str, *mentions: str) -> MalformedCase:
    return MalformedCase(id, mentions, source="quickstart", overrides=(override,))


def _track(id: str, track: str, *mentions: str) -> MalformedCase:
    return MalformedCase(id, mentions, {"world.yaml": TRACK_WORLD, "walk.csv": track})


def _site(
    id: str, *mentions: str, site: str = SITE, krtd: str | None = KRTD, people: str | None = PEOPLE
) -> MalformedCase:
    files = {"site.yaml": site}
    if krtd is not None:
        files["cameras/north.krtd"] = krtd
    if people is not None:
        files["people.csv"] = people
    return MalformedCase(id, mentions, files, "site.yaml", ("data={folder}",))


WORLD_FILES = [
    _raw("empty file", "", "world.yaml", "mapping"),
    _raw("not a mapping", "- 1\n- 2\n", "world.yaml", "[1, 2]"),
    _raw("broken yaml", "name: yard\ncameras: [}\n", "world.yaml:2", "YAML"),
    _raw("tab as indentation", "name: yard\nrun:\n\tduration_s: 3\n", "world.yaml:3", "YAML"),
    _raw("python tag", WORLD + "description: !!python/name:os.system x\n", "description", "python/name"),
    _raw("zero byte", WORLD + "\0", "YAML", "#x0000"),
    _raw("larger than settings are", WORLD + "#" * 4_000_000, "larger than 4,000,000 bytes"),
    _raw("nested deeply", "name: " + "[" * 100_000 + "\n", "world.yaml:1", "nested"),
    _raw(
        "aliases of aliases",
        "a: &a [x, x, x, x, x, x, x, x, x]\n"
        + "".join(
            f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
        ),
        "world.yaml:",
        "at most 200000 values",
    ),
    _raw("alias of itself", "name: &a [*a]\n", "world.yaml:1", "alias"),
    _world(
        "key twice", "    far_m: 8.0\n", "    far_m: 8.0\n    far_m: 9.0\n", "world.yaml:7", "far_m", "twice"
    ),
    _world("unknown section", "run: {", "runs: {", "world.yaml:27", "'runs'", "'run'"),
    _world(
        "unknown key",
        "height_px: 480",
        "hight_px: 480",
        "world.yaml:4",
        "cameras[0].intrinsics",
        "'hight_px'",
        "'height_px'",
    ),
    _world("unit in the key", "near_m: 0.3", "near_mm: 300", "world.yaml:5", "near_mm", "300", "near_m: 0.3"),
    _world("speed in km/h", "speed_mps: 0.3", "speed_kmh: 3.6", "speed_kmh", "3.6", "speed_mps: 1"),
    _world(
        "angle in degrees", "start_heading_rad: 1.57", "start_heading_deg: 90", "start_heading_deg", "1.5708"
    ),
    _world(
        "degrees as radians",
        "start_heading_rad: 1.57",
        "start_heading_rad: 90",
        "start_heading_rad",
        "value 90:",
        "1.5708",
    ),
    _world(
        "unit in the value",
        "far_m: 8.0",
        "far_m: 800 cm",
        "cameras[0].far_m",
        "'800 cm'",
        "metres is expected: 8",
    ),
    _world("text for a number", "far_m: 8.0", "far_m: '8.0'", "cameras[0].far_m", "'8.0'", "number"),
    _world("not a number", "far_m: 8.0", "far_m: .nan", "cameras[0].far_m", ".nan", "finite"),
    _world("infinite", "far_m: 8.0", "far_m: .inf", "cameras[0].far_m", ".inf", "finite"),
    _world("negative range", "near_m: 0.3", "near_m: -0.3", "cameras[0].near_m", "-0.3", "greater than 0"),
    _world("near beyond far", "near_m: 0.3", "near_m: 9.0", "cameras[0].near_m", "9.0", "far_m"),
    _world("fraction of a pixel", "width_px: 640", "width_px: 640.5", "width_px", "640.5", "whole number"),
    _world("true for a number", "near_m: 0.3", "near_m: true", "near_m", "true", "number"),
    _world("principal point outside", "cx_px: 320.0", "cx_px: 900.0", "cx_px", "900.0", "640"),
    _world(
        "camera without intrinsics",
        WORLD.splitlines(keepends=True)[3],
        "",
        "world.yaml:3",
        "intrinsics",
        "missing",
    ),
    _world(
        "too few numbers", "[4.0, 0.0, 2.5]", "[4.0, 0.0]", "agents[0].start_m", "[4.0, 0.0]", "3 numbers"
    ),
    _world(
        "too many numbers",
        "[4.0, 0.0, 2.5]",
        "[4.0, 0.0, 2.5, 1.0]",
        "agents[0].start_m",
        "2.5, 1.0]",
        "3 numbers",
    ),
    _world(
        "region overlaps",
        "max_m: [-2.0, 2.0, 3.5]",
        "max_m: [2.5, 2.0, 3.5]",
        "world.yaml:11",
        "regions[1].shape",
        "2.5",
        "'east'",
    ),
    _world(
        "region inside out",
        "max_m: [6.0, 2.0, 3.5]",
        "max_m: [1.0, 2.0, 3.5]",
        "regions[0].shape",
        "1.0",
        "min_m",
    ),
    _world(
        "region too small",
        "max_m: [6.0, 2.0, 3.5]",
        "max_m: [2.3, 2.0, 3.5]",
        "regions[0].shape",
        "2.3",
        "region_margin_m",
    ),
    _world(
        "unknown shape",
        "{type: box, min_m: [2.0",
        "{type: bax, min_m: [2.0",
        "regions[0].shape.type",
        "'bax'",
        "'box'",
    ),
    _world(
        "shape without a type",
        "{type: box, min_m: [2.0",
        "{min_m: [2.0",
        "regions[0].shape.type",
        "missing",
        "box",
    ),
    _world(
        "agent outside its region",
        "[4.0, 0.0, 2.5]",
        "[8.0, 0.0, 2.5]",
        "world.yaml:13",
        "agents[0].start_m",
        "8.0",
        "2 m outside",
    ),
    _world(
        "agent at its region's border",
        "[4.0, 0.0, 2.5]",
        "[5.9, 0.0, 2.5]",
        "agents[0].start_m",
        "5.9",
        "region_margin_m",
    ),
    _world(
        "agent in a solid",
        "center_m: [0.0, 0.0], radius_m: 0.5, z_m: [0.0, 1.0]",
        "center_m: [4.0, 0.0], radius_m: 0.5, z_m: [0.0, 3.0]",
        "agents[0].start_m",
        "4.0",
        "'crate'",
    ),
    _world(
        "no such region",
        "region: west",
        "region: wset",
        "world.yaml:14",
        "agents[1].region",
        "'wset'",
        "'west'",
    ),
    _world(
        "two agents in a region", "region: west", "region: east", "agents[1].region", "'east'", "one agent"
    ),
    _world(
        "no such camera model",
        "east, camera: lens",
        "east, camera: lense",
        "agents[0].camera",
        "'lense'",
        "'lens'",
    ),
    _world("name twice", "name: camera_1", "name: camera_0", "agents[1].name", "'camera_0'", "unique"),
    _world("name with blanks", "name: robot", "name: the robot", "targets[0].name", "'the robot'", "letters"),
    _world("no such road", "road: loop", "road: lop", "targets[0].motion.road", "'lop'", "'loop'"),
    _world(
        "open road for a loop", "closed: true", "closed: false", "targets[0].motion.road", "'loop'", "closed"
    ),
    _world(
        "road of one place",
        "[[4.0, -1.0], [4.0, 1.0], [-4.0, 1.0], [-4.0, -1.0]]",
        "[[4.0, -1.0], [4.0, -1.0]]",
        "roads[0].points_m",
        "[[4.0, -1.0], [4.0, -1.0]]",
        "at least 3",
    ),
    _world(
        "faster than its bound",
        "speed_mps: 0.3",
        "speed_mps: 3.0",
        "targets[0].motion.speed_mps",
        "3.0",
        "v_max_mps",
    ),
    _world(
        "no targets",
        WORLD[WORLD.index("targets:") : WORLD.index("run:")],
        "targets: []\n",
        "targets",
        "at least one",
    ),
    _world(
        "unknown kind of motion",
        "kind: vector_field",
        "kind: vector_filed",
        "targets[0].motion.kind",
        "'vector_filed'",
        "'vector_field'",
    ),
    _world(
        "unknown kind of world",
        "name: yard\n",
        "name: yard\nkind: netwrk\n",
        "world.yaml:2",
        "kind",
        "'netwrk'",
        "'network'",
    ),
    _world(
        "no time to run", "duration_s: 60", "duration_s: 0", "run.duration_s", "value 0:", "greater than 0"
    ),
    MalformedCase(
        "recipe of no world",
        ("recipe.yaml:1", "world", "'quickstrat'", "quickstart"),
        {"recipe.yaml": "world: quickstrat\n"},
        "recipe.yaml",
    ),
    MalformedCase(
        "recipes in a circle",
        ("world", "'b.yaml'", "circle"),
        {"a.yaml": "world: b.yaml\n", "b.yaml": "world: b.yaml\n"},
        "a.yaml",
    ),
    MalformedCase(
        "recipe removes what is not there",
        ("recipe.yaml", "remove", "'robt'"),
        {"recipe.yaml": "world: quickstart\ntargets: [{name: robt, remove: true}]\n"},
        "recipe.yaml",
    ),
    MalformedCase("no such world", ("'quickstrat'", "'quickstart'"), source="quickstrat"),
]

OVERRIDES = [
    _set("steps without end", "handoff.rollout_dt_s=1e-9", "rollout_dt_s", "1e-09", "4e+10", "10,000"),
    _set("run without end", "run.duration_s=1e9", "run.duration_s", "2.4e+11", "1,000,000,000"),
    _set("log without end", "run.duration_s=100000", "run.duration_s", "1.57e+08", "100,000,000"),
    _set("number beyond sense", "run.duration_s=1e18", "run.duration_s", "1e+18", "1000000000"),
    _set("late by years", "sensing.latency_s=1e7", "sensing.latency_s", "3e+08", "100,000"),
    _set(
        "stack of terabytes",
        "estimator={stack: {size: 20000}, basis: {max_kernels: 4000}}",
        "size",
        "8.192e+09",
    ),
    _set("more kernels than memory", "estimator.basis.max_kernels=1000000", "max_kernels", "1000000", "4000"),
    _set("seed of ninety digits", f"seed={'9' * 90}", "seed", "9007199254740992"),
    _set("octal or decimal", "seed=017", "seed", "'017'", "octal"),
    _set("hexadecimal", "seed=0x1F", "seed", "'0x1F'", "decimal"),
    _set("octal", "run.duration_s=0o17", "run.duration_s", "'0o17'", "decimal"),
    _set("digits in groups", "seed=1_000", "seed", "'1_000'", "whole number"),
    _set("sexagesimal", "run.duration_s=1:30", "run.duration_s", "'1:30'", "number"),
    _set("decimal comma", "run.duration_s=1,5", "run.duration_s", "'1,5'", "number"),
    _set(
        "image of a billion pixels",
        "cameras.0.intrinsics.width_px=1000000000",
        "width_px",
        "1000000000",
        "20000",
    ),
    _set("view of half a turn", "cameras.0.intrinsics.fx_px=1", "fx_px", "179.6 degrees", "170 degrees"),
    _set("target in centimetres", "targets.robot.start_m=[420, -60]", "start_m", "420", "far from the world"),
    _set("override without a value", "run.duration_s", "run.duration_s", "KEY=VALUE"),
    _set("override without a key", "=3", "'=3'", "KEY=VALUE"),
    _set("override of an unknown key", "run.duration=3", "run.duration", "value 3:", "duration_s"),
    _set("override of no item", "targets.robt.start_m=[1, 2]", "targets", "'robt'", "'robot'"),
    _set("override beyond the list", "agents.7.start_m=[1, 2, 3]", "agents", "'7'", "0 to 3"),
    _set(
        "override of a part of a number",
        "run.duration_s.x=1",
        "run.duration_s.x",
        "360",
        "run.duration_s itself",
    ),
    _set("override of broken yaml", "agents.0.start_m=[1, 2", "agents.0.start_m=[1, 2", "YAML"),
    _set("override of the wrong type", "physics.step_hz=fast", "physics.step_hz", "'fast'", "whole number"),
    _set(
        "override with a unit",
        "controller.rate_hz=60 Hz",
        "controller.rate_hz",
        "'60 Hz'",
        "hertz is expected: 60",
    ),
    _set("override of no choice", "controller.switching=sine", "controller.switching", "'sine'", "'sign'"),
    _set("rate that does not divide", "controller.rate_hz=100", "controller.rate_hz", "value 100.0:", "240"),
    _set(
        "too heavy to fly",
        "physics.quadrotor.mass_kg=5",
        "physics.quadrotor.mass_kg",
        "value 5.0:",
        "too heavy",
    ),
    _set(
        "probability above one",
        "sensing.dropout_probability=1.5",
        "sensing.dropout_probability",
        "1.5",
        "less than or equal to 1",
    ),
    _set("negative seed", "seed=-1", "seed", "value -1:", "greater than or equal to 0"),
]

TRACKS = [
    _track(
        "track in centimetres",
        TRACK.replace("4.5", "450").replace("4,0", "400,0").replace("5,0", "500,0"),
        "away",
    ),
    _track(
        "track with a decimal comma",
        TRACK.replace("a,1,4.5,0", 'a,1,"4,5",0'),
        "walk.csv, line 3",
        "'4,5'",
        "comma",
    ),
    _track(
        "track with groups of digits",
        TRACK.replace("4.5", "1_000"),
        "walk.csv, line 3",
        "'1_000'",
        "separators",
    ),
    _track("track in other digits", TRACK.replace("4.5", "\u0664"), "walk.csv, line 3", "\u0664", "0 to 9"),
    _track(
        "track in milliseconds", TRACK.replace("a,1,", "a,1583000000000,"), "walk.csv, line 3", "milliseconds"
    ),
    _track("track at two places", TRACK + "a,2,90,0\n", "walk.csv", "'a'", "two places", "85 m"),
    _track(
        "identity misspelt", TRACK.replace("id,", "trak_id,"), "walk.csv, line 1", "'trak_id'", "'track_id'"
    ),
    MalformedCase(
        "gpx with latitude and longitude swapped",
        ("walk.gpx", "km from the origin", "swapped"),
        {
            "world.yaml": GPX_WORLD,
            "walk.gpx": GPX.replace("lat=", "l=").replace("lon=", "lat=").replace("l=", "lon="),
        },
    ),
    MalformedCase(
        "gpx with mixed times",
        ("walk.gpx, line 3", "'2020-01-01T00:00:10'", "without a time zone"),
        {"world.yaml": GPX_WORLD, "walk.gpx": GPX.replace("10Z", "10")},
    ),
    MalformedCase(
        "gpx with entities",
        ("walk.gpx, line 1", "entity", "'a'"),
        {"world.yaml": GPX_WORLD, "walk.gpx": '<!DOCTYPE gpx [<!ENTITY a "aaaa">]>' + GPX},
    ),
    MalformedCase(
        "track file missing",
        ("targets[0].motion.file", "walk.csv", "no such file"),
        {"world.yaml": TRACK_WORLD},
    ),
    _track("track file empty", "", "walk.csv", "empty"),
    _track("track without a time", "id,x,y\na,1,2\n", "walk.csv", "time", "['id', 'x', 'y']"),
    _track("track without a position", "id,t\na,1\n", "walk.csv", "position"),
    _track("track with text for a number", TRACK.replace("4.5", "four"), "walk.csv, line 3", "x_m", "'four'"),
    _track("track with a hole", TRACK.replace("a,1,4.5,0", "a,1,,0"), "walk.csv, line 3", "x_m", "''"),
    _track("track not finite", TRACK.replace("4.5", "nan"), "walk.csv, line 3", "x_m", "'nan'"),
    _track("track row too short", TRACK.replace("a,1,4.5,0", "a,1,4.5"), "walk.csv, line 3", "3 fields", "4"),
    _track("track of another identity", TRACK.replace("a,", "b,"), "walk.csv", "'a'", "b"),
    MalformedCase(
        "gpx not xml",
        ("walk.gpx", "line 2", "XML"),
        {"world.yaml": GPX_WORLD, "walk.gpx": GPX.replace("</trkpt>", "</trk>")},
    ),
    MalformedCase(
        "gpx latitude off the earth",
        ("walk.gpx", "lat", "'144.0001'"),
        {"world.yaml": GPX_WORLD, "walk.gpx": GPX.replace("44.0001", "144.0001")},
    ),
    MalformedCase(
        "gpx without an origin",
        ("walk.gpx", "origin"),
        {"world.yaml": GPX_WORLD.replace(", origin: [44.0, 11.0, 50.0]", ""), "walk.gpx": GPX},
    ),
]

CAMERA_FILES = [
    _site("recording without cameras", "cameras.glob", "cameras/*.krtd", krtd=None),
    _site("camera file cut short", "north.krtd", "9", krtd="1500 0 960\n0 1500 540\n"),
    _site(
        "camera file with text", "north.krtd, line 2", "'wide'", krtd=KRTD.replace("0 1500 540", "0 wide 540")
    ),
    _site(
        "camera turned by no rotation",
        "north.krtd",
        "R",
        "orthonormal",
        krtd=KRTD.replace("1 0 0\n0 0 -1", "2 0 0\n0 0 -1"),
    ),
    _site("camera mirrored", "north.krtd", "R", "reflection", krtd=KRTD.replace("0 0 -1", "0 0 1")),
    _site(
        "camera with negative focal length",
        "north.krtd",
        "fx",
        "-1500",
        krtd=KRTD.replace("1500 0 960", "-1500 0 960"),
    ),
    _site(
        "camera for another image size",
        "north.krtd",
        "cx",
        "960",
        site=SITE + "cameras: {width_px: 640, height_px: 480}\n",
    ),
]

RECORDINGS = [
    MalformedCase(
        "recording without its folder",
        ("data", "missing", "--set data=FOLDER"),
        {"site.yaml": SITE},
        "site.yaml",
    ),
    MalformedCase(
        "recording in no folder",
        ("data", "nowhere", "--set data=FOLDER"),
        {"site.yaml": SITE},
        "site.yaml",
        ("data={folder}/nowhere",),
    ),
    _site("recording without tracks", "tracks.file", "people.csv", "no such file", people=None),
    _site(
        "recording without an origin", "origin", "missing", "latitude_deg", site=SITE[: SITE.index("origin")]
    ),
    _site(
        "recording with a latitude off the earth",
        "origin.latitude_deg",
        "144.0",
        "90",
        site=SITE.replace("44.0", "144.0"),
    ),
    _site(
        "recording seen from nearer than near",
        "cameras.range_cap_m",
        "0.2",
        "near_m",
        site=SITE + "cameras: {range_cap_m: 0.2}\n",
    ),
    _site(
        "recording of unknown format",
        "tracks.format",
        "'cvs'",
        "'csv'",
        site=SITE.replace("people.csv", "people.csv, format: cvs"),
    ),
    _site(
        "people off the earth",
        "people.csv, line 2",
        "lat",
        "'94.0001'",
        people=PEOPLE.replace("44.0001", "94.0001"),
    ),
]

CASES = [*WORLD_FILES, *OVERRIDES, *TRACKS, *CAMERA_FILES, *RECORDINGS]
