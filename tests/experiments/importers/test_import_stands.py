import numpy as np
import pytest
from recorded_logs import POSTURES, moves

from zerobeam.experiments.importers.dwells import (
    Stillness,
    calmest,
    find_stands,
    held,
    repeats,
    stand_of_each,
)
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


def test_stands_are_found_where_they_are():
    times, joints = moves(stand_s=1.0, move_s=0.6, rate=100)
    stands, drifting = find_stands(times, joints, TOLERANCE, 0.5)
    assert drifting == []
    assert len(stands) == len(POSTURES)
    for i, stand in enumerate(stands):
        begin = 0.6 + 1.6 * i - 0.01  # the first reading is one step into the first move
        # The ends of a smooth move are within the tolerance as well.
        assert begin - 0.03 < stand.start_s < begin + 0.02
        assert begin + 0.98 < stand.end_s < begin + 1.05
        np.testing.assert_allclose(stand.joints, POSTURES[i], atol=1e-12)
        assert np.all(stand.spread <= TOLERANCE)


def test_noise_is_averaged_and_too_much_of_it_is_no_stand():
    times, joints = moves(noise_deg=0.002, rate=250, stand_s=2.0)
    stands, _ = find_stands(times, joints, TOLERANCE, 0.5)
    assert len(stands) == 4
    for stand, posture in zip(stands, POSTURES, strict=True):
        count = stand.used.stop - stand.used.start
        assert count > 400
        # 24 means: the largest of them is below five standard errors in all but 1 of 70 000 such tests.
        assert np.abs(stand.joints - posture).max() < 5 * 0.002 / np.sqrt(count)
    times, joints = moves(noise_deg=0.02, rate=250, stand_s=2.0)
    assert find_stands(times, joints, TOLERANCE, 0.5) == ([], [])


def test_short_stops_are_no_stands():
    times, joints = moves(stand_s=0.3)
    assert find_stands(times, joints, TOLERANCE, 0.5) == ([], [])
    assert len(find_stands(times, joints, TOLERANCE, 0.3)[0]) == 4


def test_a_slow_drift_is_passed_over_and_not_cut_into_stands():
    times = np.arange(0, 20, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[:, 2] += 0.01 * times  # 0.005 degrees in half a second, 0.2 in all
    stands, drifting = find_stands(times, joints, TOLERANCE, 0.5)
    assert stands == []
    (drift,) = drifting
    assert drift.spread[2] == pytest.approx(0.2, rel=0.02)
    # Control: as slow a drift that ends within the tolerance is a stand.
    assert len(find_stands(times[:150], joints[:150], TOLERANCE, 0.5)[0]) == 1


def test_a_drift_whose_windows_are_not_all_at_rest_is_one_drift():
    times = np.arange(0, 20, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[:, 2] += 0.03 * times
    joints[::40, 2] += 0.012  # with such a reading at its end a window is beyond the tolerance
    stands, drifting = find_stands(times, joints, TOLERANCE, 0.5)
    assert not all(plain_rest(times[:200], joints[:200], TOLERANCE, 0.5)[:140])
    assert stands == []
    assert len(drifting) == 1


def test_a_small_step_parts_two_stands():
    times = np.arange(0, 4, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[200:, 4] += 0.03
    stands, drifting = find_stands(times, joints, TOLERANCE, 0.5)
    assert drifting == []
    assert [(s.first, s.last) for s in stands] == [(0, 199), (200, 399)]
    joints[200:, 4] -= 0.02
    assert len(find_stands(times, joints, TOLERANCE, 0.5)[0]) == 1


def test_what_happened_in_a_gap_is_not_known():
    times, joints = np.arange(0, 4, 0.01), np.tile(POSTURES[0], (400, 1))
    there = (times < 1.5) | (times > 2.5)
    stands, _ = find_stands(times[there], joints[there], TOLERANCE, 0.5)
    assert len(stands) == 2
    assert repeats(stands, TOLERANCE) == [None, 0]
    few = slice(0, None, 30)  # a reading each 0.3 s cannot show a stand of 0.5 s
    assert find_stands(times[few], joints[few], TOLERANCE, 0.5) == ([], [])
    assert len(find_stands(times[few], joints[few], TOLERANCE, 0.6)[0]) == 1


def test_one_joint_that_moves_is_enough():
    times, joints = np.arange(0, 4, 0.01), np.tile(POSTURES[0], (400, 1))
    for i in range(6):
        moving = joints.copy()
        moving[:, i] += np.sin(times)
        assert find_stands(times, moving, TOLERANCE, 0.5)[0] == []
        assert calmest(times, moving, TOLERANCE, 0.5)[1] == i


def test_windows_at_uneven_times_against_a_plain_search():
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.001, 0.05, 600))
    joints = np.cumsum(random.normal(0, 0.004, (600, 2)) * (random.random(600) < 0.3)[:, None], axis=0)
    tolerance = np.array([0.02, 0.02])
    rest = plain_rest(times, joints, tolerance, 0.4)
    assert 0.1 < rest.mean() < 0.9
    stands, drifting = find_stands(times, joints, tolerance, 0.4)
    covered = np.zeros(600, dtype=bool)
    for i in np.flatnonzero(rest):
        covered[i : np.searchsorted(times, times[i] + 0.4 - 1e-9) + 1] = True
    mine = np.zeros(600, dtype=bool)
    for stand in (*stands, *drifting):
        mine[stand.first : stand.last + 1] = True
    np.testing.assert_array_equal(mine, covered)


def test_too_short_a_recording_has_no_window():
    times, joints = np.arange(0, 0.4, 0.01), np.tile(POSTURES[0], (40, 1))
    assert find_stands(times, joints, TOLERANCE, 0.5) == ([], [])
    assert calmest(times, joints, TOLERANCE, 0.5) is None
    assert len(find_stands(times, joints, TOLERANCE, 0.39)[0]) == 1


def test_repeats_and_marks():
    times, joints = moves(POSTURES[[0, 1, 0, 2]])
    stands, _ = find_stands(times, joints, TOLERANCE, 0.5)
    assert repeats(stands, TOLERANCE) == [None, None, 0, None]
    middle = [(stand.start_s + stand.end_s) / 2 for stand in stands]
    assert stand_of_each(stands, np.array(middle), 0.5) == [0, 1, 2, 3]
    near = np.array([stands[1].start_s - 0.2, stands[-1].end_s + 0.24, stands[-1].end_s + 0.26])
    assert stand_of_each(stands, near, 0.5) == [1, 3, None]
    assert stand_of_each([], np.array([1.0]), 0.5) == [None]


def test_rows_that_hold_until_the_next():
    times, joints = held(np.array([0.0, 2.0, 2.1]), np.array([[1.0], [2.0], [3.0]]), 0.5)
    assert times[0] == 0
    assert times[-1] == 2.1
    assert np.diff(times).max() <= 0.125 + 1e-12
    assert np.all(np.diff(times) > 0)
    np.testing.assert_array_equal(joints[times < 2.0, 0], 1.0)
    np.testing.assert_array_equal(joints[(times >= 2.0) & (times < 2.1), 0], 2.0)
    (stand,) = find_stands(times, joints, np.array([0.02]), 0.5)[0]
    assert 1.8 < stand.end_s < 2.0


@pytest.mark.parametrize(
    ("deg", "seconds"), [(0, 1), (0.01, 0), (-1, 1), (float("nan"), 1), (0.01, float("inf"))]
)
def test_a_tolerance_that_cannot_be_used(refused, tmp_path, deg, seconds):
    robot = load_robot("irb1600", tmp_path)
    assert "cannot be used" in refused(Stillness(deg, seconds).tolerance, robot).what
    np.testing.assert_array_equal(Stillness(0.02, 1).tolerance(robot), TOLERANCE)
