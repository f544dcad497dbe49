"""The table of the gap problem's remedies: experience of earlier crossings, what is first and what is later."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from camnet.config.load import load_scenario
from camnet.errors import ConfigError
from camnet.estimation import EstimatorSettings, LearningEstimator, place_basis
from camnet.estimation.crossing import CrossingSettings, Lesson, Sighting
from camnet.estimation.settings import BasisSettings, GapSettings
from camnet.experiments.gap_experience import ExperienceFilter, LessonBook, Lessons
from camnet.experiments.gap_remedies import ROWS, print_table, run, tabulate
from camnet.experiments.gap_remedies_recorded import ReentryClock, meva_scenario
from camnet.geometry.rotations import from_yaw
from camnet.report.experiments import write_gap_remedies
from camnet.simulation.gaps import Gap
from camnet.types import CameraMotion, PoseMeasurement

LEVEL = CameraMotion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
BOUNDS = np.array([[-9.0, -9.0, -1.0], [9.0, 9.0, 3.0]])


def lesson(region: int, x: float, v: float, duration: float, y: float, to: int) -> Lessons:
    def along(value: float) -> np.ndarray:
        return np.array([value, 0.0, 0.0])

    return Lessons(region, along(x), along(v), duration, along(y), along(v), to)


def test_the_nearest_lessons_of_the_region_vote() -> None:
    book = LessonBook(0.5)
    assert book.consult(0, np.zeros(3), np.ones(3)) is None
    for x in (-0.1, 0.0, 0.1):
        book.add(lesson(0, x, 1.0, 4.0, x + 3.0, 1))
    book.add(lesson(0, 0.0, -1.0, 9.0, -8.0, 2))  # the other way
    book.add(lesson(1, 0.0, 1.0, 50.0, 99.0, 0))  # another region
    advice = book.consult(0, np.array([0.05, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    assert advice is not None
    assert advice.to_region == 1
    assert advice.duration_s == pytest.approx(4.0)
    assert advice.entry_p[0] == pytest.approx(3.05)  # carried along with the exit


def crossing_filter(blend: bool) -> ExperienceFilter:
    settings = EstimatorSettings(
        gap=GapSettings(prior="constant_turn" if blend else "none", learn_across=False),
        basis=BasisSettings(placement="grid", spacing_m=1.5, width_m=0.5),
    )
    basis = place_basis(settings.basis, [], np.full(2, -3.0), np.full(2, 3.0))
    base = LearningEstimator(settings, basis, 2, 30.0, BOUNDS)
    return ExperienceFilter(base, LessonBook(0.5), blend, "experience")


def shuttle(target: ExperienceFilter, crossings: int) -> list[float]:
    """Drive x = 0 ... 4 again and again, unseen between 1 and 3, where it goes half as fast; errors at re-sighting."""
    errors, t = [], 0.0
    for _ in range(crossings):
        x, last = 0.0, None
        while x < 4.0:
            seen = not 1.0 < x < 3.0
            if seen:
                if last is not None and not last:
                    target.predict(t)
                    errors.append(float(np.linalg.norm(target.estimate.p_world - [x, 0.0, 0.0])))
                p = np.array([x, 0.0, 0.0])
                z = PoseMeasurement(t, 0, 0, p, from_yaw(0.0), LEVEL)
                target.correct(z, int(x >= 3.0))
            else:
                target.predict(t)
            last, t = seen, t + 1.0 / 30.0
            x += (0.4 if seen else 0.2) / 30.0
        t += 30.0  # carried back
    return errors


def test_experience_alone_knows_the_second_crossing() -> None:
    errors = shuttle(crossing_filter(False), 3)
    assert errors[0] == pytest.approx(2.0, abs=0.1)  # where it was last seen
    assert max(errors[1:]) < 0.1


def test_of_both_predictions_the_one_with_the_better_record_is_believed() -> None:
    """The prior runs twice too far in every gap; two crossings show that the lessons do not."""
    errors = shuttle(crossing_filter(True), 4)
    assert errors[0] > 1.5
    assert errors[3] < 0.2


def gap(pair: tuple[int, int], seen_s: float, error_m: float) -> Gap:
    names = dict.fromkeys(ROWS, error_m)
    cameras = dict.fromkeys(ROWS, pair[1])
    expected = dict.fromkeys(ROWS, seen_s - 2.0)
    return Gap(0, pair[0], seen_s - 5.0, cameras, pair[1], seen_s, names, expected)


def test_first_crossings_are_told_from_later_ones() -> None:
    runs = [[gap((0, 1), 10.0, 1.0), gap((1, 0), 20.0, 3.0), gap((0, 1), 30.0, 0.1)], [gap((0, 1), 5.0, 2.0)]]
    table = tabulate(runs)
    assert table["gaps"] == {"first": 3, "later": 1}
    row = table["rows"]["none"]
    assert row["first"]["place_median_m"] == 2.0
    assert row["later"]["place_median_m"] == 0.1
    assert row["later"]["time_median_s"] == pytest.approx(2.0)
    assert row["first"]["next_camera"] == 1.0


def test_the_clock_takes_the_times_of_exits_alike() -> None:
    clock = ReentryClock(CrossingSettings(), 2)
    for k in range(10):
        for x, took in ((0.0, 10.0), (100.0, 60.0)):
            here = np.array([x, 0.0])
            out = Sighting(100.0 * k, here, np.zeros(2), 0, k)
            clock.learn(Lesson(out, Sighting(100.0 * k + took, here, np.zeros(2), 1, k), 100.0 * k + took))
    for x, took in ((1.0, 10.0), (99.0, 60.0)):
        clock.predict(Sighting(2000.0, np.array([x, 0.0]), np.zeros(2), 0, 50), 2050.0)
        assert clock.expected_s[-1] == took
    clock.predict(Sighting(-1.0, np.zeros(2), np.zeros(2), 0, 51), 0.0)
    assert np.isnan(clock.expected_s[-1])  # nothing was known then


def test_without_a_recording_the_table_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    result = run(seeds=1, worlds=())
    print_table(result)
    assert "meva: skipped" in capsys.readouterr().out
    with pytest.raises(ConfigError, match="seeds: 0"):
        run(seeds=0)


def test_the_recording_is_that_of_the_recipe(shared_data: Path, project_root: Path, tmp_path: Path) -> None:
    data = (shared_data / "meva").resolve()  # the recipe's reader follows links
    recipe = load_scenario(project_root / "configs" / "meva.yaml", [f"data={data}"])
    ours, theirs = meva_scenario(data).model_dump(), recipe.model_dump()
    different = {key for key in theirs if ours[key] != theirs[key]}
    assert different <= {"description"}
    with pytest.raises(ConfigError, match=r"expected cameras/\*.krtd"):
        meva_scenario(tmp_path)


def test_the_figure_is_drawn(tmp_path: Path) -> None:
    table = tabulate([[gap((0, 1), 10.0, 1.0), gap((0, 1), 30.0, 0.1)]])
    write_gap_remedies({"quickstart": table}, ROWS, tmp_path / "remedies.png")
    assert (tmp_path / "remedies.png").stat().st_size > 5000
