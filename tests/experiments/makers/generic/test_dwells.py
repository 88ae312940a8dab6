import numpy as np
import pytest
from recorded_logs import POSTURES, moves

from zerobeam.experiments.makers.generic.dwells import (
    calmest,
    dwell_of_each,
    find_dwells,
    held,
    repeats,
)
from zerobeam.experiments.makers.generic.layouts import Stillness
from zerobeam.model.files.robot_file import load_robot

TOLERANCE = np.full(6, 0.02)


def plain_rest(times, joints, tolerance, seconds):
    """(N,) whether the window that begins at each reading is at rest, one after the other."""
    rest = np.zeros(len(times), dtype=bool)
    for i in range(len(times)):
        behind = np.flatnonzero(times >= times[i] + seconds - 1e-9)
        if len(behind):
            window = slice(i, behind[0] + 1)
            small = np.all(np.ptp(joints[window], axis=0) <= tolerance)
            rest[i] = small and np.diff(times[window]).max(initial=0) <= seconds / 2
    return rest


def test_dwells_are_found_where_they_are():
    times, joints = moves(stand_s=1.0, move_s=0.6, rate=100)
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert drifting == []
    assert len(dwells) == len(POSTURES)
    for i, dwell in enumerate(dwells):
        begin = 0.6 + 1.6 * i - 0.01  # the first reading is one step into the first move
        # The ends of a smooth move are within the tolerance as well.
        assert begin - 0.03 < dwell.start_s < begin + 0.02
        assert begin + 0.98 < dwell.end_s < begin + 1.05
        np.testing.assert_allclose(dwell.joints, POSTURES[i], atol=1e-12)
        assert np.all(dwell.spread <= TOLERANCE)


def test_noise_is_averaged_and_too_much_of_it_is_no_dwell():
    times, joints = moves(noise_deg=0.002, rate=250, stand_s=2.0)
    dwells, _ = find_dwells(times, joints, TOLERANCE, 0.5)
    assert len(dwells) == 4
    for dwell, posture in zip(dwells, POSTURES, strict=True):
        count = dwell.used.stop - dwell.used.start
        assert count > 400
        # 24 means: the largest of them is below five standard errors in all but 1 of 70 000 such tests.
        assert np.abs(dwell.joints - posture).max() < 5 * 0.002 / np.sqrt(count)
    times, joints = moves(noise_deg=0.02, rate=250, stand_s=2.0)
    assert find_dwells(times, joints, TOLERANCE, 0.5) == ([], [])


def test_short_stops_are_no_dwells():
    times, joints = moves(stand_s=0.3)
    assert find_dwells(times, joints, TOLERANCE, 0.5) == ([], [])
    assert len(find_dwells(times, joints, TOLERANCE, 0.3)[0]) == 4


def test_a_slow_drift_is_passed_over_and_not_cut_into_dwells():
    times = np.arange(0, 20, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[:, 2] += 0.01 * times  # 0.005 degrees in half a second, 0.2 in all
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert dwells == []
    (drift,) = drifting
    assert drift.spread[2] == pytest.approx(0.2, rel=0.02)
    # Control: as slow a drift that ends within the tolerance is a dwell.
    assert len(find_dwells(times[:150], joints[:150], TOLERANCE, 0.5)[0]) == 1


def test_a_drift_whose_windows_are_not_all_at_rest_is_one_drift():
    times = np.arange(0, 20, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[:, 2] += 0.03 * times
    joints[::40, 2] += 0.012  # with such a reading at its end a window is beyond the tolerance
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert not all(plain_rest(times[:200], joints[:200], TOLERANCE, 0.5)[:140])
    assert dwells == []
    assert len(drifting) == 1


def test_a_small_step_parts_two_dwells():
    times = np.arange(0, 4, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[200:, 4] += 0.03
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert drifting == []
    assert [(s.first, s.last) for s in dwells] == [(0, 199), (200, 399)]
    joints[200:, 4] -= 0.02
    assert len(find_dwells(times, joints, TOLERANCE, 0.5)[0]) == 1


def test_what_happened_in_a_gap_is_not_known():
    times, joints = np.arange(0, 4, 0.01), np.tile(POSTURES[0], (400, 1))
    there = (times < 1.5) | (times > 2.5)
    dwells, _ = find_dwells(times[there], joints[there], TOLERANCE, 0.5)
    assert len(dwells) == 2
    assert repeats(dwells, TOLERANCE) == [None, 0]
    few = slice(0, None, 30)  # a reading each 0.3 s cannot show a dwell of 0.5 s
    assert find_dwells(times[few], joints[few], TOLERANCE, 0.5) == ([], [])
    assert len(find_dwells(times[few], joints[few], TOLERANCE, 0.6)[0]) == 1


def test_one_joint_that_moves_is_enough():
    times, joints = np.arange(0, 4, 0.01), np.tile(POSTURES[0], (400, 1))
    for i in range(6):
        moving = joints.copy()
        moving[:, i] += np.sin(times)
        assert find_dwells(times, moving, TOLERANCE, 0.5)[0] == []
        assert calmest(times, moving, TOLERANCE, 0.5)[1] == i


def test_windows_at_uneven_times_against_a_plain_search():
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.001, 0.05, 600))
    joints = np.cumsum(random.normal(0, 0.004, (600, 2)) * (random.random(600) < 0.3)[:, None], axis=0)
    tolerance = np.array([0.02, 0.02])
    rest = plain_rest(times, joints, tolerance, 0.4)
    assert 0.1 < rest.mean() < 0.9
    dwells, drifting = find_dwells(times, joints, tolerance, 0.4)
    covered = np.zeros(600, dtype=bool)
    for i in np.flatnonzero(rest):
        covered[i : np.searchsorted(times, times[i] + 0.4 - 1e-9) + 1] = True
    mine = np.zeros(600, dtype=bool)
    for dwell in (*dwells, *drifting):
        mine[dwell.first : dwell.last + 1] = True
    np.testing.assert_array_equal(mine, covered)


def test_too_short_a_recording_has_no_window():
    times, joints = np.arange(0, 0.4, 0.01), np.tile(POSTURES[0], (40, 1))
    assert find_dwells(times, joints, TOLERANCE, 0.5) == ([], [])
    assert calmest(times, joints, TOLERANCE, 0.5) is None
    assert len(find_dwells(times, joints, TOLERANCE, 0.39)[0]) == 1


def test_repeats_and_marks():
    times, joints = moves(POSTURES[[0, 1, 0, 2]])
    dwells, _ = find_dwells(times, joints, TOLERANCE, 0.5)
    assert repeats(dwells, TOLERANCE) == [None, None, 0, None]
    middle = [(dwell.start_s + dwell.end_s) / 2 for dwell in dwells]
    assert dwell_of_each(dwells, np.array(middle))[0].tolist() == [0, 1, 2, 3]
    near = np.array([dwells[1].start_s - 0.2, dwells[-1].end_s + 0.24, dwells[-1].end_s + 0.26])
    nearest, away = dwell_of_each(dwells, near)
    assert nearest.tolist() == [1, 3, 3]
    np.testing.assert_allclose(away, [0.2, 0.24, 0.26])


def test_rows_that_hold_until_the_next():
    times, joints = held(np.array([0.0, 2.0, 2.1]), np.array([[1.0], [2.0], [3.0]]), 0.5)
    assert times[0] == 0
    assert times[-1] == 2.1
    assert np.diff(times).max() <= 0.125 + 1e-12
    assert np.all(np.diff(times) > 0)
    np.testing.assert_array_equal(joints[times < 2.0, 0], 1.0)
    np.testing.assert_array_equal(joints[(times >= 2.0) & (times < 2.1), 0], 2.0)
    (dwell,) = find_dwells(times, joints, np.array([0.02]), 0.5)[0]
    assert 1.8 < dwell.end_s < 2.0


@pytest.mark.parametrize(
    ("deg", "seconds"), [(0, 1), (0.01, 0), (-1, 1), (float("nan"), 1), (0.01, float("inf"))]
)
def test_a_tolerance_that_cannot_be_used(refused, tmp_path, deg, seconds):
    robot = load_robot("irb1600", tmp_path)
    assert "is out of range" in refused(Stillness(deg, seconds).tolerance, robot).what
    np.testing.assert_array_equal(Stillness(0.02, 1).tolerance(robot), TOLERANCE)
