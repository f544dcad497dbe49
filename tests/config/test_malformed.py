from __future__ import annotations

import re
from pathlib import Path

import pytest

from camnet.config import load_scenario
from camnet.errors import ConfigError, DataError, WorldError


def test_every_malformed_input_is_refused_with_its_place(malformed, tmp_path: Path):
    source = malformed.write(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises((ConfigError, DataError, WorldError)) as caught:
        load_scenario(source, malformed.arguments(tmp_path))
    message = str(caught.value)
    for part in malformed.mentions:
        assert part in message
    assert sorted(tmp_path.rglob("*")) == before
    assert not re.search(r"Traceback|pydantic|jiter", message)


def test_the_table_is_long_enough_and_its_base_files_are_valid(valid_inputs, tmp_path: Path):
    assert len({case.id for case in valid_inputs.CASES}) == len(valid_inputs.CASES) >= 40
    files = {
        "world.yaml": valid_inputs.WORLD,
        "track.yaml": valid_inputs.TRACK_WORLD,
        "gpx.yaml": valid_inputs.GPX_WORLD,
        "site.yaml": valid_inputs.SITE,
        "walk.csv": valid_inputs.TRACK,
        "walk.gpx": valid_inputs.GPX,
        "people.csv": valid_inputs.PEOPLE,
        "cameras/north.krtd": valid_inputs.KRTD,
    }
    (tmp_path / "cameras").mkdir()
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    for name in ("world.yaml", "track.yaml", "gpx.yaml"):
        load_scenario(tmp_path / name)
    load_scenario(tmp_path / "site.yaml", [f"data={tmp_path}"])


def test_all_problems_are_listed_at_once(valid_inputs, tmp_path: Path):
    text = valid_inputs.WORLD.replace("near_m: 0.3", "near_cm: 30").replace(
        "duration_s: 60", "duration_s: -1"
    )
    (tmp_path / "world.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"2 problems:(?s:.*)near_m: 0\.3(?s:.*)run\.duration_s"):
        load_scenario(tmp_path)
