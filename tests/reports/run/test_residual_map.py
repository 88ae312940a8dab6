"""The residuals over the workspace: a dot for each measurement, another shape beyond the noise."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from example_results import EXAMPLES, good

from zerobeam.reports.run.residual_map import residual_map_picture
from zerobeam.reports.style.palette import light


@pytest.mark.parametrize("name", ["good", "misfit"])
def test_every_measurement_is_drawn_in_both_planes(name: str) -> None:
    result = EXAMPLES[name]
    picture = residual_map_picture(result)
    assert picture is not None
    assert result.scene is not None
    colours = [light(role) for role in ("identified", "weak")]
    inside, outside = (
        len(re.findall(rf'<use [^>]*style="fill: {colour}', picture.svg)) for colour in colours
    )
    beyond = int(re.findall(r"; (\d+) lie beyond", picture.alt)[0])
    count = len(result.scene.shots)
    key = 1 if beyond else 0
    assert outside == 2 * beyond + key
    assert inside == 2 * (count - beyond) + 2  # the key has two sizes


def test_without_a_place_there_is_no_map() -> None:
    assert residual_map_picture(replace(good(), scene=None)) is None
