import warnings

import numpy as np
import pytest
from plain_model import DESIGNED, Arm, arm, beam, by_complex_step, by_differences, miss
from scipy import integrate, stats

from zerobeam.model import problem as problem_module
from zerobeam.model.header import Header
from zerobeam.model.plan import read_plan, write_plan
from zerobeam.model.problem import Distance, Problem
from zerobeam.model.robot import Robot
from zerobeam.model.robot_file import read_robot
from zerobeam.model.run import Shot, read_run, write_run

LASER = {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
OPEN_LASER = {**LASER, "calibrated": False}
PROBE = {"kind": "probe", "point_mm": [10, 20, 100]}
OPEN_PROBE = {**PROBE, "calibrated": False}
TOOLS = {"laser": LASER, "open laser": OPEN_LASER, "probe": PROBE, "open probe": OPEN_PROBE}
SEEN = ("a", "b", "a", "a", "b", "a", "b", "b")  # targets of the shots
DISTANCE = [{"between": ["b", "a"], "mm": 60, "sigma_mm": 0.5}]


def header(tool=LASER, **changes):
    noise = {"joint_deg": 0.01, "joint_mm": 0.02, "spot_mm": 0.05}
    return Header.model_validate({"robot": "irb1600", "tool": tool, "noise": noise, **changes})


class Made:
    """A problem whose shots miss their targets by up to `near` mm at the parameters `x`."""

    def __init__(self, own: Arm, stated: Header, *, seen=SEEN, seed=0, near=0.5) -> None:
        rng = np.random.default_rng(seed)
        self.arm = own
        n, d = own.robot.n, 2 if stated.tool.kind == "laser" else 3
        joints = np.array([own.random(rng) for _ in seen])
        spots = rng.normal(scale=0.3, size=(len(seen), d)) if d == 2 else np.zeros((len(seen), d))
        self.problem = Problem.build(stated, own.robot, joints, seen, spots)
        parameters = self.problem.parameters
        self.x = parameters.prior_mean + 0.3 * parameters.prior_std * rng.normal(size=len(parameters))
        delta, _, unknowns = self.problem.split(self.x)
        first = [seen.index(name) for name in self.problem.targets]
        for k, i in enumerate(first):
            # The target is where the first of its shots has it.
            y = unknowns if len(unknowns) else self.problem.tool.point
            if d == 2:
                p, u = beam(self.problem.tool, unknowns)
                y = p + 700 * u
            flange = own.pose(joints[i] + delta).real
            self.x[n + 3 * k : n + 3 * k + 3] = flange[:3, 3] + flange[:3, :3] @ y
        for i, k in enumerate(self.problem.target_index):
            if i not in first:
                joints[i] = joints[first[k]] + rng.uniform(-30, 30, n) / own.robot.display
            self._aim(i, rng.uniform(-near, near, d))

    def _aim(self, shot: int, wanted: np.ndarray) -> None:
        """Turn the joints of one shot until its miss is the wanted one: Gauss-Newton on the plain model."""
        joints, lengths = self.problem.joints, np.where(self.arm.robot.display == 1, 1000.0, 1.0)
        for _ in range(50):
            short = wanted - self.miss(self.x, shot).real
            if np.abs(short).max() < 1e-6:
                return
            by_joints = by_complex_step(lambda q: self.miss(self.x, shot, q), joints[shot]) * lengths
            step = np.linalg.lstsq(by_joints, short, rcond=None)[0]
            joints[shot] += step * lengths * min(1.0, 0.3 / np.abs(step).max())
        raise AssertionError("this shot cannot be turned onto its target: choose another seed")

    def free(self, x: np.ndarray, shot: int) -> np.ndarray:
        """delta, the shot's target, tool in one vector."""
        delta, targets, unknowns = self.problem.split(x)
        return np.concatenate([delta, targets[self.problem.target_index[shot]], unknowns])

    def miss(self, x: np.ndarray, shot: int, q: np.ndarray | None = None) -> np.ndarray:
        problem = self.problem
        q = problem.joints[shot] if q is None else q
        return miss(self.arm.pose, problem.tool, q, problem.spots[shot], self.free(x, shot))

    def covariance(self, x: np.ndarray, shot: int) -> np.ndarray:
        noise = self.problem.noise
        by_joints = by_complex_step(lambda q: self.miss(x, shot, q), self.problem.joints[shot])
        return by_joints @ np.diag(noise.joint**2) @ by_joints.T + noise.spot**2 * np.eye(len(by_joints))

    def gaussians(self, x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Miss and covariance of every shot."""
        return [(self.miss(x, i).real, self.covariance(x, i)) for i in range(self.problem.shots)]

    def steps(self, rad: float, mm: float) -> np.ndarray:
        return np.where(self.problem.parameters.display == 1, mm, rad)

    def walkers(self, count: int, seed: int = 3) -> np.ndarray:
        """(count, p) about x, near enough that the likelihoods stay moderate."""
        rng = np.random.default_rng(seed)
        return self.x + rng.normal(size=(count, len(self.x))) * self.steps(1e-3, 1.0)


def tool_of(problem):
    kind = problem.tool.kind
    return TOOLS[kind if problem.tool.calibrated else f"open {kind}"]


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return {name: arm(name, tmp_path_factory.mktemp("arms")) for name in DESIGNED}


@pytest.fixture(params=TOOLS)
def made(request, arms):
    """Two targets, a distance between them."""
    return Made(arms["irb1600"], header(TOOLS[request.param], distances=DISTANCE))


# --- shapes and sources -----------------------------------------------------------------------------


def test_shapes_and_places(made):
    problem = made.problem
    n, k, d = 6, len(problem.tool.parameter_names), problem.tool.miss_size
    assert problem.shots == 8
    assert problem.data_size == 8 * d + 1
    assert problem.targets == ("a", "b")
    np.testing.assert_array_equal(problem.target_index, [0, 1, 0, 0, 1, 0, 1, 1])
    assert problem.distances == (Distance(1, 0, 60.0, 0.5),)
    assert problem.shot_numbers == tuple(range(8))
    delta, targets, tool = problem.split(np.arange(12.0 + k))
    np.testing.assert_array_equal(delta, np.arange(6))
    np.testing.assert_array_equal(targets, [[6, 7, 8], [9, 10, 11]])
    np.testing.assert_array_equal(tool, np.arange(12, 12 + k))
    many = problem.split(np.zeros((5, 4, 12 + k)))
    assert [part.shape for part in many] == [(5, 4, 6), (5, 4, 2, 3), (5, 4, k)]
    assert problem.columns.shape == (8, n + 3 + k)
    np.testing.assert_array_equal(problem.columns[1], [*range(6), 9, 10, 11, *range(12, 12 + k)])


def test_from_a_run_and_a_plan(tmp_path):
    postures = [[10, 20, -30, 40, 50, -60], [20, 10, -20, 30, 60, -50], [0, 5, -10, 15, 20, 25]]
    shots = [
        Shot(shot=3, target="b", joints_deg=tuple(postures[0]), spot_mm=(0.5, -0.25)),
        Shot(shot=5, target="a", joints_deg=tuple(postures[1])),
        Shot(shot=4, target="b", joints_deg=tuple(postures[2])),
    ]
    write_run(tmp_path / "r.jsonl", header(noise={"joint_deg": 0.01, "spot_mm": 0.05}), shots)
    problem = Problem.from_run(read_run(tmp_path / "r.jsonl"))
    np.testing.assert_allclose(problem.joints, np.radians(postures))
    np.testing.assert_array_equal(problem.spots, [[0.5, -0.25], [0, 0], [0, 0]])
    assert problem.shot_numbers == (3, 5, 4)
    assert problem.targets == ("b", "a")
    np.testing.assert_array_equal(problem.target_index, [0, 1, 0])
    assert problem.noise.joint[0] == pytest.approx(np.radians(0.01))

    probe = header(PROBE, noise={"joint_deg": 0.01, "spot_mm": 0.05})
    write_run(tmp_path / "p.jsonl", probe, [each.model_copy(update={"spot_mm": None}) for each in shots])
    assert Problem.from_run(read_run(tmp_path / "p.jsonl")).spots.shape == (3, 3)

    write_plan(tmp_path / "plan.yaml", probe, postures, ["b", "a", "b"])
    planned = Problem.from_plan(read_plan(tmp_path / "plan.yaml"))
    np.testing.assert_allclose(planned.joints, np.radians(postures))
    assert planned.shot_numbers == (0, 1, 2)
    assert planned.targets == ("b", "a")
    np.testing.assert_array_equal(planned.spots, np.zeros((3, 3)))


def test_a_distance_to_a_target_that_no_shot_has(arms, refused):
    distances = [{"between": ["a", "c"], "mm": 60, "sigma_mm": 0.5}]
    error = refused(Made, arms["irb1600"], header(distances=distances))
    assert error.found == "c"
    assert error.allowed == "a, b"


def test_moved_shots_are_those_of_a_problem_made_there(made):
    problem = made.problem
    before = problem.log_likelihood(made.x[None])
    other = problem.joints + 0.01
    spots = problem.spots + 1.0
    moved = problem.moved(other, spots)
    fresh = Problem.build(header(tool_of(problem), distances=DISTANCE), problem.robot, other, SEEN, spots)
    np.testing.assert_array_equal(moved.log_likelihood(made.x[None]), fresh.log_likelihood(made.x[None]))
    assert moved.log_likelihood(made.x[None]) != before  # nothing is kept from before
    np.testing.assert_array_equal(problem.log_likelihood(made.x[None]), before)


def test_some_of_the_shots(made):
    """The unknowns stay all of them, also a target that none of the chosen shots has."""
    problem, rows = made.problem, np.array([6, 0, 1])
    some = problem.select(rows)
    assert some.shots == 3
    assert some.parameters.names == problem.parameters.names
    assert some.shot_numbers == (6, 0, 1)
    np.testing.assert_array_equal(some.target_index, [1, 0, 1])
    miss, own = problem.linearise(made.x)
    for wanted, got in zip((miss, own), some.linearise(made.x), strict=True):
        np.testing.assert_array_equal(got, wanted[rows])
    for wanted, got in zip((miss, own), problem.linearise(made.x, rows=rows), strict=True):
        np.testing.assert_array_equal(got, wanted[rows])
    left, right = problem.select(np.arange(3)), problem.select(np.arange(3, 8))
    x = made.walkers(4)
    distance = [distance_log_density(made, each) for each in x]
    parts = left.log_likelihood(x) + right.log_likelihood(x) - distance  # it stands in both
    np.testing.assert_allclose(parts, problem.log_likelihood(x), rtol=1e-12)
    alone = problem.select(np.array([1, 4, 6, 7])).whiten(made.x)
    np.testing.assert_array_equal(alone.jacobian[:-1, 6:9], 0)
    assert np.abs(alone.jacobian[-1, 6:9]).max() > 0  # only the distance sees target a


# --- misses, whitened and not -----------------------------------------------------------------------


def test_misses_and_jacobians_shot_by_shot(made):
    miss, own = made.problem.linearise(made.x)
    for i in range(made.problem.shots):
        np.testing.assert_allclose(miss[i], made.miss(made.x, i).real, rtol=0, atol=1e-9)
        derivative = by_complex_step(lambda x, i=i: made.miss(x, i), made.x)
        np.testing.assert_allclose(own[i], derivative[:, made.problem.columns[i]], rtol=0, atol=1e-9)
        # The other target has no part in it.
        others = np.delete(derivative, made.problem.columns[i], axis=1)
        assert others.shape[1] == 3
        np.testing.assert_array_equal(others, 0)
    there, _ = made.problem.linearise(made.x, made.problem.joints + 0.02)
    np.testing.assert_array_equal(there, made.problem.moved(made.problem.joints + 0.02).linearise(made.x)[0])
    assert np.abs(there - miss).max() > 1


def test_the_factors_are_those_of_the_covariance_of_joint_and_spot_noise(made):
    _, own = made.problem.linearise(made.x)
    for i, factor in enumerate(made.problem.factors(own)):
        np.testing.assert_allclose(factor @ factor.T, made.covariance(made.x, i), rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(factor, np.tril(factor))


def test_whitened_misses_and_distances(made):
    problem, x = made.problem, made.x
    white = problem.whiten(x)
    assert white.residual.shape == (problem.data_size,)
    assert white.jacobian.shape == (problem.data_size, len(problem.parameters))
    d = problem.tool.miss_size
    for i, (m, covariance) in enumerate(made.gaussians(x)):
        expected = np.linalg.solve(np.linalg.cholesky(covariance), m)
        np.testing.assert_allclose(white.residual[d * i : d * i + d], expected, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(white.miss[i], m, atol=1e-9)
    a, b = problem.split(x)[1]
    assert white.residual[-1] == pytest.approx((np.linalg.norm(a - b) - 60) / 0.5, rel=1e-12)


def test_the_whitened_jacobian_against_differences_by_scaled_parameters(made):
    """With the weights kept, as the fit keeps them. Steps 1e-3 rad, 0.1 mm: the step error is 1e-12 / 30 of a
    fifth derivative of some 1e3 times the first (tilts), rounding 1e-12 mm / (0.05 mm * 1e-3)."""
    problem, x = made.problem, made.x
    white = problem.whiten(x)
    scale = problem.parameters.prior_std

    def residual(z):
        return problem.whiten(z, white.factor).residual

    expected = by_differences(residual, x, made.steps(1e-3, 0.1)) * scale
    size = np.abs(expected).max(axis=0)
    assert (size > 1e-3).all()
    np.testing.assert_allclose(white.jacobian / size, expected / size, rtol=0, atol=1e-9)
    # Negative control: the weights of another place make another Jacobian.
    elsewhere = problem.whiten(x + made.steps(0.2, 100.0))
    assert np.abs(problem.whiten(x, elsewhere.factor).jacobian - white.jacobian).max() > 1e-3 * size.max()


def test_a_noise_that_leaves_a_direction_free_is_refused(arms, refused):
    """Without spot noise, two joints scatter a probe's misses in two of the three directions only."""
    full = arms["irb1600"].robot
    short = Robot("two joints", full.joints[:2], np.eye(4))
    noise = {"joint_deg": 0.01, "spot_mm": 0}
    problem = Problem.build(header(PROBE, noise=noise), short, np.zeros((3, 2)), ["a"] * 3)
    x = problem.parameters.prior_mean
    error = refused(problem.whiten, x)
    assert "without any noise" in error.what
    assert "spot_mm" in error.remedy
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert problem.log_likelihood(x[None])[0] == -np.inf
    stated = Problem.build(header(PROBE), short, np.zeros((3, 2)), ["a"] * 3)
    assert np.isfinite(stated.whiten(x).residual).all()


def test_many_shots_are_compiled_and_the_numbers_stay(made, monkeypatch):
    functions = made.problem.functions
    miss, own = made.problem.linearise(made.x)
    gradient = made.problem.gradient(made.x)
    assert set(functions._kernels) == {("linear", False), ("score", False)}
    monkeypatch.setattr(problem_module, "_COMPILE_FROM", 7)  # of 8 shots
    compiled = [made.problem.linearise(made.x), made.problem.gradient(made.x)]
    assert set(functions._kernels) >= {("linear", True), ("score", True)}
    np.testing.assert_allclose(compiled[0][0], miss, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(compiled[0][1], own, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(compiled[1], gradient, rtol=1e-12, atol=1e-12 * np.abs(gradient).max())


# --- the density ------------------------------------------------------------------------------------


def distance_log_density(made, x):
    total = 0.0
    for stated in made.problem.distances:
        targets = made.problem.split(x)[1]
        length = np.linalg.norm(targets[stated.second] - targets[stated.first])
        total += stats.norm.logpdf(length, stated.mm, stated.sigma) - stats.norm.logpdf(0, 0, stated.sigma)
    return total


def test_the_log_likelihood_against_multivariate_normals(made):
    """Up to the constant of 2 pi, and each walker by itself."""
    problem = made.problem
    walkers = made.walkers(6)
    values = problem.log_likelihood(walkers)
    assert values.shape == (6,)
    constant = problem.shots * problem.tool.miss_size / 2 * np.log(2 * np.pi)
    for x, value in zip(walkers, values, strict=True):
        expected = constant + distance_log_density(made, x)
        for m, covariance in made.gaussians(x):
            expected += stats.multivariate_normal.logpdf(m, np.zeros(len(m)), covariance)
        assert value == pytest.approx(expected, rel=1e-9)
        assert problem.log_likelihood(x[None])[0] == value


@pytest.fixture(params=["laser", "open probe"])
def estimated(request, arms):
    noise = {"joint_deg": 0.01, "spot_mm": 0.05, "scale": "estimated"}
    return Made(arms["irb1600"], header(TOOLS[request.param], noise=noise, distances=DISTANCE))


def test_an_estimated_scale_against_the_student_form(estimated):
    """The scale with its prior 1/scale integrated out is the multivariate t in its limit of no degrees of
    freedom (1e-7 here: it differs by as much). Only differences count: the constant is infinite."""
    problem, walkers = estimated.problem, estimated.walkers(4)
    values = problem.log_likelihood(walkers)
    size = problem.shots * problem.tool.miss_size
    expected = []
    for x in walkers:
        shape, m = np.zeros((size, size)), []
        for i, (own, covariance) in enumerate(estimated.gaussians(x)):
            d = len(own)
            shape[i * d : i * d + d, i * d : i * d + d] = covariance
            m.extend(own)
        density = stats.multivariate_t(np.zeros(size), shape, df=1e-7).logpdf(np.array(m))
        expected.append(density + distance_log_density(estimated, x))
    assert np.ptp(values) > 1
    np.testing.assert_allclose(values - values[0], np.array(expected) - expected[0], rtol=1e-6, atol=1e-5)


def test_an_estimated_scale_against_the_integral_itself(estimated):
    """Over log scale, since the prior 1/scale is flat there."""
    problem, walkers = estimated.problem, estimated.walkers(3)
    values = problem.log_likelihood(walkers)
    expected = []
    for x in walkers:
        quads = [m @ np.linalg.solve(covariance, m) for m, covariance in estimated.gaussians(x)]
        logdet = sum(np.linalg.slogdet(covariance)[1] for _, covariance in estimated.gaussians(x))
        size, quad = problem.shots * problem.tool.miss_size, sum(quads)
        peak = np.log(quad / size) / 2

        def density(log_scale, size=size, quad=quad, peak=peak):
            exponent = -size * (log_scale - peak) - quad / 2 * np.exp(-2 * log_scale) + size / 2
            return np.exp(exponent)

        integral = integrate.quad(density, peak - 3, peak + 6, epsabs=0, epsrel=1e-10, points=[peak])[0]
        expected.append(np.log(integral) - size * peak - logdet / 2 + distance_log_density(estimated, x))
    np.testing.assert_allclose(values - values[0], np.array(expected) - expected[0], rtol=1e-7, atol=1e-7)


def test_the_weight_of_the_noise_is_the_mode_of_the_scale(estimated, made):
    assert made.problem.noise_weight(made.x) == 1.0
    x = estimated.walkers(1)[0]
    quad = sum(m @ np.linalg.solve(covariance, m) for m, covariance in estimated.gaussians(x))
    size = estimated.problem.shots * estimated.problem.tool.miss_size
    assert estimated.problem.noise_weight(x) == pytest.approx(size / quad, rel=1e-9)
    # The best weight w of w^(size/2) exp(-w quad / 2), by trial.
    trial = size / quad * np.array([0.99, 1.0, 1.01])
    assert np.argmax(size / 2 * np.log(trial) - trial * quad / 2) == 1


@pytest.mark.parametrize("scale", ["known", "estimated"])
@pytest.mark.parametrize("tool", TOOLS)
def test_the_gradient_against_differences(arms, scale, tool):
    """Of log-likelihood and log-prior by the scaled parameters; steps 1e-5 rad, 1e-2 mm; misses up to 2 mm.

    By a joint the square varies like A^2 sin^2, A = 1000 mm / 0.05 mm: step error 1e-20 / 30 * 16 A^2,
    nothing. Its logarithm (estimated scale) varies over 2 mm / 1000 mm: 1e-20 / 30 * 8 * 4! / 2e-3^5 = 2e-6.
    Rounding: 1e-12 mm of each miss times m / sigma^2 = 800 / mm, over 1e-5, is 1e-4. Scaled, this counts 0.1
    (offsets, tilts) to 10 000 / 1e-2 * 1e-5 = 10 (targets) times.
    """
    noise = {"joint_deg": 0.01, "spot_mm": 0.05, "scale": scale}
    made = Made(arms["irb1600"], header(TOOLS[tool], noise=noise, distances=DISTANCE), near=2.0)
    problem, x, parameters = made.problem, made.x, made.problem.parameters
    free = parameters.free

    def value(z):
        return problem.log_likelihood(z[None])[0] + problem.log_prior(z[None])[0]

    gradient = problem.gradient(x)
    expected = by_differences(value, x, made.steps(1e-5, 1e-2)) * parameters.prior_std
    bound = np.where(parameters.group("target"), 1e-2, 1e-3) + 1e-9 * np.abs(expected)
    np.testing.assert_array_equal(gradient[~free], 0)
    assert (np.abs(gradient - expected) < bound)[free].all(), (gradient - expected) / bound
    # Negative controls: without the prior, the distance, the change of the weights, the noise's weight.
    white = problem.whiten(x)
    prior = -(x - parameters.prior_mean) / parameters.prior_std
    weights = np.append(np.full(problem.data_size - 1, problem.noise_weight(x)), 1.0)
    frozen = prior - white.jacobian.T @ (weights * white.residual)
    lacking = {
        "prior": gradient - prior,
        "distance": gradient + white.residual[-1] * white.jacobian[-1],
        "weights": frozen,
    }
    if scale == "estimated":
        lacking["scale"] = prior - white.jacobian.T @ white.residual
    for name, wrong in lacking.items():
        assert (np.abs(wrong - expected) > 10 * bound)[free].any(), name


def test_the_log_prior_leaves_out_what_is_held(made):
    parameters = made.problem.parameters
    walkers = made.walkers(3)
    z = (walkers - parameters.prior_mean) / parameters.prior_std
    expected = stats.norm.logpdf(z[:, parameters.free]) - stats.norm.logpdf(0)
    np.testing.assert_allclose(made.problem.log_prior(walkers), expected.sum(axis=1), rtol=1e-12)
    walkers[:, parameters.index("delta1")] += 1
    np.testing.assert_allclose(made.problem.log_prior(walkers), expected.sum(axis=1), rtol=1e-12)


@pytest.mark.parametrize("scale", ["known", "estimated"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200, 1e308])
def test_the_log_likelihood_is_never_nan(arms, scale, bad):
    """A sampler takes -inf for no, but NaN for anything. The sound walker beside it is not touched."""
    noise = {"joint_deg": 0.01, "spot_mm": 0.05, "scale": scale}
    made = Made(arms["irb1600"], header(OPEN_LASER, noise=noise, distances=DISTANCE))
    p = len(made.x)
    walkers = np.tile(made.x, (p + 2, 1))
    walkers[np.arange(p), np.arange(p)] = bad
    walkers[p] = bad
    values = made.problem.log_likelihood(walkers)
    assert not np.isnan(values).any()
    assert (values < np.inf).all()
    assert values[p] == -np.inf
    assert values[p + 1] == made.problem.log_likelihood(made.x[None])[0]
    if not np.isfinite(bad):
        np.testing.assert_array_equal(values[:p], -np.inf)


@pytest.mark.parametrize("name", ["bent", "scara", "gantry"])
def test_arms_with_a_prismatic_joint(arms, name):
    """The whole street once: their offsets are in mm, and scaled by a prior in mm."""
    made = Made(arms[name], header(OPEN_PROBE if name == "gantry" else OPEN_LASER))
    problem, x = made.problem, made.x
    expected = problem.shots * problem.tool.miss_size / 2 * np.log(2 * np.pi)
    for m, covariance in made.gaussians(x):
        expected += stats.multivariate_normal.logpdf(m, np.zeros(len(m)), covariance)
    assert problem.log_likelihood(x[None])[0] == pytest.approx(expected, rel=1e-9)
    white = problem.whiten(x)
    scaled = by_differences(lambda z: problem.whiten(z, white.factor).residual, x, made.steps(1e-3, 0.1))
    scaled = scaled * problem.parameters.prior_std
    size = np.abs(scaled).max(axis=0) + 1e-6
    np.testing.assert_allclose(white.jacobian / size, scaled / size, rtol=0, atol=1e-8)


# --- distances --------------------------------------------------------------------------------------


def test_a_distance_moves_both_its_targets(made):
    problem = made.problem
    row = problem.whiten(made.x).jacobian[-1] / problem.parameters.prior_std
    a, b = problem.split(made.x)[1]
    along = (a - b) / np.linalg.norm(a - b) / 0.5
    expected = np.zeros(len(row))
    expected[6:9], expected[9:12] = along, -along
    np.testing.assert_allclose(row, expected, atol=1e-12)


def test_two_targets_in_one_place_have_no_direction_but_no_nan_either(made):
    x = made.x.copy()
    x[9:12] = x[6:9]
    white = made.problem.whiten(x)
    assert np.isfinite(white.jacobian).all()
    assert white.residual[-1] == pytest.approx(-60 / 0.5)
    assert np.isfinite(made.problem.gradient(x)).all()
    assert np.isfinite(made.problem.log_likelihood(x[None])).all()


# --- beams and targets ------------------------------------------------------------------------------


def test_beams_in_the_base_frame(made):
    delta, _, unknowns = made.problem.split(made.x)
    origin, direction = made.problem.beams(made.x)
    for i, q in enumerate(made.problem.joints):
        flange = made.arm.pose(q + delta).real
        if made.problem.tool.kind == "laser":
            p, u = beam(made.problem.tool, unknowns)
        else:
            p, u = (unknowns if len(unknowns) else made.problem.tool.point), np.zeros(3)
        np.testing.assert_allclose(origin[i], flange[:3, 3] + flange[:3, :3] @ p, atol=1e-9)
        np.testing.assert_allclose(direction[i], flange[:3, :3] @ u, atol=1e-12)


MAST = """schema: zerobeam/robot/1
name: mast
convention: modified
joints:
  - {kind: prismatic, a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_mm: -9000, upper_mm: 9000}
  - {a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -180, upper_deg: 180}
  - {kind: prismatic, a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_mm: -9000, upper_mm: 9000}
"""
# lift z, turn about it, then slide along the turned -y (modified DH with alpha 90: z3 is -y2).


@pytest.fixture(scope="module")
def mast(tmp_path_factory):
    path = tmp_path_factory.mktemp("mast") / "mast.yaml"
    path.write_text(MAST)
    return read_robot(path)


def on_the_mast(mast, joints, seen, tool=None, **changes):
    """Joints in mm, degrees, mm. The beam goes along x of the flange, from its origin."""
    tool = tool or {"kind": "laser", "point_mm": [0, 0, 0], "direction": [1, 0, 0]}
    joints = np.array(joints, dtype=float) / mast.display
    problem = Problem.build(header(tool, **changes), mast, joints, seen)
    return problem, problem.nearest_targets(np.zeros(3), np.zeros(0))


def test_the_point_nearest_to_beams_that_meet(mast):
    """At height 100: along x through y = -30, and along y through x = 50; and another target on its own."""
    problem, nearest = on_the_mast(
        mast, [[100, 0, 30], [7, 0, 0], [100, 90, 50], [7, 90, 0]], ["a", "b", "a", "b"]
    )
    origin, direction = problem.beams(problem.parameters.prior_mean)
    np.testing.assert_allclose(direction, [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(origin[[0, 2]], [[0, -30, 100], [50, 0, 100]], atol=1e-12)
    np.testing.assert_allclose(nearest, [[50, -30, 100], [0, 0, 7]], atol=1e-6)


def test_the_point_nearest_to_skew_beams(mast):
    """Two beams 20 apart: halfway. And in general the least squares of the distances to the lines."""
    _, nearest = on_the_mast(mast, [[100, 0, 30], [120, 90, 50]], ["a", "a"])
    np.testing.assert_allclose(nearest, [[50, -30, 110]], atol=1e-6)
    rng = np.random.default_rng(7)
    joints = np.column_stack([rng.uniform(0, 500, 9), rng.uniform(-170, 170, 9), rng.uniform(-500, 500, 9)])
    problem, nearest = on_the_mast(mast, joints, ["a"] * 9)
    origin, direction = problem.beams(problem.parameters.prior_mean)
    across = np.eye(3) - np.einsum("ni,nj->nij", direction, direction)
    expected = np.linalg.lstsq(
        across.reshape(-1, 3), np.einsum("nij,nj->ni", across, origin).ravel(), rcond=None
    )[0]
    np.testing.assert_allclose(nearest[0], expected, atol=1e-5)


@pytest.mark.parametrize("guess", [None, [300.0, 40.0, 90.0]])
def test_parallel_beams_leave_their_direction_at_the_prior(mast, guess):
    """One beam, or three parallel ones, along x: y and z between them, x where it is expected, all finite."""
    targets = {} if guess is None else {"a": {"guess_mm": guess}}
    _, nearest = on_the_mast(mast, [[100, 0, 30]], ["a"], targets=targets)
    x = 0 if guess is None else guess[0]
    np.testing.assert_allclose(nearest, [[x, -30, 100]], atol=1e-3)
    _, nearest = on_the_mast(mast, [[100, 0, 30], [130, 0, 60], [100, 0, 0]], ["a"] * 3, targets=targets)
    np.testing.assert_allclose(nearest, [[x, -30, 110]], atol=1e-3)
    # Parallel, but in opposite senses.
    _, nearest = on_the_mast(mast, [[100, 0, 30], [120, 180, 0]], ["a"] * 2, targets=targets)
    np.testing.assert_allclose(nearest, [[x, -15, 110]], atol=1e-3)


def test_of_a_probe_the_mean_of_the_tips(mast):
    tool = {"kind": "probe", "point_mm": [5, 0, 0]}
    _, nearest = on_the_mast(mast, [[100, 0, 30], [7, 0, 0], [140, 0, 10]], ["a", "b", "a"], tool)
    np.testing.assert_allclose(nearest, [[5, -20, 120], [5, 0, 7]], atol=1e-5)


def test_what_is_supposed_before_any_shot(mast):
    """A guess where one is stated, even far off; else the nearest point; no offsets, the nominal tool."""
    joints = [[100, 0, 30], [100, 0, 30], [100, 90, 50], [100, 90, 50], [7, 0, 0]]
    seen = ["a", "b", "a", "b", "c"]
    tool = {"kind": "laser", "point_mm": [0, 0, 0], "direction": [1, 0, 0], "calibrated": False}
    targets = {"b": {"guess_mm": [1, 2, 3]}, "c": {"sigma_mm": 5}}
    problem = Problem.build(header(tool, targets=targets), mast, np.array(joints) / mast.display, seen)
    np.testing.assert_array_equal(problem.guessed, [False, True, False])
    supposed = problem.supposed()
    expected = [0, 0, 0, 50, -30, 100, 1, 2, 3, 0, 0, 7, 0, 0, 0, 0]
    np.testing.assert_allclose(supposed, expected, atol=1e-5)
    np.testing.assert_array_equal(supposed[6:9], [1, 2, 3])  # to the last digit
    supposed[:] = 0  # a copy: the priors do not move
    np.testing.assert_array_equal(problem.parameters.prior_mean[6:9], [1, 2, 3])
    probe = Problem.build(header(OPEN_PROBE), mast, np.array(joints) / mast.display, seen)
    np.testing.assert_array_equal(probe.supposed()[-3:], [10, 20, 100])
