"""Where a new calibration takes an instrument to be: in lengths of the arm's reach."""

import numpy as np
import pytest

from zerobeam.model.instruments.kind import faces_at, station_at, target_at


@pytest.mark.parametrize(
    ("reach", "station"), [(1000.0, [2200.0, 350.0, 500.0]), (400.0, [880.0, 140.0, 200.0])]
)
def test_a_station_is_out_of_reach_and_grows_with_the_arm(reach, station):
    assert station_at(reach) == station
    assert np.linalg.norm(station) > reach


def test_a_station_is_stated_to_the_millimetre():
    assert station_at(901.3) == [1983.0, 315.0, 451.0]


def test_targets_and_faces_are_where_they_are_stated():
    assert target_at((1.23456, -0.0, 3)) == {"guess_mm": [1.235, 0.0, 3.0], "sigma_mm": 30.0}
    faces = faces_at((600.0, 10.0, 300.0), ["top", "back", "side"])
    assert [face["guess_mm"] for face in faces.values()] == [
        [600.0, 10.0, 350.0],
        [550.0, 10.0, 300.0],
        [600.0, -40.0, 300.0],
    ]
