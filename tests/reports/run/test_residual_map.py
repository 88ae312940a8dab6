"""The residuals as arrows at the measurements: their size and direction, another shape beyond the noise."""

import re
from dataclasses import replace

import numpy as np
import pytest
from exact_runs import demo_runs
from example_results import EXAMPLES, good

from zerobeam.model.files.run import read_run
from zerobeam.reports.run.residuals import residual_map_picture
from zerobeam.reports.style.theme import light


@pytest.mark.parametrize("name", ["good", "misfit"])
def test_a_residual_vector_is_as_long_as_the_residual_and_across_the_beam(name: str) -> None:
    result = EXAMPLES[name]
    assert result.scene is not None
    lengths = {shot.shot: shot.length_mm for shot in result.shots}
    for shot in result.scene.shots:
        assert shot.residual_mm is not None
        assert np.linalg.norm(shot.residual_mm) == pytest.approx(lengths[shot.shot], rel=1e-6)
        if shot.beam_to is not None:
            beam = np.subtract(shot.beam_to, shot.links[-1])
            assert abs(beam @ shot.residual_mm) < 1e-3 * np.linalg.norm(beam) * lengths[shot.shot]


def test_the_vector_leads_from_the_target_to_the_beam_less_what_was_read() -> None:
    result, run = good(), read_run(demo_runs()[0].path)
    assert result.scene is not None
    (target,) = (one.at_mm for one in result.scene.targets)
    for shot, recorded in zip(result.scene.shots, run.shots, strict=True):
        assert shot.beam_to is not None
        assert shot.residual_mm is not None
        beside = np.subtract(shot.beam_to, target) - shot.residual_mm
        assert np.linalg.norm(beside) == pytest.approx(np.hypot(*recorded.spot_mm), abs=1e-5)


@pytest.mark.parametrize(("name", "panels"), [("good", 3), ("misfit", 2)])
def test_every_measurement_is_drawn_in_every_panel(name: str, panels: int) -> None:
    result = EXAMPLES[name]
    picture = residual_map_picture(result)
    assert picture is not None
    assert result.scene is not None
    colours = [light(role) for role in ("identified", "weak")]
    inside, outside = (
        len(re.findall(rf'<use [^>]*style="fill: {colour}', picture.svg)) for colour in colours
    )
    beyond = int(re.findall(r"; (\d+) lie beyond", picture.alt)[0])
    assert outside == panels * beyond + (1 if beyond else 0)  # the key has one
    assert inside == panels * (len(result.scene.shots) - beyond)
    times, mm = re.findall(r"drawn ([\d,]+) times larger \(100 mm of the axes are ([\d.]+)", picture.title)[0]
    assert float(times.replace(",", "")) * float(mm) == pytest.approx(100.0)


def test_without_a_place_there_is_no_map() -> None:
    assert residual_map_picture(replace(good(), scene=None)) is None
