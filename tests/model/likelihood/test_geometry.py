"""The model with uncertain geometry against the plain one: residuals, Jacobians, likelihood, both kernels."""

import casadi as ca
import numpy as np
import pytest
from plain_geometry import UncertainArm, uncertain
from plain_model import DESIGNED, arm, beam, by_complex_steps, square, unit

from zerobeam.model.files.header import Header
from zerobeam.model.instruments.registry import kind_of
from zerobeam.model.likelihood.constraint import ShotFunctions
from zerobeam.model.likelihood.geometry import Geometry
from zerobeam.model.likelihood.problem import Problem

TOOLS = ("free laser", "free probe")
POINTS = 2
STATED = {"up": [0.2, -0.3, 1.0], "gravity": True}


class Case:
    """One arm with one tool, all of its geometry free, and random points with a fixed seed."""

    def __init__(self, own: UncertainArm, kind: str) -> None:
        self.own, self.robot, self.n, self.g = own, own.arm.robot, own.arm.robot.n, len(own.names)
        laser = kind == "free laser"
        direction = unit(np.array([0.1, -0.2, 1.0])) if laser else None
        point = np.array([12.0, -7.0, 65.0])
        self.tool = kind_of("laser" if laser else "probe")("tool", False, point, direction, 0.05, 10.0)
        self.functions = ShotFunctions(self.robot, self.tool, geometry=own.geometry)
        rng = np.random.default_rng(sum(map(ord, self.robot.name + kind)))
        self.points = [self.point(rng) for _ in range(POINTS)]

    def point(self, rng):
        """q, spot and free = (delta, geometry, target, tool); nothing is small, so that no term hides."""
        offsets = rng.uniform(-5, 5, self.n) / self.robot.display
        geometry = rng.uniform(-1, 1, self.g) * np.where(self.own.lengths, 20.0, np.radians(3.0))
        spot, tool = np.zeros(3), self.tool.point + rng.uniform(-30, 30, 3)
        if self.tool.name == "laser":
            spot = rng.uniform(-3, 3, 2)
            tool = np.append(rng.uniform(-0.2, 0.2, 2), rng.uniform(-20, 20, 2))
        free = np.concatenate([offsets, geometry, rng.uniform(-2000, 2000, 3), tool])
        return self.own.arm.random(rng), spot, free

    def split(self, free):
        a = self.n + self.g
        return free[:a], free[a : a + 3], free[a + 3 :]

    def hits(self):
        """The same points with the target within 2 mm of the beam, or of the tip."""
        rng = np.random.default_rng(8)
        for q, spot, free in self.points:
            values, _, tool = self.split(free)
            y = tool
            if self.tool.name == "laser":
                p, u = beam(self.tool, tool)
                y = p + 800 * u
            flange = self.own.pose(q, values).real
            target = flange[:3, 3] + flange[:3, :3] @ (y + rng.uniform(-2, 2, 3))
            yield q, spot, np.concatenate([values, target, tool])

    def linear(self, q, spot, free):
        residual, jacobian = self.functions.function("linear")(q, spot, *self.split(free))
        return np.array(residual).ravel(), np.array(jacobian)

    def plain(self, q, spot, free):
        return self.own.miss(self.tool, q, spot, free)


@pytest.fixture(scope="module")
def arms(request, tmp_path_factory):
    made = {}

    def of(name):
        if name not in made:
            data = request.getfixturevalue("shared_data") if name == "panda" else None
            panda = None if data is None else data / "mukca" / "urdf" / "panda.urdf"
            values = arm(name, tmp_path_factory.mktemp("arms"), panda)
            made[name] = uncertain(name, values, geometry_of(values.robot))
        return made[name]

    return of


def geometry_of(robot, **changes):
    noise = {"joint_deg": 0.01, "joint_mm": 0.01, "spot_mm": 0.05}
    tool = {"kind": "probe", "point_mm": [0, 0, 0]}
    content = {"robot": "x", "tool": tool, "noise": noise, "geometry": {**STATED, **changes}}
    return Geometry.from_header(Header.model_validate(content), robot)


@pytest.fixture(scope="module", params=[*DESIGNED, "panda"])
def arm_name(request):
    return request.param


@pytest.fixture(scope="module", params=TOOLS)
def case(request, arms, arm_name):
    return Case(arms(arm_name), request.param)


def test_the_arms_cover_every_kind_of_parameter(arms):
    axes = {axis for name in DESIGNED for _, axis in arms(name).names}
    assert axes == {"a", "b", "alpha", "d", "beta", "theta", "gravity", "cos", "sin"}


@pytest.mark.one_in(3)
def test_the_residual_against_plain_numpy(case):
    for q, spot, free in case.points:
        np.testing.assert_allclose(case.linear(q, spot, free)[0], case.plain(q, spot, free).real, atol=1e-9)


def test_the_jacobian_against_complex_steps_of_the_plain_model(case):
    """Exact but for the roundings of some 5000 mm. Every column matters at one point or another."""
    largest = 0.0
    for q, spot, free in case.points:
        expected = by_complex_steps(lambda z, q=q, s=spot: case.plain(q, s, z), free)
        np.testing.assert_allclose(case.linear(q, spot, free)[1], expected, rtol=0, atol=1e-8)
        largest = np.maximum(largest, np.abs(expected).max(axis=0))
    assert (largest[: case.n + case.g] > 0.01).all()


def variances(case):
    joints = np.where(case.robot.display == 1, 0.02, np.radians(0.01)) * np.linspace(1, 2, case.n)
    return np.append(joints**2, 0.05**2)


def shot_of(case, q, spot, free):
    recorded = case.own.geometry.recorded(case.robot, q[None])[0]
    return (recorded, spot, 1.0, *case.split(free), variances(case), variances(case))


@pytest.mark.parametrize(("name", "kind"), [("irb1600", "free laser"), ("bent", "free probe")])
def test_the_terms_and_their_gradient_against_the_plain_model(arms, name, kind):
    """S by the columns of the offsets, at the true joints and links."""
    case = Case(arms(name), kind)

    def quad(q, spot, free):
        m, s = case.plain(q, spot, free), case.own.covariance(case.tool, q, spot, free, variances(case))
        return square(m, s)

    for q, spot, free in case.hits():
        result, logdet, gradient, *_ = (
            np.array(each).ravel()
            for each in case.functions.function("slopes")(*shot_of(case, q, spot, free))
        )
        np.testing.assert_allclose(result, [quad(q, spot, free).real], rtol=1e-8)
        assert logdet == 0
        expected = by_complex_steps(lambda z, q=q, s=spot: quad(q, s, z), free)
        np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-3)


def test_what_is_recorded_is_that_of_the_symbols(case):
    """The likelihood takes torques as numbers, the residual makes them of q: they are the same."""
    q = ca.SX.sym("q", case.n)
    symbols = ca.Function("recorded", [q], [case.own.geometry.recorded_symbols(case.robot, q)])
    joints = np.array([point[0] for point in case.points])
    for row, other in zip(case.own.geometry.recorded(case.robot, joints), joints, strict=True):
        np.testing.assert_allclose(row, np.array(symbols(other)).ravel(), rtol=0, atol=1e-12)
    assert case.own.geometry.recorded(case.robot, joints[:0]).shape == (0, row.size)


def test_at_zero_the_geometry_is_nominal(case):
    """Residuals, and the columns of all else, are those of the arm without the parameters."""
    nominal = ShotFunctions(case.robot, case.tool).function("linear")
    for q, spot, free in case.points:
        at_zero = free.copy()
        at_zero[case.n : case.n + case.g] = 0.0
        residual, jacobian = case.linear(q, spot, at_zero)
        values, target, tool = case.split(at_zero)
        expected = [np.array(each) for each in nominal(q, spot, values[: case.n], target, tool)]
        np.testing.assert_allclose(residual, expected[0].ravel(), rtol=0, atol=1e-10)
        others = np.delete(jacobian, np.s_[case.n : case.n + case.g], axis=1)
        np.testing.assert_allclose(others, expected[1], rtol=0, atol=1e-9)


def test_a_header_of_exact_geometry_has_the_functions_of_the_nominal_arm(arms):
    """And one without the key those of a typical arm, its calibrated tool included."""
    robot = arms("irb1600").arm.robot
    content = {"robot": "irb1600", "tool": {"kind": "probe", "point_mm": [0, 0, 65]}}
    content["noise"] = {"joint_deg": 0.01, "spot_mm": 0.05}
    joints = np.random.default_rng(0).uniform(-1, 1, (4, 6))
    plain = Problem.build(Header.model_validate({**content, "geometry": "exact"}), robot, joints, ["a"] * 4)
    freed = Problem.build(Header.model_validate(content), robot, joints, ["a"] * 4)
    assert not plain.geometry
    assert plain.parameters.names == freed.parameters.without("geometry").without("tool").names
    assert plain.data_size == 12
    # Of the links link1.d is held; of the probe there are three coordinates.
    assert len(freed.tolerated) == freed.parameters.group("geometry").sum() - 1 + 3
    assert freed.data_size == 12 + len(freed.tolerated)
    x = freed.nominal()
    kept = ~(freed.parameters.group("geometry") | freed.parameters.group("tool"))
    np.testing.assert_allclose(x[kept], plain.nominal(), rtol=0, atol=1e-9)
    np.testing.assert_allclose(freed.whiten(x).residual, plain.whiten(x[kept]).residual, rtol=1e-9)
