import warnings

import numpy as np
import pytest
from made_problem import DISTANCE, OPEN_LASER, OPEN_PROBE, PROBE, TOOLS, Made, header
from plain_model import DESIGNED, arm, by_complex_steps
from scipy import integrate, stats

from zerobeam.model import kernel
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood import constraint
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.problem import Problem

SCALES = ("known", "estimated", "separate")
# Every scale with one tool, every tool with one scale; the other pairs at length.
PAIRS = [
    pytest.param(
        tool, scale, marks=() if scale == SCALES[0] or tool == next(iter(TOOLS)) else pytest.mark.long
    )
    for tool in TOOLS
    for scale in SCALES
]
# Fewer and more than the lanes of any machine (2, 4 or 8), and no multiples of them.
ROWS = (1, 2, 3, 5, 9)


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    return {name: arm(name, tmp_path_factory.mktemp("arms")) for name in DESIGNED}


def noise(scale):
    return {"joint_deg": 0.01, "joint_mm": 0.02, "spot_mm": 0.05, "scale": scale}


@pytest.fixture(params=TOOLS)
def made(request, arms):
    """Two targets, a distance between them."""
    return Made(arms["irb1600"], header(TOOLS[request.param], distances=DISTANCE))


@pytest.fixture(params=SCALES)
def each_scale(request, arms):
    content = header(OPEN_LASER, noise=noise(request.param), distances=DISTANCE)
    return Made(arms["irb1600"], content, near=2.0)


def recordings(made, count, seed=7):
    """`joints` (count, N, n) and `spots` (count, N, d) of data sets about those of the problem."""
    rng, problem = np.random.default_rng(seed), made.problem
    joints = problem.joints + rng.normal(size=(count, *problem.joints.shape)) * 1e-3 / problem.robot.display
    return joints, problem.spots + rng.normal(scale=0.1, size=(count, *problem.spots.shape))


@pytest.mark.parametrize("scale", ["known", "separate"])
@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.one_in(3)
def test_the_log_likelihood_against_multivariate_normals(arms, tool, scale):
    """Over that of no miss at the stated noise, and each walker by itself."""
    made = Made(arms["irb1600"], header(TOOLS[tool], noise=noise(scale), distances=DISTANCE))
    walkers, density = made.walkers(6), Density(made.problem)
    values = density.log_likelihood(walkers)
    assert values.shape == (6,)
    for x, value in zip(walkers, values, strict=True):
        assert value == pytest.approx(made.log_density(x), rel=1e-9)
        assert density.log_likelihood(x[None])[0] == value
    assert np.ptp(values) > 1


@pytest.fixture(params=["laser", "open probe"])
def estimated(request, arms):
    return Made(arms["irb1600"], header(TOOLS[request.param], noise=noise("estimated"), distances=DISTANCE))


def test_an_estimated_scale_against_the_student_form(estimated):
    """The scale with its prior 1/scale integrated out is the multivariate t in its limit of no degrees of
    freedom (1e-7 here: it differs by as much). Only differences count: the constant is infinite."""
    problem, walkers = estimated.problem, estimated.walkers(4)
    values = Density(problem).log_likelihood(walkers)
    size = problem.shots * problem.tool.residual_size
    expected = []
    for x in walkers:
        shape, m = np.zeros((size, size)), []
        for i, (actual, covariance) in enumerate(estimated.gaussians(x)):
            d = len(actual)
            shape[i * d : i * d + d, i * d : i * d + d] = covariance
            m.extend(actual)
        density = stats.multivariate_t(np.zeros(size), shape, df=1e-7).logpdf(np.array(m))
        density += np.linalg.slogdet(shape)[1] / 2  # relative to that of no miss
        expected.append(density - (estimated.distances(x) ** 2).sum() / 2)
    assert np.ptp(values) > 1
    np.testing.assert_allclose(values - values[0], np.array(expected) - expected[0], rtol=1e-6, atol=1e-5)


def test_an_estimated_scale_against_the_integral_itself(estimated):
    """Over log scale, since the prior 1/scale is flat there."""
    problem, walkers = estimated.problem, estimated.walkers(3)
    values = Density(problem).log_likelihood(walkers)
    expected = []
    for x in walkers:
        quads = [m @ np.linalg.solve(covariance, m) for m, covariance in estimated.gaussians(x)]
        size, quad = problem.shots * problem.tool.residual_size, sum(quads)
        peak = np.log(quad / size) / 2

        def density(log_scale, size=size, quad=quad, peak=peak):
            exponent = -size * (log_scale - peak) - quad / 2 * np.exp(-2 * log_scale) + size / 2
            return np.exp(exponent)

        integral = integrate.quad(density, peak - 3, peak + 6, epsabs=0, epsrel=1e-10, points=[peak])[0]
        distance = (estimated.distances(x) ** 2).sum() / 2
        expected.append(np.log(integral) - size * peak - distance)
    np.testing.assert_allclose(values - values[0], np.array(expected) - expected[0], rtol=1e-7, atol=1e-7)


def test_one_factor_on_both_separate_ones_is_a_scale(arms):
    """With both factors f the log-likelihood is that of f times the stated noise; known noise is f = 1."""
    made = Made(arms["irb1600"], header(noise=noise("separate"), distances=DISTANCE))
    known = Density(Made(arms["irb1600"], header(noise=noise("known"), distances=DISTANCE)).problem)
    known = Density(known.problem, made.problem.joints[None], made.problem.spots[None])
    x = made.walkers(3)
    x[:, -2:] = 0
    np.testing.assert_allclose(
        Density(made.problem).log_likelihood(x), known.log_likelihood(x[:, :-2]), rtol=1e-12
    )
    doubled = {"joint_deg": 0.02, "joint_mm": 0.04, "spot_mm": 0.1}
    twice = Made(arms["irb1600"], header(noise=doubled, distances=DISTANCE)).problem
    twice = Density(twice, made.problem.joints[None], made.problem.spots[None])
    x[:, -2:] = np.log(2)
    size = made.problem.shots * made.problem.tool.residual_size
    np.testing.assert_allclose(
        Density(made.problem).log_likelihood(x),
        twice.log_likelihood(x[:, :-2]) - size * np.log(2),  # the log det relative to the stated noise
        rtol=1e-12,
    )


@pytest.mark.one_in(3)
def test_the_weight_of_the_noise_is_the_mode_of_the_scale(estimated, made):
    np.testing.assert_array_equal(Density(made.problem).noise_weight(made.walkers(2)), [1.0, 1.0])
    walkers = estimated.walkers(2)
    weights = Density(estimated.problem).noise_weight(walkers)
    for x, weight in zip(walkers, weights, strict=True):
        quad = sum(m @ np.linalg.solve(covariance, m) for m, covariance in estimated.gaussians(x))
        size = estimated.problem.shots * estimated.problem.tool.residual_size
        assert weight == pytest.approx(size / quad, rel=1e-9)
        # The best weight w of w^(size/2) exp(-w quad / 2), by trial.
        trial = weight * np.array([0.99, 1.0, 1.01])
        assert np.argmax(size / 2 * np.log(trial) - trial * quad / 2) == 1


def test_the_log_prior_leaves_out_what_is_held(each_scale):
    parameters, density = each_scale.problem.parameters, Density(each_scale.problem)
    walkers = each_scale.walkers(3)
    z = (walkers - parameters.prior_mean) / parameters.prior_std
    expected = stats.norm.logpdf(z[:, parameters.free]) - stats.norm.logpdf(0)
    np.testing.assert_allclose(density.log_prior(walkers), expected.sum(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(density.scaled(walkers), z[:, parameters.free])
    assert density.size == parameters.free.sum()
    total = density.log_likelihood(walkers) + density.log_prior(walkers)
    np.testing.assert_array_equal(density.log_posterior(walkers), total)
    walkers[:, parameters.index("delta1")] += 1
    np.testing.assert_allclose(density.log_prior(walkers), expected.sum(axis=1), rtol=1e-12)


def test_the_square_of_every_shot(made):
    """Unweighted, whatever the weights; of several data sets those of the first."""
    expected = [m @ np.linalg.solve(covariance, m) for m, covariance in made.gaussians(made.x)]
    np.testing.assert_allclose(Density(made.problem).quads(made.x), expected, rtol=1e-8)
    none = np.zeros((1, made.problem.shots))
    np.testing.assert_allclose(Density(made.problem).weighted(none).quads(made.x), expected, rtol=1e-8)
    joints, spots = recordings(made, 3)
    joints[0], spots[0] = made.problem.joints, made.problem.spots
    np.testing.assert_allclose(Density(made.problem, joints, spots).quads(made.x), expected, rtol=1e-8)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200, 1e308, -1e308])
@pytest.mark.one_in(2)
def test_no_value_is_ever_nan(arms, scale, bad):
    """A sampler takes -inf for no, but NaN for anything. The sound walker beside it is not touched, and
    nothing is warned of."""
    made = Made(arms["irb1600"], header(OPEN_LASER, noise=noise(scale), distances=DISTANCE))
    density, p = Density(made.problem), len(made.x)
    walkers = np.tile(made.x, (p + 2, 1))
    walkers[np.arange(p), np.arange(p)] = bad
    walkers[p] = bad
    sound = made.x[None]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        likelihood = density.log_likelihood(walkers)
        for values in (
            likelihood,
            density.log_prior(walkers),
            density.log_posterior(walkers),
            density.slopes(walkers).value,
        ):
            assert not np.isnan(values).any()
            assert (values < np.inf).all()
        slopes = density.slopes(walkers)
    assert likelihood[p] == -np.inf
    assert likelihood[p + 1] == density.log_likelihood(sound)[0]
    for part, alone in zip(slopes, density.slopes(sound), strict=True):
        np.testing.assert_array_equal(part[p + 1], alone[0])
    if not np.isfinite(bad):
        # A factor of no noise (the exponential of -inf) is told by the prior, all else by the misses.
        free = made.problem.parameters.free
        assert (density.log_posterior(walkers)[:p][free] == -np.inf).all()
        spared = 2 if scale == "separate" and bad == -np.inf else 0
        np.testing.assert_array_equal(likelihood[: p - spared], -np.inf)


def test_a_noise_that_leaves_a_direction_free_has_no_likelihood(arms):
    """Without spot noise, two joints scatter a probe's misses in two of the three directions only."""
    full = arms["irb1600"].robot
    short = Robot("two joints", full.joints[:2], np.eye(4))
    content = header(PROBE, noise={"joint_deg": 0.01, "spot_mm": 0})
    problem = Problem.build(content, short, np.zeros((3, 2)), ["a"] * 3)
    x = problem.parameters.prior_mean[None]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Density(problem).log_likelihood(x)[0] == -np.inf
        assert Density(problem).slopes(x).value[0] == -np.inf
    sound = Problem.build(header(PROBE), short, np.zeros((3, 2)), ["a"] * 3)
    assert np.isfinite(Density(sound).log_likelihood(x)).all()


def test_a_target_without_shots_and_no_shots_at_all(made):
    """Compiled code must not read what is not there; the distance and the priors are left."""
    density = Density(made.problem.select(np.flatnonzero(made.problem.target_index == 0)))
    value, gradient, information = density.slopes(made.x[None])
    np.testing.assert_allclose(value, density.log_posterior(made.x[None]), rtol=1e-12)
    p, free = len(made.x), made.problem.parameters.free
    seen_by = np.zeros(p, dtype=bool)
    seen_by[9:12] = True  # target b: its distance to a and its prior
    rest = information - density.prior_information(made.x[None])
    np.testing.assert_allclose(rest[0][seen_by[free]], 0, atol=1e-9)
    assert np.isfinite(gradient).all()
    none = Density(made.problem.select(np.array([], dtype=np.int64)))
    distance = (made.distances(made.x) ** 2).sum() / 2
    assert none.log_likelihood(made.x[None])[0] == pytest.approx(-distance, rel=1e-12)
    np.testing.assert_allclose(
        none.slopes(made.x[None]).information, none.prior_information(made.x[None]), rtol=1e-12
    )


def test_fewer_data_sets_than_rows_are_refused(made):
    """And not read on behind them."""
    density = Density(made.problem, *recordings(made, 2))
    for ask in (density.log_likelihood, density.slopes):
        with pytest.raises(ValueError, match="turns has"):
            ask(np.tile(made.x, (3, 1)))


def test_the_value_of_the_slopes_is_the_log_posterior(each_scale):
    density, walkers = Density(each_scale.problem), each_scale.walkers(5)
    value, gradient, information = density.slopes(walkers)
    np.testing.assert_allclose(value, density.log_posterior(walkers), rtol=1e-12)
    f = density.size
    assert (gradient.shape, information.shape) == ((5, f), (5, f, f))


def scaled_gradient(made, x):
    """(f,) of the plain log-posterior by the scaled free parameters, by complex steps."""
    parameters = made.problem.parameters
    by_x = by_complex_steps(made.log_posterior, x)
    return (by_x * parameters.prior_std)[parameters.free]


@pytest.mark.parametrize(("tool", "scale"), PAIRS)
def test_the_gradient_against_complex_steps_of_the_plain_model(arms, tool, scale):
    """Without step errors: what is left is rounding, 1e-11 mm of each miss of up to 2 mm."""
    made = Made(arms["irb1600"], header(TOOLS[tool], noise=noise(scale), distances=DISTANCE), near=2.0)
    gradient = Density(made.problem).slopes(made.x[None]).gradient[0]
    expected = scaled_gradient(made, made.x)
    np.testing.assert_allclose(gradient, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())


def plain_information(made, x, weight=1.0, freeze=None):
    """(f, f) weight J' S^-1 J of the shots, tr(S^-1 dS S^-1 dS) / 2 by the noise factors, the distances and
    the prior: by complex steps of the plain model. `freeze` leaves one of them out."""
    problem, p = made.problem, len(made.x)
    total = np.zeros((p, p))
    for i in range(problem.shots):
        s = made.covariance(x, i).real
        jacobian = by_complex_steps(lambda z, i=i: made.miss(z, i), x)
        if freeze != "shots":
            total += weight * jacobian.T @ np.linalg.solve(s, jacobian)
        if problem.noise.separate and freeze != "noise":
            by_s = by_complex_steps(lambda z, i=i: made.covariance(z, i), x)[..., -2:]
            changes = [np.linalg.solve(s, by_s[:, :, j]) for j in (0, 1)]
            total[-2:, -2:] += [[np.trace(a @ b) / 2 for b in changes] for a in changes]
    if problem.distances and freeze != "distance":
        by_distance = by_complex_steps(made.distances, x)
        total += by_distance.T @ by_distance
    free, scale = problem.parameters.free, problem.parameters.prior_std
    total = (total * np.outer(scale, scale))[free][:, free]
    return total if freeze == "prior" else total + np.eye(len(total))


@pytest.mark.parametrize(("tool", "scale"), PAIRS)
@pytest.mark.one_in(3)
def test_the_information_against_the_plain_model(arms, tool, scale):
    """Each entry in units of those on the diagonal; with one part left out it is another one."""
    made = Made(arms["irb1600"], header(TOOLS[tool], noise=noise(scale), distances=DISTANCE), near=2.0)
    density, x = Density(made.problem), made.x
    information = density.slopes(x[None]).information[0]
    np.testing.assert_array_equal(information, information.T)
    weight = density.noise_weight(x[None])[0]
    expected = plain_information(made, x, weight)
    unit = 1 / np.sqrt(np.diag(expected))

    def apart(other):
        return np.abs((information - other) * np.outer(unit, unit)).max()

    assert apart(expected) < 1e-9
    assert (np.abs(weight - 1) > 0.01) == (scale == "estimated")
    # The weight is on the shots alone.
    assert scale != "estimated" or apart(plain_information(made, x, 1.0)) > 1e-6
    for part in ("shots", "distance", "prior", *(["noise"] if scale == "separate" else [])):
        assert apart(plain_information(made, x, weight, freeze=part)) > 1e-8, part
    values = density.prior_information(x[None])[0]
    rest = plain_information(made, x, 0.0)  # distances and prior, and the noise's
    if scale == "separate":
        rest = rest - plain_information(made, x, 0.0, freeze="distance") + np.eye(len(rest))
    np.testing.assert_allclose(values, rest, rtol=1e-9, atol=1e-9 * np.abs(rest).max())


@pytest.mark.parametrize("name", ["bent", "scara", "gantry"])
def test_arms_with_a_prismatic_joint(arms, name):
    """The whole street once: their offsets are in mm, and scaled by a prior in mm."""
    made = Made(arms[name], header(OPEN_PROBE if name == "gantry" else OPEN_LASER))
    density, x = Density(made.problem), made.x
    assert density.log_likelihood(x[None])[0] == pytest.approx(made.log_density(x), rel=1e-9)
    expected = scaled_gradient(made, x)
    slopes = density.slopes(x[None])
    np.testing.assert_allclose(slopes.gradient[0], expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())
    information = plain_information(made, x)
    unit = 1 / np.sqrt(np.diag(information))
    np.testing.assert_allclose(
        slopes.information[0] * np.outer(unit, unit), information * np.outer(unit, unit), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("tool", ["open laser", "probe"])
def test_a_shot_of_no_weight_is_a_shot_less(arms, scale, tool):
    """Exactly: what is added for it is zero, and it does not count as data."""
    made = Made(arms["irb1600"], header(TOOLS[tool], noise=noise(scale), distances=DISTANCE))
    problem, walkers = made.problem, made.walkers(3)
    keep = np.array([0, 2, 4, 5, 7])
    weights = np.zeros((1, problem.shots))
    weights[:, keep] = 1.0
    whole = Density(problem)
    out, fewer = whole.weighted(weights), Density(problem.select(keep))
    np.testing.assert_array_equal(out.numbers(), fewer.numbers())
    assert out.numbers()[0] == 5 * problem.tool.residual_size
    for name in ("log_likelihood", "noise_weight", "log_posterior"):
        np.testing.assert_array_equal(getattr(out, name)(walkers), getattr(fewer, name)(walkers))
    for one, two in zip(out.slopes(walkers), fewer.slopes(walkers), strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(
        whole.weighted(whole.weights).log_likelihood(walkers), whole.log_likelihood(walkers)
    )
    assert np.abs(out.log_likelihood(walkers) - whole.log_likelihood(walkers)).min() > 0.1


def test_each_data_set_may_have_weights_of_its_own(made):
    """One recording, three weightings: leave-one-out side by side."""
    count = made.problem.shots
    weights = np.ones((count, count))
    weights[np.arange(count), np.arange(count)] = 0
    density = Density(made.problem).weighted(weights)
    walkers = made.walkers(count)
    values, slopes = density.log_likelihood(walkers), density.slopes(walkers)
    for i in range(count):
        alone = Density(made.problem).weighted(weights[i : i + 1])
        assert values[i] == alone.log_likelihood(walkers[i : i + 1])[0]
        for part, other in zip(slopes, alone.slopes(walkers[i : i + 1]), strict=True):
            np.testing.assert_array_equal(part[i], other[0])
    of = np.array([3, 3, 0])
    np.testing.assert_array_equal(
        density.log_likelihood(np.tile(made.x, (3, 1)), of),
        density.log_likelihood(np.tile(made.x, (count, 1)))[of],
    )


@pytest.mark.parametrize("rows", ROWS)
@pytest.mark.one_in(3)
def test_rows_do_not_know_of_each_other(each_scale, rows):
    """To the last bit, however many fill the lanes, several data sets or one."""
    problem, walkers = each_scale.problem, each_scale.walkers(rows)
    joints, spots = recordings(each_scale, 4)
    of = np.arange(rows) % 4
    many = Density(problem, joints, spots)
    one = Density(problem)
    for density, index in ((many, of), (one, None)):
        values, slopes = density.log_likelihood(walkers, index), density.slopes(walkers, index)
        weight = density.noise_weight(walkers, index)
        for i in range(rows):
            moved = problem if index is None else problem.moved(joints[of[i]], spots[of[i]])
            alone, x = Density(moved), walkers[i : i + 1]
            assert values[i] == alone.log_likelihood(x)[0]
            assert weight[i] == alone.noise_weight(x)[0]
            for part, single in zip(slopes, alone.slopes(x), strict=True):
                np.testing.assert_array_equal(part[i], single[0])
    if rows > 1:  # control: of other data sets they are others
        other = many.log_likelihood(walkers, (of + 1) % 4)
        assert (np.abs(other - many.log_likelihood(walkers, of)) > 1e-3).all()


def test_without_a_choice_each_row_has_a_data_set_of_its_own(each_scale):
    """And nothing is kept from the rows before, whose inputs are made once."""
    joints, spots = recordings(each_scale, 4)
    density, walkers = Density(each_scale.problem, joints, spots), each_scale.walkers(4)
    np.testing.assert_array_equal(
        density.log_posterior(walkers), density.log_posterior(walkers, np.arange(4))
    )
    first = density.slopes(walkers)
    density.slopes(walkers[:2], np.array([3, 1]))
    density.quads(each_scale.x)
    for one, two in zip(first, density.slopes(walkers, np.arange(4)), strict=True):
        np.testing.assert_array_equal(one, two)


@pytest.mark.skipif(kernel._compiler() is None, reason="no C compiler on this machine")
@pytest.mark.parametrize(
    ("name", "scale"),
    [("bent", "separate"), ("gantry", "separate"), ("irb1600", "known"), ("scara", "estimated")],
)
@pytest.mark.at_length(r"^(?!irb1600-sep|gantry)")
def test_without_a_compiler_the_numbers_are_the_same(arms, name, scale, monkeypatch):
    """Two targets, and prismatic joints (scara, gantry, bent): not one bit of difference where the C library
    is the one that CasADi calls; 1e-12 of the largest is what is promised."""
    content = header(OPEN_PROBE if name == "gantry" else OPEN_LASER, noise=noise(scale))
    made = Made(arms[name], content)
    data = recordings(made, 3)

    def results(density):
        result = []
        for rows in ROWS:
            of, walkers = np.arange(rows) % 3, made.walkers(rows)
            result += [density.log_posterior(walkers, of), *density.slopes(walkers, of)]
        return result, density._kernel("slopes").compiled

    monkeypatch.setattr(kernel, "_COMPILE_AFTER", 1)
    monkeypatch.setattr(kernel, "_LOOK_AFTER", 1)
    monkeypatch.setattr(constraint, "_made", {})  # not those that are there already
    compiled, by_c = results(Density(Made(arms[name], content).problem, *data))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", kernel.KernelWarning)
        monkeypatch.setattr(kernel, "_compiler", lambda: None)
        monkeypatch.setattr(constraint, "_made", {})
        plain, not_by_c = results(Density(Made(arms[name], content).problem, *data))
    assert (by_c, not_by_c) == (True, False)
    for one, two in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12 * np.abs(two).max())
