import warnings

import casadi as ca
import numpy as np
import pytest
from plain_model import (
    DESIGNED,
    Arm,
    across,
    arm,
    beam,
    by_complex_step,
    by_complex_steps,
    covariance,
    miss,
    terms,
    unit,
)

from zerobeam.model import kernel
from zerobeam.model.instruments.registry import kind_of
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.constraint import ShotFunctions

# Per arm a beam along an axis of the flange or askew to it, forwards or backwards.
DIRECTION = {
    "irb1600": (1.0, 0.0, 0.0),
    "modified": (0.1, -0.2, -1.0),
    "scara": (0.3, 1.0, 0.2),
    "gantry": (0.0, 0.0, 1.0),
    "bent": (-1.0, 0.1, 0.3),
    "panda": (0.0, -1.0, 0.0),
}
TOOLS = ("laser", "laser, uncalibrated", "probe", "probe, uncalibrated")
POINTS = 2  # random points for each arm and tool


class Case:
    """One arm with one tool, its functions, and random points with a fixed seed."""

    def __init__(self, own: Arm, name: str, kind: str) -> None:
        self.arm, self.robot, self.n = own, own.robot, own.robot.n
        laser = kind.startswith("laser")
        self.tool = kind_of("laser" if laser else "probe")(
            "tool",
            "uncalibrated" not in kind,
            np.array([12.0, -7.0, 65.0]),
            unit(np.array(DIRECTION[name])) if laser else None,
            np.radians(3),
            10.0,
        )
        self.functions = ShotFunctions(self.robot, self.tool)
        self.by_log_det = {
            which: ShotFunctions(self.robot, self.tool, which) for which in ("none", "relative", "whole")
        }
        seed = [sorted(DIRECTION).index(name), TOOLS.index(kind)]
        rng = np.random.default_rng(seed)
        self.points = [self.point(rng) for _ in range(POINTS)]

    def unknowns(self, rng: np.random.Generator) -> np.ndarray:
        if self.tool.calibrated:
            return np.zeros(0)
        if self.tool.name == "probe":
            return self.tool.point + rng.uniform(-30, 30, 3)
        return np.append(rng.uniform(-0.2, 0.2, 2), rng.uniform(-20, 20, 2))

    def offsets(self, rng: np.random.Generator) -> np.ndarray:
        return rng.uniform(-5, 5, self.n) / self.robot.display  # degrees, mm

    def point(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, spot and free = (delta, target, tool): the target is anywhere, so that no residual is small."""
        spot = rng.uniform(-3, 3, 2) if self.tool.name == "laser" else np.zeros(3)
        target = rng.uniform(-2000, 2000, 3)
        free = np.concatenate([self.offsets(rng), target, self.unknowns(rng)])
        return self.arm.random(rng), spot, free

    def hits(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """The same points with each target within 2 mm of the beam, some 900 mm away, or of the tip."""
        rng = np.random.default_rng(5)
        result = []
        for q, spot, free in self.points:
            delta, unknowns = free[: self.n], free[self.n + 3 :]
            y = unknowns if len(unknowns) else self.tool.point
            if self.tool.name == "laser":
                p, u = beam(self.tool, unknowns)
                y = p + rng.uniform(600, 1200) * u
            flange = self.arm.pose(q + delta).real
            target = flange[:3, 3] + flange[:3, :3] @ (y + rng.uniform(-2, 2, 3))
            result.append((q, spot, np.concatenate([delta, target, unknowns])))
        return result

    def call(self, name: str, *inputs: np.ndarray, log_det: str = "none") -> list[np.ndarray]:
        """The outputs of one of the functions: (size,) of a vector, (rows, columns) of a matrix."""
        outputs = self.by_log_det[log_det].function(name)(*inputs)
        outputs = outputs if isinstance(outputs, tuple) else (outputs,)
        return [dense(each) if 1 in each.shape else np.array(each) for each in outputs]

    def weighted(self, name, q, spot, free, log_det="whole", weight=1.0, variances=None):
        """`terms` or `slopes` at a shot, at other variances than the stated ones."""
        content = self.variances()
        noise = (content if variances is None else variances, content)
        shot = (self.robot.recorded_turns(q), spot, weight, *self.split(free), *noise)
        shot = [np.atleast_1d(np.asarray(part, dtype=float)) for part in shot]
        return [np.atleast_1d(part[0]) for part in self.by_log_det[log_det].kernel(name)(*shot)]

    def split(self, free: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return free[: self.n], free[self.n : self.n + 3], free[self.n + 3 :]

    def plain(self, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
        return miss(self.arm.pose, self.tool, q, spot, free)

    def miss(self, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
        return self.call("linear", q, spot, *self.split(free))[0]

    def jacobian(self, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
        return np.array(self.functions.function("linear")(q, spot, *self.split(free))[1])

    def steps(self, rad: float = 1e-3, mm: float = 1.0) -> np.ndarray:
        offsets = np.where(self.robot.display == 1, mm, rad)
        tool = [] if self.tool.calibrated else [mm] * 3 if self.tool.name == "probe" else [rad, rad, mm, mm]
        return np.concatenate([offsets, [mm] * 3, tool])

    def variances(self) -> np.ndarray:
        joints = np.where(self.robot.display == 1, 0.02, np.radians(0.01)) * np.linspace(1, 2, self.n)
        return np.append(joints**2, 0.05**2)

    def covariance(self, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
        return covariance(self.arm, self.tool, q, spot, free, self.variances()).real

    def plain_terms(
        self, q: np.ndarray, spot: np.ndarray, z: np.ndarray, log_det: str = "whole"
    ) -> np.ndarray:
        """(..., 2) quad, logdet of the plain model; z is free and, if longer, the logarithms of the noise
        factors of joints and spot."""
        size = len(self.steps())
        factors = np.exp(2 * z[..., size:]) if z.shape[-1] > size else np.ones(2)
        variances = self.variances() * np.repeat(factors, (self.n, 1), axis=-1)
        result = terms(self.arm, self.tool, q, spot, z[..., :size], variances)
        if log_det == "none":
            result[..., 1] = 0
        elif log_det == "relative":
            result[..., 1] -= terms(self.arm, self.tool, q, spot, z[..., :size], self.variances())[..., 1]
        return result


def dense(value: ca.DM) -> np.ndarray:
    return np.array(value).ravel()


@pytest.fixture(scope="module")
def cases(request, tmp_path_factory):
    made: dict[tuple[str, str], Case] = {}
    arms: dict[str, Arm] = {}

    def of(name: str, kind: str) -> Case:
        if name not in arms:
            # Asked for only here: where the recordings are missing, the other arms are tested all the same.
            data = request.getfixturevalue("shared_data") if name == "panda" else None
            panda = None if data is None else data / "mukca" / "urdf" / "panda.urdf"
            arms[name] = arm(name, tmp_path_factory.mktemp("arms"), panda)
        if (name, kind) not in made:
            made[name, kind] = Case(arms[name], name, kind)
        return made[name, kind]

    return of


@pytest.fixture(params=[*DESIGNED, "panda"], scope="module")
def arm_name(request):
    return request.param


@pytest.fixture(params=TOOLS, scope="module")
def case(request, cases, arm_name):
    return cases(arm_name, request.param)


@pytest.mark.one_in(2)
def test_the_miss_against_plain_numpy(case):
    for q, spot, free in case.points:
        expected = case.plain(q, spot, free)
        assert np.abs(expected).max() > 10  # the residuals are large: no term hides
        np.testing.assert_allclose(case.miss(q, spot, free), expected.real, rtol=0, atol=1e-9)


def test_the_jacobian_against_complex_steps_of_the_plain_model(case):
    """No step error: only the roundings of some 5000 mm. Every column matters at one point or another."""
    largest = 0.0
    for q, spot, free in case.points:
        expected = by_complex_steps(lambda z, q=q, s=spot: case.plain(q, s, z), free)
        np.testing.assert_allclose(case.jacobian(q, spot, free), expected, rtol=0, atol=1e-9)
        largest = np.maximum(largest, np.abs(expected).max(axis=0))
    assert (largest > 0.1).all()


def test_the_plain_covariance_is_that_of_the_derivative_by_the_joints(case):
    """So that the second model of S is not wrong in the same way: complex steps instead of quarter turns."""
    for q, spot, free in case.points:
        by_joints = by_complex_steps(lambda z, s=spot, f=free: case.plain(z, s, f), q)
        variances = case.variances()
        expected = by_joints @ np.diag(variances[:-1]) @ by_joints.T + variances[-1] * np.eye(len(by_joints))
        np.testing.assert_allclose(case.covariance(q, spot, free), expected, rtol=1e-9, atol=1e-12)


LOG_DETS = pytest.mark.parametrize("log_det", ["none", "relative", "whole"])


@LOG_DETS
@pytest.mark.one_in(4)
def test_the_log_determinant_that_is_asked_for(case, log_det):
    """None, that relative to the stated noise, or the whole; at twice the joints' noise."""
    variances = case.variances() * np.append(np.full(case.n, 4.0), 1.0)
    for q, spot, free in case.hits():
        quad, logdet = case.plain_terms(q, spot, np.append(free, [np.log(2), 0.0]), log_det)
        for name in ("terms", "slopes"):
            result = case.weighted(name, q, spot, free, log_det, variances=variances)[:2]
            np.testing.assert_allclose(np.concatenate(result), [quad.real, logdet.real], rtol=1e-9, atol=1e-9)
        # At the noise that is stated, nothing is relative to it.
        (at_stated,) = case.weighted("terms", q, spot, free, log_det)[1]
        assert (abs(at_stated) < 1e-12) == (log_det != "whole")


@LOG_DETS
@pytest.mark.parametrize("name", ["terms", "slopes"])
@pytest.mark.at_length(r"-(modified|scara|bent)-")
def test_the_weight_multiplies_all_that_a_shot_adds(case, name, log_det):
    q, spot, free = case.hits()[0]
    variances = 4 * case.variances()
    whole = case.weighted(name, q, spot, free, log_det, variances=variances)
    quarter = case.weighted(name, q, spot, free, log_det, 0.25, variances)
    for value, part in zip(whole, quarter, strict=True):
        np.testing.assert_allclose(part, 0.25 * value, rtol=1e-13)
    for value in case.weighted(name, q, spot, free, log_det, 0.0, variances):
        np.testing.assert_array_equal(value, 0)
    message = whole if name == "terms" or log_det == "relative" else [*whole[:4], whole[5]]
    assert all(np.abs(value).max() > 1e-6 for value in message) == (log_det != "none")


@LOG_DETS
@pytest.mark.one_in(3)
def test_the_gradients_against_complex_steps_of_the_plain_terms(case, log_det):
    """No step error: what is left is the rounding of the miss, some 1e-11 mm, times J / sigma^2 = 2000 mm /
    (0.05 mm)^2, and as much of S. Where the log det is relative, by the noise factors as well, at others
    than 1; the variances that are handed in are those after the factors."""
    logs = np.array([0.7, -0.4]) if log_det == "relative" else np.zeros(0)
    factors = np.exp(2 * np.append(np.repeat(logs[0], case.n), logs[1])) if len(logs) else 1.0
    for q, spot, free in case.hits():
        expected = by_complex_steps(
            lambda z, q=q, s=spot: case.plain_terms(q, s, z, log_det), np.append(free, logs)
        )
        gradients = case.weighted("slopes", q, spot, free, log_det, variances=case.variances() * factors)[2:4]
        np.testing.assert_allclose(gradients, expected, rtol=1e-8, atol=1e-4)
        if log_det == "relative":
            values = np.array(gradients)[:, -2:]
            np.testing.assert_allclose(values, expected[:, -2:], rtol=1e-9, atol=1e-9)
            # Negative control: by the factors themselves they would be others.
            assert np.abs(values / np.exp(logs) - expected[:, -2:]).max() > 0.01


def lower_of(flat: np.ndarray) -> np.ndarray:
    """The symmetric matrix whose lower triangle stands row by row in `flat`."""
    size = int(np.sqrt(2 * len(flat)))
    matrix = np.zeros((size, size))
    matrix[np.tril_indices(size)] = flat
    return matrix + np.tril(matrix, -1).T


@LOG_DETS
@pytest.mark.one_in(3)
def test_the_information_of_the_misses(case, log_det):
    """J' S^-1 J from plain numpy, each entry in units of those on the diagonal."""
    size = len(case.steps())
    for q, spot, free in case.points:
        s = case.covariance(q, spot, free)
        jacobian = by_complex_steps(lambda z, q=q, p=spot: case.plain(q, p, z), free)
        expected = jacobian.T @ np.linalg.solve(s, jacobian)
        unit = np.outer(*2 * [1 / np.sqrt(np.diag(expected))])
        result = lower_of(case.weighted("slopes", q, spot, free, log_det)[5])
        assert result.shape == (size, size)
        np.testing.assert_allclose(result * unit, expected * unit, rtol=0, atol=1e-9)
        # Negative controls: with the spot's noise alone, and with the components' noise not correlated.
        for other in (case.variances()[-1] * np.eye(len(s)), np.diag(np.diag(s))):
            wrong = jacobian.T @ np.linalg.solve(other, jacobian)
            assert np.abs((wrong - result) * unit).max() > 1e-6


def noise_information(case: Case, q: np.ndarray, spot: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(2, 2) tr(S^-1 dS S^-1 dS) / 2 by the logarithms of the noise factors of joints and spot."""
    s = case.covariance(q, spot, free)
    spot_part = case.variances()[-1] * np.eye(len(s))
    changes = [np.linalg.solve(s, 2 * (s - spot_part)), np.linalg.solve(s, 2 * spot_part)]
    return np.array([[np.trace(a @ b) / 2 for b in changes] for a in changes])


def test_the_information_on_the_noise_factors(case):
    for q, spot, free in case.hits():
        values = lower_of(case.weighted("slopes", q, spot, free, "relative")[4])
        np.testing.assert_allclose(values, noise_information(case, q, spot, free), rtol=1e-9)
        # One factor on both: the information is that of a scale, 2 for each component.
        assert values.sum() == pytest.approx(2 * case.tool.residual_size, rel=1e-9)


@pytest.mark.parametrize("kind", ["laser", "probe"])
@pytest.mark.at_length(r"^probe")
def test_the_information_on_the_noise_is_the_covariance_of_its_score(cases, kind):
    """Fisher's definition: 20 000 misses drawn from N(0, S); every entry within five standard errors, those
    by the draws themselves. And the mean of the score is zero: by the noise factors, and with the whole log
    det, which makes the density of the miss one, by all else."""
    case = cases("irb1600", kind)
    rng = np.random.default_rng(11)
    q, spot, free = case.hits()[1]
    s, here = case.covariance(q, spot, free), case.miss(q, spot, free)
    draws = rng.normal(size=(20_000, len(s))) @ np.linalg.cholesky(s).T
    shot = (case.robot.recorded_turns(q), spot + here - draws, np.ones(1), *case.split(free))
    slopes = {
        which: case.by_log_det[which].kernel("slopes")(*shot, case.variances(), case.variances())
        for which in ("relative", "whole")
    }
    _, _, by_quad, by_logdet, *_ = slopes["whole"]
    scores = -(by_quad + by_logdet) / 2
    assert (np.abs(scores.mean(axis=0)) < 5 * scores.std(axis=0) / np.sqrt(len(draws)) + 1e-9).all()
    _, _, by_quad, by_logdet, information, _ = slopes["relative"]
    scores = -(by_quad + by_logdet)[:, -2:] / 2
    error = scores.std(axis=0) / np.sqrt(len(draws))
    assert (np.abs(scores.mean(axis=0)) < 5 * error).all()
    assert (np.abs((-by_quad[:, -2:] / 2).mean(axis=0)) > 5 * error).all()  # control: without log det
    products = scores[:, :, None] * scores[:, None, :]
    error = products.std(axis=0) / np.sqrt(len(draws))
    content = lower_of(information[0])
    assert (np.abs(products.mean(axis=0) - content) < 5 * error).all()
    for wrong in (2 * content, np.diag(np.diag(content))):  # controls: twice as much; both factors apart
        assert (np.abs(products.mean(axis=0) - wrong) > 5 * error).any()


def moved(flange: np.ndarray, point: np.ndarray) -> np.ndarray:
    return flange[:3, 3] + flange[:3, :3] @ point


def motion(case: Case, joint: int, q: np.ndarray, amount: float) -> np.ndarray:
    """(4, 4) in the base frame: what moving `joint` (from 0) does to everything behind it."""
    step = np.zeros(case.n)
    step[joint] = amount
    return (case.arm.pose(q + step) @ np.linalg.inv(case.arm.pose(q))).real


@pytest.mark.parametrize("amount", [0.01, -0.9, 2.5])
def test_moving_base_and_target_with_joint_1_changes_no_miss(case, amount):
    """Exactly, at any residual; a probe and a prismatic joint 1 (gantry) included. Units: rad, or 100 mm."""
    amount = amount if case.robot.display[0] != 1 else 100 * amount
    step = np.zeros(case.n)
    step[0] = amount
    for q, spot, free in case.points:
        delta, target, unknowns = case.split(free)
        # Joint 1 is the first: where it moves things to does not depend on any other.
        there = motion(case, 0, np.zeros(case.n), amount)
        turned = np.concatenate([delta + step, moved(there, target), unknowns])
        np.testing.assert_allclose(case.miss(q, spot, turned), case.miss(q, spot, free), rtol=0, atol=1e-9)
        wrong = np.concatenate([delta - step, moved(there, target), unknowns])
        assert np.abs(case.miss(q, spot, wrong) - case.miss(q, spot, free)).max() > 0.1


@pytest.mark.parametrize("constant", [1, 2, 3])
def test_a_common_turn_about_the_joint_after_constant_ones_changes_no_miss(case, constant):
    """theta1 … theta_k constant: delta_{k+1} and a turn of the target (k = 1 is the X-Pattern)."""
    first = case.points[0][0][:constant]
    amount = 0.3 if case.robot.display[constant] != 1 else 30.0
    step = np.zeros(case.n)
    step[constant] = amount
    delta, target, unknowns = case.split(case.points[0][2])
    there = motion(case, constant, np.append(first, np.zeros(case.n - constant)) + delta, amount)
    turned = np.concatenate([delta + step, moved(there, target), unknowns])
    free = np.concatenate([delta, target, unknowns])
    differences = []
    for q, spot, _ in case.points:
        plan = np.append(first, q[constant:])
        here = case.miss(plan, spot, free)
        np.testing.assert_allclose(case.miss(plan, spot, turned), here, rtol=0, atol=1e-9)
        # Negative control: with the constant joint one degree (or mm) elsewhere, the gauge is broken.
        plan[constant - 1] += 1 / case.robot.display[constant - 1]
        differences.append(np.abs(case.miss(plan, spot, turned) - case.miss(plan, spot, free)).max())
    # Only joint 3 of the SCARA slides along the axis of joint 2: there the turn of joint 2 does not matter.
    slides_along = (case.robot.name, constant) == ("scara", 2)
    assert slides_along == (max(differences) < 1e-9)
    assert slides_along or max(differences) > 1e-3


def turned_beam(case: Case, unknowns: np.ndarray, rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """tilt1, tilt2, shift1, shift2 of the beam moved as a line: p is where it cuts the plane of p0."""
    p0, u0 = case.tool.point, case.tool.direction
    p, u = beam(case.tool, unknowns)
    p, u = rotation @ p + shift, rotation @ u
    p = p - (p - p0) @ u0 / (u @ u0) * u
    square = across(u0, u0).T
    return np.append(np.arctan(square @ u / (u @ u0)), square @ (p - p0))


@pytest.mark.parametrize("kind", ["laser, uncalibrated", "probe, uncalibrated"])
def test_the_last_joint_and_an_uncalibrated_tool_turn_together(cases, arm_name, kind):
    """delta_n + phi and the tool turned back: the flange sees all of it turned, the likelihood is the same.

    The miss itself is the same up to a turn in its own plane (a laser) or in space (a probe).
    """
    case = cases(arm_name, kind)
    spot = np.zeros(case.tool.residual_size)  # a recorded spot would have to be turned too
    step = 0.07 * np.eye(case.n)[-1]
    alone = 0.0
    for q, _, free in case.hits():
        delta, target, unknowns = case.split(free)
        before, after = case.arm.pose(q + delta).real, case.arm.pose(q + delta + step).real
        back = after[:3, :3].T @ before[:3, :3]
        shift = after[:3, :3].T @ (before[:3, 3] - after[:3, 3])
        if case.tool.name == "laser":
            turned = turned_beam(case, unknowns, back, shift)
        else:
            turned = back @ unknowns + shift
        other = np.concatenate([delta + step, target, turned])
        here = np.linalg.norm(case.miss(q, spot, free))
        assert np.linalg.norm(case.miss(q, spot, other)) == pytest.approx(here, abs=1e-9)
        values = [np.concatenate(case.weighted("terms", q, spot, f)) for f in (free, other)]
        np.testing.assert_allclose(values[1], values[0], rtol=1e-9)
        # Negative control: the joint without the tool.
        unturned = case.miss(q, spot, np.concatenate([delta + step, target, unknowns]))
        alone = max(alone, abs(np.linalg.norm(unturned) - here))
    assert alone > 0.1


def test_seen_and_place_are_each_other_backwards(cases, arm_name):
    case = cases(arm_name, "probe, uncalibrated")
    for q, _, free in case.points:
        delta, target, _ = case.split(free)
        flange = case.arm.pose(q + delta).real
        y = case.call("seen", q, delta, target)[0]
        np.testing.assert_allclose(y, flange[:3, :3].T @ (target - flange[:3, 3]), atol=1e-9)
        np.testing.assert_allclose(case.call("place", q, delta, y)[0], target, atol=1e-9)
        back = case.call("seen", q, delta, case.call("place", q, delta, target)[0])[0]
        np.testing.assert_allclose(back, target, atol=1e-9)


def test_placed_has_the_derivative_of_place(cases, arm_name):
    case = cases(arm_name, "probe, uncalibrated")
    for q, _, free in case.points:
        delta, y, _ = case.split(free)
        placed, jacobian = case.call("placed", q, delta, y)
        np.testing.assert_array_equal(placed, case.call("place", q, delta, y)[0])
        expected = by_complex_step(
            lambda z, q=q: moved(case.arm.pose(q + z[: case.n]), z[case.n :]), np.append(delta, y)
        )
        np.testing.assert_allclose(jacobian, expected, rtol=0, atol=1e-9)


def test_the_beam_in_the_base_frame(case):
    for q, _, free in case.points:
        delta, _, unknowns = case.split(free)
        origin, direction = case.call("beam", q, delta, unknowns)
        flange = case.arm.pose(q + delta).real
        if case.tool.name == "laser":
            p, u = beam(case.tool, unknowns)
        else:
            p, u = (unknowns if len(unknowns) else case.tool.point), np.zeros(3)
        np.testing.assert_allclose(origin, moved(flange, p), atol=1e-9)
        np.testing.assert_allclose(direction, flange[:3, :3] @ u, atol=1e-12)


def test_the_sight_of_a_target_has_its_derivative_by_the_joints(cases, arm_name):
    case = cases(arm_name, "laser")
    for q, _, free in case.points:
        delta, target, _ = case.split(free)
        y, jacobian = case.call("sighted", q, delta, target)
        np.testing.assert_allclose(y, case.call("seen", q, delta, target)[0], rtol=0, atol=1e-9)
        expected = by_complex_step(
            lambda z, delta=delta, target=target: flange_view(case.arm.pose(z + delta), target), q
        )
        np.testing.assert_allclose(jacobian, expected, rtol=0, atol=1e-8)


def flange_view(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    return pose[:3, :3].T @ (point - pose[:3, 3])


@pytest.mark.parametrize("kind", TOOLS[:2])
def test_where_a_beam_meets_a_plane_and_how_the_spot_moves(cases, arm_name, kind):
    """J = (I - d n' / (d'n)) (dp/dq + t dd/dq), with the beam's own derivatives by complex steps."""
    case = cases(arm_name, kind)
    normal = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    for q, _, free in case.points:
        delta, target, unknowns = case.split(free)
        point, length, jacobian = case.call("hit", q, delta, unknowns, target, normal)
        origin, d = case.call("beam", q, delta, unknowns)
        along = np.dot(normal, target - origin) / np.dot(normal, d)
        np.testing.assert_allclose(length, [along], rtol=1e-12)
        np.testing.assert_allclose(point, origin + along * d, rtol=0, atol=1e-8 * max(abs(along), 1.0))
        assert abs(normal @ (point - target)) < 1e-8 * max(abs(along), 1.0)

        def at(z, delta=delta, unknowns=unknowns):
            p, u = beam(case.tool, unknowns)
            flange = case.arm.pose(z + delta)
            return np.concatenate([moved(flange, p), flange[:3, :3] @ u])

        by = by_complex_step(at, q)
        onto = np.eye(3) - np.outer(d, normal) / (d @ normal)
        expected = onto @ (by[:3] + along * by[3:])
        np.testing.assert_allclose(jacobian, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
        assert np.abs(onto @ by[:3] - expected).max() > 1  # control: without the turn of the beam


def middle(beams: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Of the shortest segment between two lines: it is square to both, so that three lengths solve it."""
    (o1, u1), (o2, u2) = beams
    along1, along2, _ = np.linalg.solve(np.array([u1, -u2, np.cross(u1, u2)]).T, o2 - o1)
    return (o1 + along1 * u1 + o2 + along2 * u2) / 2


@pytest.mark.parametrize("kind", TOOLS[:2])
@pytest.mark.one_in(3)
def test_the_midpoint_of_two_skew_beams(cases, arm_name, kind):
    case = cases(arm_name, kind)
    function = case.functions.function("midpoint")
    for (q1, _, free), (q2, _, _) in zip(case.points, case.points[1:], strict=False):
        delta, _, unknowns = case.split(free)

        def plain(z, q1=q1, q2=q2):
            flanges = [case.arm.pose(q + z[: case.n]) for q in (q1, q2)]
            p, u = beam(case.tool, z[case.n :])
            return middle([(moved(flange, p), flange[:3, :3] @ u) for flange in flanges])

        x = np.append(delta, unknowns)
        point, jacobian, by_q1, by_q2 = function(q1, q2, delta, unknowns)
        np.testing.assert_allclose(dense(point), plain(x).real, rtol=1e-9, atol=1e-7)
        expected = by_complex_step(plain, x)
        np.testing.assert_allclose(np.array(jacobian), expected, rtol=1e-8, atol=1e-6)

        # By what is recorded at one of the two shots; the offsets move both.
        for by, which in ((by_q1, 0), (by_q2, 1)):

            def one_turned(z, which=which, both=(q1, q2), delta=delta, unknowns=unknowns):
                q = [both[0], both[1]]
                q[which] = z
                flanges = [case.arm.pose(each + delta) for each in q]
                p, u = beam(case.tool, unknowns)
                return middle([(moved(flange, p), flange[:3, :3] @ u) for flange in flanges])

            np.testing.assert_allclose(
                np.array(by), by_complex_step(one_turned, (q1, q2)[which]), rtol=1e-8, atol=1e-6
            )
        first, second, both = (np.array(by) for by in (by_q1, by_q2, jacobian))
        np.testing.assert_allclose(first + second, both[:, : case.n], rtol=1e-8, atol=1e-6)
        assert np.abs(first - second).max() > 1  # control: the two are not one


def test_a_midpoint_known_by_hand():
    """A beam along x at height 0 and one along y at height 100 are nearest on the z axis."""
    tool = kind_of("laser")("tool", True, np.zeros(3), np.array([1.0, 0, 0]), 0.05, 10.0)
    joints = tuple(
        Joint(name, kind, np.eye(4), np.array([0.0, 0, 1]), -1e3, 1e3)
        for name, kind in (("turn", "revolute"), ("lift", "prismatic"))
    )
    function = ShotFunctions(Robot("mast", joints, np.eye(4)), tool).function("midpoint")
    point, *_ = function([0, 0], [np.pi / 2, 100], [0, 0], [])
    np.testing.assert_allclose(dense(point), [0, 0, 50], atol=1e-12)
    # The offset of the lift moves both beams, and the middle, by as much.
    point, jacobian, by_q1, by_q2 = function([0, 0], [np.pi / 2, 100], [0, 7], [])
    np.testing.assert_allclose(dense(point), [0, 0, 57], atol=1e-12)
    np.testing.assert_allclose(np.array(jacobian), [[0, 0], [0, 0], [0, 1]], atol=1e-12)
    # Recorded at one shot alone, the lift moves the middle by half.
    for by in (by_q1, by_q2):
        np.testing.assert_allclose(np.array(by)[:, 1], [0, 0, 0.5], atol=1e-12)


def test_a_function_and_a_kernel_are_made_once(cases):
    case = cases("scara", "laser")
    functions = ShotFunctions(case.robot, case.tool)
    assert not functions._functions  # nothing is built that is not asked for
    plain = functions.kernel("linear")
    assert set(functions._functions) == {"linear"}
    assert functions.kernel("linear") is plain
    assert plain.function is functions.function("linear")
    assert not plain.compiled
    compiled = functions.kernel("linear", compile=True)
    assert compiled is not plain
    assert compiled.function is plain.function
    assert functions.kernel("linear", compile=True) is compiled
    assert functions.kernel("linear") is compiled  # the C is not loaded a second time
    assert functions.kernel("linear", compile=False) not in (plain, compiled)
    assert functions.kernel("beam") is not plain
    # Not shared between tools.
    assert ShotFunctions(case.robot, case.tool).kernel("linear") is not plain
    with pytest.raises(KeyError, match="score"):
        functions.function("score")


def test_without_a_compiler_all_functions_together_say_so_once(cases, monkeypatch):
    """By Python's own rule of once a place: all kernels of a shot are asked for in one."""
    case = cases("scara", "laser")
    monkeypatch.setattr(kernel, "_compiler", lambda: None)
    functions = ShotFunctions(case.robot, case.tool)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for name in ("terms", "place", "slopes"):
            assert not functions.kernel(name, compile=True).compiled
    assert [each.category for each in caught] == [kernel.KernelWarning]
