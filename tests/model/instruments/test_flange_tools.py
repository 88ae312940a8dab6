from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from plain_model import beam, by_differences, unit

from zerobeam.model.files.header import Header
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.instruments.flange_tool import LaserBeam


def header(**tool):
    noise = {"joint_deg": 0.01, "spot_mm": 0.05}
    return Header.model_validate({"robot": "irb1600", "tool": tool, "noise": noise, "geometry": "exact"})


def instrument(stated):
    return stated.made("tool", load_robot("irb1600", Path()).n)


def laser(direction, *, calibrated=False, point=(0.0, 0.0, 65.0)):
    u = np.array(direction, dtype=float)
    return LaserBeam("tool", calibrated, np.array(point), u / np.linalg.norm(u), np.radians(3), 10.0)


def at(tool, unknowns=()):
    """p (3,), u (3,), B (3, 2) of a laser."""
    symbol = ca.SX.sym("tool", len(tool.unknowns))
    function = ca.Function("beam", [symbol], list(tool.beam_frame(symbol)), ["tool"], ["p", "u", "B"])
    p, u, basis = function(np.array(unknowns, dtype=float))
    return np.array(p).ravel(), np.array(u).ravel(), np.array(basis)


def test_a_laser_from_a_header():
    tool = instrument(
        header(
            kind="laser", point_mm=[1, 2, 65], direction=[0, 0, 5], calibrated=False, sigma={"tilt_deg": 2}
        )
    )
    assert (tool.name, tool.calibrated, tool.residual_size) == ("laser", False, 2)
    np.testing.assert_array_equal(tool.point, [1, 2, 65])
    np.testing.assert_array_equal(tool.direction, [0, 0, 1])  # of unit length
    assert tool.tilt_std == pytest.approx(2 * np.pi / 180)  # rad inside
    assert tool.shift_std == 10.0
    assert [each.axis for each in tool.unknowns] == ["tilt1", "tilt2", "shift1", "shift2"]


def test_a_probe_from_a_header():
    tool = instrument(header(kind="probe", point_mm=[0, 0, 100], calibrated=False))
    assert (tool.direction, tool.residual_size, tool.shift_std) == (None, 3, 50.0)
    assert [each.axis for each in tool.unknowns] == ["x", "y", "z"]
    with pytest.raises(ValueError, match="no beam"):
        tool.nominal_beam()


@pytest.mark.parametrize("content", [{"kind": "laser", "direction": [1, 0, 0]}, {"kind": "probe"}])
def test_of_a_calibrated_tool_nothing_is_unknown(content):
    tool = instrument(header(**content, point_mm=[3, 0, 65]))
    assert tool.calibrated
    assert tool.unknowns == ()
    if tool.beam:
        p, u, _ = at(tool)
        np.testing.assert_array_equal(p, [3, 0, 65])
        np.testing.assert_array_equal(u, [1, 0, 0])
    else:
        np.testing.assert_array_equal(np.array(ca.DM(ca.evalf(tool.tip_at(ca.SX(0, 1))))).ravel(), [3, 0, 65])


def test_the_tip_of_an_uncalibrated_probe_is_the_unknown_itself():
    tool = instrument(header(kind="probe", point_mm=[3, 0, 65], calibrated=False))
    tip = ca.evalf(tool.tip_at(ca.SX([1.0, 2.0, 3.0])))
    np.testing.assert_array_equal(np.array(ca.DM(tip)).ravel(), [1, 2, 3])


@pytest.mark.parametrize(
    ("nominal", "b1", "b2"),
    [("x", "y", "z"), ("y", "z", "x"), ("z", "x", "y")],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_the_axes_across_the_nominal_beam(nominal, b1, b2, sign):
    """Backwards beams too: the axes follow from the beam's axis alone, not from its sense."""
    axis = dict(zip("xyz", np.eye(3), strict=True))
    tool = laser(sign * axis[nominal])
    p, u, basis = at(tool, [0, 0, 0, 0])
    np.testing.assert_array_equal(p, [0, 0, 65])
    np.testing.assert_array_equal(u, sign * axis[nominal])
    np.testing.assert_array_equal(basis, np.array([axis[b1], axis[b2]]).T)
    for k, b in enumerate((b1, b2)):
        unknowns = np.zeros(4)
        unknowns[k] = np.radians(10)
        _, u, _ = at(tool, unknowns)
        # A tilt of 10 degrees is an angle of 10 degrees, towards b.
        expected = np.cos(np.radians(10)) * sign * axis[nominal] + np.sin(np.radians(10)) * axis[b]
        np.testing.assert_allclose(u, expected, atol=1e-15)
        unknowns = np.zeros(4)
        unknowns[2 + k] = 7.0
        p, u, _ = at(tool, unknowns)
        np.testing.assert_array_equal(p, [0, 0, 65] + 7 * axis[b])
        np.testing.assert_array_equal(u, sign * axis[nominal])


@pytest.mark.parametrize(
    ("direction", "axis"),
    [((1, 0.3, -0.2), 0), ((0.4, -2, 0.5), 1), ((0.1, 0.1, -1), 2), ((1, 1, 1), 0)],
)
def test_askew_beams_take_the_axis_that_they_are_nearest_to(direction, axis):
    tool = laser(direction)
    rng = np.random.default_rng(4)
    for _ in range(5):
        unknowns = np.append(rng.uniform(-0.2, 0.2, 2), rng.uniform(-20, 20, 2))
        p, u, basis = at(tool, unknowns)
        want_p, want_u = beam(tool, unknowns)
        np.testing.assert_allclose(p, want_p, atol=1e-12)
        np.testing.assert_allclose(u, want_u, atol=1e-14)
        square = np.column_stack([basis, u])
        np.testing.assert_allclose(square.T @ square, np.eye(3), atol=1e-14)
        # b1 has no part along the second axis across: it is the first, made square to u.
        first, second = {0: (1, 2), 1: (2, 0), 2: (0, 1)}[axis]
        expected = unit(np.eye(3)[first] - u[first] * u)
        np.testing.assert_allclose(basis[:, 0], expected, atol=1e-14)
        assert basis[second, 1] > 0.5


def stacked(line, unknowns, points):
    """Misses of the beam against some points seen from the flange, on a basis that does not move."""
    p, u = line(unknowns)
    rest = points - p
    return (rest - np.outer((rest * u).sum(axis=1), u)).ravel()


def test_the_four_unknowns_are_regular_about_a_beam_along_x():
    """The derivative of the misses at points 0.5 to 1.5 m away by tilts (per m) and shifts has rank 4."""
    tool = laser([1, 0, 0], point=(0, 0, 65))
    rng = np.random.default_rng(6)
    points = np.array([0, 0, 65]) + np.outer(rng.uniform(500, 1500, 5), [1, 0, 0]) + rng.normal(size=(5, 3))
    jacobian = by_differences(
        lambda z: stacked(lambda k: at(tool, k)[:2], z, points), np.zeros(4), np.array([1e-3, 1e-3, 1, 1])
    )
    singular = np.linalg.svd(jacobian / [1000, 1000, 1, 1], compute_uv=False)
    assert singular[-1] > 0.1 * singular[0]
