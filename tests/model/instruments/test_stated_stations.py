"""What a header may state of each kind, and what follows from it: unknowns, their priors, and refusals."""

import numpy as np
import pytest
from plain_stations import KNOWN, STATED, Target, station

from zerobeam.model.errors import BadInput
from zerobeam.model.instruments.registry import STATIONS


def facts(instrument):
    """(name, std in mm or degrees, tolerated) of each unknown."""
    return [
        (f"{each.of}.{each.axis}", np.degrees(each.std) if each.unit == "deg" else each.std, each.tolerated)
        for each in instrument.unknowns
    ]


def block(of, axes, std, tolerated=False):
    return [(f"{of}.{axis}", pytest.approx(std), tolerated) for axis in axes]


TURNS = ("rx", "ry", "rz")
FRAME = [*block("S", "xyz", 10_000), *block("S", TURNS, 180)]


def test_unknowns_of_a_tracker():
    instrument = station("tracker")
    assert facts(instrument) == [*block("S.A", "xyz", 0.5, True), *block("S.B", "xyz", 500), *FRAME]
    assert [each.mean for each in instrument.unknowns[:3]] == [10, 20, 30]
    assert [each.group for each in instrument.unknowns] == ["tool"] * 6 + ["frame"] * 6
    assert instrument.variants == ("A", "B")
    assert not instrument.calibrated
    assert not instrument.turns  # A says how the flange is turned
    assert station("tracker", reflectors={"B": {}}).turns
    assert len(station("tracker", frame=KNOWN).unknowns) == 6


def test_unknowns_of_a_pose():
    assert facts(station("pose")) == [
        *block("S.mount", "xyz", 500),
        *block("S.mount", TURNS, 180),
        *FRAME,
    ]
    assert station("pose").turns
    mount = {"guess_mm": [1.0, 2, 3], "sigma_mm": 0.3, "guess_quat": [1.0, 0, 0, 0], "sigma_deg": 0.2}
    known = station("pose", mount=mount, frame=KNOWN)
    assert facts(known) == [*block("S.mount", "xyz", 0.3, True), *block("S.mount", TURNS, 0.2, True)]
    assert known.calibrated
    assert not known.turns
    assert known.known_to == pytest.approx(0.2)
    # An orientation that is known holds the last offset, whatever is known of the position.
    assert not station("pose", mount={"guess_quat": [1.0, 0, 0, 0], "sigma_deg": 0.2}).turns


@pytest.mark.parametrize("kind", ["plane", "sphere", "ballbar", "dial"])
def test_a_tip_is_known_to_what_is_stated_and_else_to_a_tenth(kind):
    other = {"bias": 0.0} if kind == "ballbar" else {}
    assert facts(station(kind, **other)) == block("S.tip", "xyz", 0.1, True)
    assert facts(station(kind, **other, tip_sigma_mm=2.0)) == block("S.tip", "xyz", 2.0, True)
    assert facts(station(kind, **other, exact=True)) == []
    assert facts(station(kind, **other, exact=True, tip_sigma_mm=2.0)) == block("S.tip", "xyz", 2.0, True)
    assert station(kind, **other).calibrated


def test_a_free_zero_of_a_bar_is_no_knowledge_and_its_tip_is_known_all_the_same():
    instrument = station("ballbar")
    assert facts(instrument)[3:] == block("S", ["bias"], 500)
    assert instrument.calibrated


@pytest.mark.parametrize("kind", ["plane", "dial"])
def test_unknowns_of_a_plane(kind):
    d, tilt1, tilt2 = station(kind).coordinates(Target(guess_mm=(0.0, 0, 300), normal=(0.0, 0, 2)))
    assert (d.axis, d.mean, d.std) == ("d", 300, 20)
    assert [tilt1.axis, tilt2.axis] == ["tilt1", "tilt2"]
    assert tilt1.std == tilt2.std == np.radians(5)
    # A point a metre beside the normal: 5° there are 87 mm.
    (d, *_) = station(kind).coordinates(Target(guess_mm=(600.0, 800, 300), normal=(0.0, 0, 2)))
    assert d.std == pytest.approx(np.hypot(20, 1000 * np.radians(5)))


@pytest.mark.parametrize(
    ("kind", "target"),
    [
        ("plane", None),
        ("plane", Target(normal=None)),
        ("plane", Target(normal=(0.0, 0, 0))),
        ("dial", Target(normal=None)),
        ("sphere", None),
        ("sphere", Target(diameter_mm=None)),
    ],
)
def test_a_target_that_lacks_what_its_kind_needs_is_refused(kind, target):
    instrument = station(kind)
    with pytest.raises(BadInput, match=r"without a (normal|diameter)"):
        instrument.coordinates(target)
    if target is None or target.normal != (0.0, 0, 0):  # what does not read there stays finite
        assert np.isfinite(instrument.reading({}, None, target)).all()


SIGMA = {"A": {"guess_mm": [1.0, 2, 3], "sigma_mm": 0.5}}


@pytest.mark.parametrize(
    ("kind", "other", "what", "mends"),
    [
        ("tracker", {"frame": "fixed"}, "says nothing of the instrument's frame", {"frame": "free"}),
        ("tracker", {"frame": {"xyz_mm": [1.0, 2, 3]}}, "the key 'quat' is missing", {"frame": KNOWN}),
        (
            "tracker",
            {"frame": {**KNOWN, "quat": [1.0, 1, 0, 0]}},
            "quaternion is not of length 1",
            {"frame": KNOWN},
        ),
        ("tracker", {"sigma_mm": -0.1}, "out of range", {"sigma_mm": 0.1}),
        ("tracker", {"sigma_mm": "good"}, "no standard deviation", {"sigma_mm": 0.1}),
        ("tracker", {"sigma_mm": [0.1, 0.1]}, "list of 3 values", {"sigma_mm": [0.1, 0.1, 0.2]}),
        ("tracker", {"sigma_mm": [0.1, 0.1, 0]}, "out of range", {"sigma_mm": [0.1, 0.1, 0.2]}),
        (
            "tracker",
            {"sigma_mm": {"constant": 0.1}},
            "'per_m' is missing",
            {"sigma_mm": {"constant": 0.1, "per_m": 0}},
        ),
        (
            "tracker",
            {"sigma_mm": {"constant": 0, "per_m": 0.1}},
            "out of range",
            {"sigma_mm": {"constant": 0.1, "per_m": 0.1}},
        ),
        ("tracker", {"reflectors": {}}, "short|empty", {"reflectors": SIGMA}),
        ("tracker", {"reflectors": {"A": {"sigma_mm": 0.5}}}, "without a position", {"reflectors": SIGMA}),
        ("tracker", {"reflector": SIGMA}, "unknown key 'reflector'", {"reflectors": SIGMA}),
        ("pose", {"sigma_deg": 0}, "out of range", {"sigma_deg": 0.1}),
        ("pose", {"mount": {"guess_quat": [2.0, 0, 0, 0]}}, "not of length 1", {"mount": {}}),
        ("pose", {"mount": {"guess_quat": [1.0, 0, 0]}}, "list of 4 values", {"mount": {}}),
        ("pose", {"mount": {"sigma_deg": 1.0}}, "without guess_quat", {"mount": {}}),
        ("pose", {"mount": {"sigma_mm": 1.0}}, "without guess_mm", {"mount": {}}),
        ("plane", {"tip_diameter_mm": -1}, "out of range", {"tip_diameter_mm": 1}),
        ("sphere", {"tip_mm": [1.0, 2]}, "list of 3 values", {"tip_mm": [1.0, 2, 3]}),
        ("sphere", {"tip_sigma_mm": 0}, "out of range", {"tip_sigma_mm": 0.1}),
        ("ballbar", {"bias": "unknown"}, "no zero of a length", {"bias": "free"}),
        ("ballbar", {"bias": True}, "no zero of a length", {"bias": 1}),
        ("dial", {"direction": [0.0, 0, 0]}, "no length", {"direction": [0, 0, 1]}),
        ("dial", {"direction": [1.0]}, "list of 3 values", {"direction": [0, 0, 1]}),
    ],
)
def test_bad_input_is_refused_once_and_clearly(kind, other, what, mends):
    with pytest.raises(BadInput, match=what) as refused:
        station(kind, **other)
    assert "<" not in str(refused.value)  # no names of alternatives
    station(kind, **mends)


@pytest.mark.parametrize("kind", STATED)
def test_what_is_missing_is_named(kind):
    sigma = STATED[kind]["sigma_mm"]
    try:
        del STATED[kind]["sigma_mm"]
        with pytest.raises(BadInput, match="the key 'sigma_mm' is missing"):
            station(kind)
    finally:
        STATED[kind]["sigma_mm"] = sigma


def test_readings_that_are_no_readings_are_refused():
    with pytest.raises(BadInput, match="not of length 1"):
        station("pose").reading({"measured_quat": (1.0, 1.0, 0, 0)}, None, None)
    two = station("tracker")
    with pytest.raises(BadInput, match="no such reflector") as refused:
        two.start_unknowns(np.eye(4)[None], np.zeros((1, 7)), np.zeros(12), ["C"])
    assert refused.value.allowed == "A, B"
    with pytest.raises(BadInput, match="no such reflector"):
        two.start_unknowns(np.eye(4)[None], np.zeros((1, 7)), np.zeros(12), [""])


def test_the_noise_of_a_tracker_grows_with_its_range_unless_a_measurement_states_it():
    instrument = station("tracker")  # 0.02 mm, and 0.01 mm for each metre
    far = {"measured_mm": (0.0, 3000.0, 4000.0)}
    expected = np.hypot(0.02, 0.05) / 0.02
    np.testing.assert_allclose(instrument.reading(far, None, None)[-3:], expected, rtol=1e-15)
    np.testing.assert_allclose(instrument.reading(far, 0.06, None)[-3:], 3.0, rtol=1e-15)
    each = station("tracker", sigma_mm=[0.1, 0.2, 0.05])
    assert each.std == 0.2
    np.testing.assert_allclose(each.reading(far, None, None)[-3:], [0.5, 1, 0.25])


def test_the_noise_of_a_pose_is_that_of_position_and_rotation():
    instrument = station("pose")  # 0.05 mm and 0.02°
    position, rotation = instrument.noises
    assert (position.name, position.unit) == (instrument.label, "mm")
    assert (rotation.name, rotation.unit) == (f"{instrument.label}.rotation", "deg")
    stds = np.array([position.std, rotation.std])[instrument.layout.noise]
    np.testing.assert_allclose(
        stds * instrument.reading({}, None, None)[-6:], [0.05] * 3 + [np.radians(0.02)] * 3
    )
    # Of a measurement that states its own, the position alone.
    stds = stds * instrument.reading({}, 0.1, None)[-6:]
    np.testing.assert_allclose(stds, [0.1] * 3 + [np.radians(0.02)] * 3)


@pytest.mark.parametrize("kind", STATED)
def test_the_key_is_the_same_for_the_same_functions_alone(kind):
    other = {
        "tracker": {"frame": KNOWN},
        "pose": {"mount": {}},
        "plane": {"tip_diameter_mm": 5.0},
        "sphere": {"tip_diameter_mm": 5.0},
        "ballbar": {"bias": 1.0},
        "dial": {"direction": [1.0, 0, 0]},
    }[kind]
    assert station(kind).key == station(kind).key
    assert station(kind).key != station(kind, **other).key
    if "tip_mm" in STATED[kind]:  # a tip that is estimated is an input of the functions
        assert station(kind).key == station(kind, tip_mm=[0.0, 0, 1]).key
        exact = station(kind, exact=True)
        assert exact.key != station(kind, exact=True, tip_mm=[0.0, 0, 1]).key
        assert exact.key != station(kind).key


def test_keys_of_kinds_differ():
    assert len({station(kind).key for kind in STATIONS}) == len(STATIONS)
