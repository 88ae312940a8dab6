"""Each kind against its equations in plain numpy: residual, Jacobians, predicted, recorded, starts."""

import numpy as np
import pytest
from plain_model import by_differences
from plain_stations import (
    KNOWN,
    STATED,
    WITHIN,
    Target,
    functions,
    plain_residual,
    poses,
    random_unknowns,
    station,
)
from scipy.spatial.transform import Rotation

from zerobeam.model.instruments.kind import Target as PlannedTarget
from zerobeam.model.instruments.pose import _sine_axes
from zerobeam.model.instruments.registry import STATIONS

VARIED = [
    *((kind, {}) for kind in STATED),
    *((kind, {"frame": frame}) for kind in ("tracker", "pose") for frame in (KNOWN, WITHIN)),
    ("ballbar", {"bias": 1.5}),
    ("plane", {"exact": True}),
    ("dial", {"exact": True}),
]
cases = pytest.mark.parametrize(("kind", "other"), VARIED)
seeds = pytest.mark.parametrize("seed", range(4))


def random_target(instrument, rng):
    if instrument.target_is == "plane":
        return np.append(300 + rng.normal() * 20, rng.uniform(-0.2, 0.2, 2))
    return np.array([800.0, 100, 300]) + rng.uniform(-50, 50, 3)


def blank(instrument):
    return instrument.reading({}, None, Target())


def simulated(instrument, pose, target, unknowns, variant):
    """(w,) the reading that leaves no residual."""
    return functions(instrument, variant)[1](pose[:3], target, unknowns, blank(instrument)).full()[:, 0]


def test_every_station_is_here():
    assert {kind for kind, _ in VARIED} == set(STATIONS)


@cases
@seeds
@pytest.mark.one_in(2)
def test_residual_and_jacobians_are_those_of_the_equations(kind, other, seed):
    rng = np.random.default_rng(seed)
    instrument = station(kind, **other)
    pose, unknowns = poses(rng, 1)[0], random_unknowns(instrument, rng)
    target = random_target(instrument, rng)
    for variant in instrument.variants:
        # Read elsewhere: not where the residual is small.
        reading = simulated(instrument, poses(rng, 1)[0], target, unknowns, variant)
        result = functions(instrument, variant)[0](pose[:3], target, unknowns, reading)
        residual, by_flange, by_target, by_unknowns = (each.full() for each in result)

        def plain(pose, target, unknowns):
            return plain_residual(instrument, pose, target, unknowns, reading, variant)  # noqa: B023

        np.testing.assert_allclose(residual[:, 0], plain(pose, target, unknowns), atol=1e-9)

        def moved(six):
            """The pose shifted by the first three and turned by the last three, in the base frame."""
            other = pose.copy()
            other[:3, :3] = Rotation.from_rotvec(six[3:]).as_matrix() @ pose[:3, :3]
            other[:3, 3] += six[:3]
            return other

        steps = np.array([1e-2] * 3 + [1e-5] * 3)
        expected = by_differences(lambda six: plain(moved(six), target, unknowns), np.zeros(6), steps)
        generators = [np.outer(np.eye(3)[i], [0, 0, 0, 1]) for i in range(3)]
        for i in range(3):
            turn = np.zeros((3, 4))
            turn[:, :3] = np.cross(np.eye(3)[i], pose[:3, :3], axisb=0, axisc=0)
            generators.append(turn)
        moves = np.column_stack([each.ravel(order="F") for each in generators])
        tolerances = {"rtol": 1e-6, "atol": 2e-5}
        np.testing.assert_allclose(by_flange @ moves, expected, **tolerances)
        units = {"mm": 1e-2, "deg": 1e-5}
        steps = np.array([units[each.unit] for each in instrument.unknowns])
        if len(steps):
            expected = by_differences(lambda x: plain(pose, target, x), unknowns, steps)
            np.testing.assert_allclose(by_unknowns, expected, **tolerances)
        if instrument.target_is != "nothing":
            units = [1e-2, 1e-5, 1e-5] if instrument.target_is == "plane" else [1e-2] * 3
            expected = by_differences(lambda x: plain(pose, x, unknowns), target, np.array(units))
            np.testing.assert_allclose(by_target, expected, **tolerances)
        else:
            assert not by_target.any()


@cases
@seeds
def test_the_predicted_reading_leaves_no_residual_and_a_shifted_recording_less_that_shift(kind, other, seed):
    rng = np.random.default_rng(seed)
    instrument = station(kind, **other)
    pose, unknowns = poses(rng, 1)[0], random_unknowns(instrument, rng)
    target = random_target(instrument, rng)
    if instrument.met:
        assert instrument.recorded(blank(instrument), np.zeros(1)) == {}
        return
    for variant in instrument.variants:
        residual, predicted = functions(instrument, variant)
        reading = predicted(pose[:3], target, unknowns, blank(instrument)).full()[:, 0]
        at = residual(pose[:3], target, unknowns, reading)[0].full()[:, 0]
        np.testing.assert_allclose(at, 0, atol=1e-9)
        shift = rng.normal(size=instrument.residual_size) * 0.3
        measured = instrument.recorded(reading, shift)
        assert {key: len(values) for key, values in measured.items()} == instrument.columns
        again = instrument.reading(measured, None, Target())
        at = residual(pose[:3], target, unknowns, again)[0].full()[:, 0]
        np.testing.assert_allclose(at, -shift, atol=1e-9)


@cases
def test_sizes_are_what_they_are_said_to_be(kind, other):
    instrument = station(kind, **other)
    assert blank(instrument).shape == (instrument.reading_size,)
    groups = [each.group for each in instrument.unknowns]
    assert groups == sorted(groups, key=["tool", "frame"].index)
    assert instrument.exact == (not groups)
    assert instrument.grounded == ("frame" in other)
    assert ("frame" in groups) == (hasattr(instrument, "frame") and other.get("frame") is not KNOWN)
    assert instrument.std == pytest.approx(STATED[kind]["sigma_mm"] if kind != "tracker" else 0.02)


STARTS = [
    *((kind, {}) for kind in STATED),
    *((kind, {"frame": frame}) for kind in ("tracker", "pose") for frame in (KNOWN, WITHIN)),
    ("tracker", {"reflectors": {"A": {}}}),
    ("tracker", {"reflectors": {"A": {"guess_mm": [0, 0, 10.0], "sigma_mm": 0.1}}}),
    ("pose", {"mount": {"guess_quat": [0.5, 0.5, -0.5, 0.5], "sigma_deg": 0.1}}),
    ("ballbar", {"bias": 1.5}),
]


@pytest.mark.parametrize(("kind", "other"), STARTS)
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.at_length(r"[1-9]$|^[2-7]")
def test_a_start_recovers_a_random_truth(kind, other, seed):
    rng = np.random.default_rng(seed)
    instrument = station(kind, **other)
    flange = poses(rng, 14)
    truth, target = random_unknowns(instrument, rng), random_target(instrument, rng)
    for i, each in enumerate(instrument.unknowns):
        if each.group == "frame" and each.tolerated:  # a start has it where it is stated
            truth[i] = each.mean
    variants = [instrument.variants[i % len(instrument.variants)] for i in range(14)]
    if kind == "plane":
        flange[:, :3, 3] = onto_plane(instrument, flange, truth, target)
    if kind == "sphere":
        tips = instrument.tips(flange, truth)
        rays = rng.normal(size=(14, 3))
        flange[:, :3, 3] += target + 18 * rays / np.linalg.norm(rays, axis=1)[:, None] - tips
    readings = np.array(
        [
            simulated(instrument, *each[:1], target, truth, each[1])
            for each in zip(flange, variants, strict=True)
        ]
    )
    means = np.array([each.mean for each in instrument.unknowns])
    known = np.array([each.tolerated for each in instrument.unknowns], dtype=bool)
    start = instrument.start_unknowns(flange, readings, np.where(known, truth, means), variants)
    residual = {variant: functions(instrument, variant)[0] for variant in instrument.variants}
    if instrument.target_is != "nothing":
        start_target = instrument.start_target(flange, readings, np.where(known, truth, means))
        np.testing.assert_allclose(start_target, target, rtol=1e-6, atol=1e-6)
        start = truth  # of the zero of a bar
        target = start_target
    else:
        np.testing.assert_array_equal(start[known], truth[known])
    for pose, reading, variant in zip(flange, readings, variants, strict=True):
        np.testing.assert_allclose(residual[variant](pose[:3], target, start, reading)[0], 0, atol=1e-5)


def onto_plane(instrument, flange, truth, target):
    """(N, 3) origins of the flange with the probe on the plane."""
    result = flange[:, :3, 3].copy()
    n = np.array(
        [
            plain_residual(
                instrument,
                np.block([[np.eye(3), e[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]),
                target,
                truth,
                None,
                "",
            )[0]
            for e in np.vstack([np.zeros(3), np.eye(3)])
        ]
    )
    normal = n[1:] - n[0]
    for i, pose in enumerate(flange):
        result[i] -= normal * plain_residual(instrument, pose, target, truth, None, "")[0]
    return result


@pytest.mark.parametrize("kind", ["tracker", "pose"])
@pytest.mark.parametrize("seed", range(6))
def test_a_start_is_near_with_noise_too(kind, seed):
    """With 1 mm and 1 mrad, of twelve measurements: no residual beyond five stds."""
    rng = np.random.default_rng(seed)
    instrument = station(kind, **({"reflectors": {"A": {}}} if kind == "tracker" else {}))
    residual, predicted = functions(instrument, instrument.variants[0])
    flange, truth = poses(rng, 12), random_unknowns(instrument, rng)
    stds = np.array([1, 1, 1, 1e-3, 1e-3, 1e-3])[: instrument.residual_size]
    readings = []
    for pose in flange:
        reading = predicted(pose[:3], np.zeros(3), truth, blank(instrument)).full()[:, 0]
        measured = instrument.recorded(reading, stds * rng.normal(size=len(stds)))
        readings.append(instrument.reading(measured, None, None))
    means = np.array([each.mean for each in instrument.unknowns])
    start = instrument.start_unknowns(flange, np.array(readings), means, [""] * 12)
    for pose, reading in zip(flange, readings, strict=True):
        at = residual(pose[:3], np.zeros(3), start, reading)[0].full()[:, 0]
        assert (np.abs(at) < 5 * stds).all()
        # Control: the guess is nowhere near.
        assert np.abs(residual(pose[:3], np.zeros(3), means, reading)[0].full()[:3]).max() > 20


@pytest.mark.parametrize("kind", ["tracker", "pose"])
def test_a_wrist_that_never_turns_leaves_the_guess_where_it_is(kind):
    """The mount and the frame's origin are then one: the start stays finite, near the guess, and fits."""
    rng = np.random.default_rng(3)
    reflectors = {"A": {"guess_mm": [10.0, 20, 30]}}
    instrument = station(kind, **({"reflectors": reflectors} if kind == "tracker" else {}))
    residual, predicted = functions(instrument, instrument.variants[0])
    flange, truth = poses(rng, 6), random_unknowns(instrument, rng)
    flange[:, :3, :3] = flange[0, :3, :3]
    readings = np.array(
        [predicted(pose[:3], np.zeros(3), truth, blank(instrument)).full()[:, 0] for pose in flange]
    )
    means = np.array([each.mean for each in instrument.unknowns])
    start = instrument.start_unknowns(flange, readings, means, [""] * 6)
    assert np.isfinite(start).all()
    assert np.abs(start[:3] - means[:3]).max() < 3000
    if kind == "tracker":
        for pose, reading in zip(flange, readings, strict=True):
            np.testing.assert_allclose(residual(pose[:3], np.zeros(3), start, reading)[0], 0, atol=1e-5)


def test_each_of_several_free_reflectors_is_recovered():
    rng = np.random.default_rng(5)
    instrument = station("tracker", reflectors={name: {} for name in "ABC"})
    flange, truth = poses(rng, 18), random_unknowns(instrument, rng)
    variants = list("ABC") * 6
    readings = np.array(
        [
            simulated(instrument, pose, np.zeros(3), truth, variant)
            for pose, variant in zip(flange, variants, strict=True)
        ]
    )
    means = np.array([each.mean for each in instrument.unknowns])
    start = instrument.start_unknowns(flange, readings, means, variants)
    np.testing.assert_allclose(start, truth, atol=1e-5)
    # Negative control: by another reflector the readings are not explained.
    assert not np.allclose(
        instrument.start_unknowns(flange, readings, means, variants[1:] + variants[:1]), truth, atol=1
    )


@pytest.mark.parametrize("axis", np.eye(3))
def test_the_axes_between_rotations_are_known(axis):
    """Twice the sine of 30° is 1: of a turn by 30° from the first rotation its axis, whatever that is."""
    first = Rotation.from_rotvec([0.3, -0.5, 0.7])
    turns = np.array([first.as_matrix(), (first * Rotation.from_rotvec(np.radians(30) * axis)).as_matrix()])
    np.testing.assert_allclose(_sine_axes(turns), [[0, 0, 0], axis], atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_points_on_a_line_leave_the_stated_normal(count):
    """A plane is turned about the line of the points no further than the statement says."""
    instrument = station("plane", exact=True)
    normal = np.array([0.0, 0.6, 0.8])
    along = np.array([1.0, 0.05, 0.1])
    flange = np.tile(np.eye(4), (count, 1, 1))
    flange[:, :3, 3] = np.outer(np.linspace(0, 300, count), along) + np.array([500, 0, 200])
    readings = np.tile(instrument.reading({}, None, Target(normal=tuple(normal))), (count, 1))
    target = instrument.start_target(flange, readings, np.zeros(0))
    residual, _ = functions(instrument, "")
    for pose, reading in zip(flange, readings, strict=True):
        np.testing.assert_allclose(residual(pose[:3], target, [], reading)[0], 0, atol=1e-9)
    level = normal if count == 1 else normal - (normal @ along) * along / (along @ along)
    tilt = np.arccos(level @ normal / np.linalg.norm(level))
    assert np.hypot(*np.tan(target[1:])) == pytest.approx(np.tan(tilt), abs=1e-9)


def test_a_dial_along_its_plane_has_no_travel_but_finite_numbers():
    instrument = station("dial", exact=True, direction=[1.0, 0, 0])
    reading = instrument.reading({}, None, Target(normal=(0.0, 0, 1)))
    values = functions(instrument, "")[0](np.eye(4)[:3], [300.0, 0, 0], [], reading)
    assert all(np.isfinite(each.full()).all() for each in values)
    assert abs(float(values[0])) > 1e9


def test_a_ball_is_touched_where_the_centres_are_its_radius_and_the_tips_apart():
    instrument, entry = station("sphere"), Target()
    centre = np.array(entry.guess_mm)
    away = instrument.goals(np.random.default_rng(1), 5, PlannedTarget(centre, entry)) - centre
    radii = (STATED["sphere"]["tip_diameter_mm"] + entry.diameter_mm) / 2
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), radii, rtol=1e-12)
