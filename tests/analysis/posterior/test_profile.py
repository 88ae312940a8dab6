import numpy as np
import pytest
from cells import OPEN_PROBE, TABLE_2, good_plan, header, irb1600, plan_of, simulated_problem
from plain_posterior import PlainPosterior
from scipy import optimize

from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.posterior import profiles
from zerobeam.analysis.posterior.profiles import ProfileContour, ProfileCurve, profile_intervals
from zerobeam.analysis.solution import judge
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.model.errors import BadInput

HALF = 1.959963984540054


def fitted(plan, seed):
    _, problem = simulated_problem(plan, TABLE_2, seed)
    fit = fit_likelihood(problem, starts=0)
    assert fit.converged
    which = np.flatnonzero(problem.parameters.free & problem.parameters.group("offset"))
    return problem, fit, which


def linear(problem, fit, which):
    """(m, 2) ends by the curvature."""
    std = problem.parameters.unscaled(fit.std)[which]
    return fit.x[which][:, None] + HALF * np.array([-1, 1]) * std[:, None]


@pytest.fixture(scope="module")
def weak():
    """Seven shots of the Y-Pattern over 0.4 of the reach: weak, and the misses are far from linear."""
    position = np.array([900.0, 150.0, 0.0])
    made_header = header(target=position)
    return fitted(plan_of(made_header, pattern(made_header, irb1600(), position, "y", 7, span=0.4)), seed=3)


class PlainProfile:
    """Brute force: one z fixed, the rest by scipy's least squares on plain residuals, a root by brentq."""

    def __init__(self, problem, fit, place):
        parameters = problem.parameters
        guess = tuple(parameters.prior_mean[parameters.group("target")])
        self.plain = PlainPosterior(problem.joints, problem.spots, guess, 0.01, 0.05)
        self.fit, self.place = fit, place
        self.rest = np.arange(len(fit.z)) != place
        self.best = self.plain.value(fit.z).real
        self.scale = parameters.prior_std[parameters.free][place]
        self.along = fit.covariance[:, place] / fit.covariance[place, place]

    def root(self, z, refit=True):
        """Square root of twice the drop, with the sign of the way."""
        start = self.fit.z + (z - self.fit.z[self.place]) * (self.along if refit else np.eye(8)[self.place])
        cost = self.plain.value(start).real
        if refit:

            def full(rest):
                point = start.copy()
                point[self.rest] = rest
                return point

            cost = optimize.least_squares(
                lambda rest: self.plain.residuals(full(rest)).real,
                start[self.rest],
                jac=lambda rest: self.plain.residual_jacobian(full(rest))[:, self.rest],
                x_scale=self.fit.std[self.rest],
                xtol=1e-14,
                ftol=1e-14,
                gtol=1e-12,
            ).cost
        way = z - self.fit.z[self.place]
        return np.sign(way) * np.sqrt(max(2 * (cost - self.best), 0.0))

    def end(self, sign, refit=True):
        centre, std = self.fit.z[self.place], self.fit.std[self.place]
        near, far = centre + 0.05 * sign * (std if refit else 1e-3 * std), centre + 6 * sign * std
        result = optimize.brentq(lambda z: self.root(z, refit) - sign * HALF, near, far, rtol=1e-6)
        return result * self.scale


@pytest.mark.parametrize("name", [pytest.param("delta2", marks=pytest.mark.long), "delta4"])
def test_against_a_brute_force_profile(weak, name):
    """The root of the drop is found to 1e-3 of 1.96: so are the ends, to some 1e-3 of the width."""
    problem, fit, _ = weak
    i = problem.parameters.index(name)
    ends = profile_intervals(problem, fit, np.array([i]), HALF)[0]
    plain = PlainProfile(problem, fit, i - 1)
    brute = np.array([plain.end(-1), plain.end(1)])
    width = brute[1] - brute[0]
    np.testing.assert_allclose(ends / width, brute / width, atol=2e-3)
    # Negative control: the others left where they are.
    alone = plain.end(1, refit=False) - plain.end(-1, refit=False)
    assert alone < width / 10


def test_on_a_good_plan_it_is_the_linear_interval():
    problem, fit, which = fitted(good_plan(), seed=2)
    ends = profile_intervals(problem, fit, which, HALF)
    straight = linear(problem, fit, which)
    width = straight[:, 1] - straight[:, 0]
    np.testing.assert_allclose((ends - straight) / width[:, None], 0, atol=0.01)
    # And in the order that was asked for.
    back = profile_intervals(problem, fit, which[::-1], HALF)
    np.testing.assert_allclose((back[::-1] - ends) / width[:, None], 0, atol=1e-3)


def test_the_half_width_is_that_of_the_level():
    problem, fit, which = fitted(good_plan(), seed=2)
    one, two = (profile_intervals(problem, fit, which, half) for half in (1.0, 2.0))
    np.testing.assert_allclose(np.diff(two) / np.diff(one), 2.0, rtol=0.01)


def test_it_is_asymmetric_where_the_ridge_is_bent(weak):
    """More to one side of the mode than to the other; the linear one never is."""
    problem, fit, which = weak
    ends = profile_intervals(problem, fit, which, HALF)
    assert np.isfinite(ends).all()
    assert (ends[:, 0] < fit.x[which]).all()
    assert (ends[:, 1] > fit.x[which]).all()
    sides = np.abs(ends - fit.x[which][:, None])
    assert (sides.max(axis=1) / sides.min(axis=1)).max() > 1.05
    even = np.abs(linear(problem, fit, which) - fit.x[which][:, None])
    np.testing.assert_allclose(even[:, 0], even[:, 1], rtol=1e-6)


def test_an_end_that_is_not_found_is_nan(weak, monkeypatch):
    problem, fit, which = weak
    monkeypatch.setattr(profiles, "_ROUNDS", 1)
    ends = profile_intervals(problem, fit, which, HALF)
    assert np.isnan(ends).any()


def test_held_parameters_and_targets_are_refused(weak):
    problem, fit, which = weak
    for name in ("psd.x", "delta1"):
        with pytest.raises(ValueError, match="free offsets, tool and noise"):
            profile_intervals(problem, fit, np.append(which, problem.parameters.index(name)), HALF)


def test_nothing_asked_nothing_told(weak):
    problem, fit, _ = weak
    assert profile_intervals(problem, fit, np.array([], dtype=int), HALF).shape == (0, 2)


# ── curves and contours ───────────────────────────────────────────────────────────────────────


def test_a_curve_is_that_of_brute_force(weak):
    """Where the ridge is bent, and with it away from the normal."""
    problem, fit, _ = weak
    curve = ProfileCurve.of(judge(fit), "delta4", size=5)
    plain = PlainProfile(problem, fit, problem.parameters.index("delta4") - 1)
    brute = [plain.root(value / plain.scale) for value in np.radians(curve.values)]
    np.testing.assert_allclose(curve.distance, brute, atol=2e-3)
    np.testing.assert_allclose(curve.normal, (curve.values - curve.estimate) / curve.u, atol=1e-9)
    assert np.abs(curve.distance - curve.normal).max() > 0.02


def test_the_interval_of_a_curve_ends_where_the_profile_interval_does(weak):
    problem, fit, _ = weak
    i = problem.parameters.index("delta4")
    curve = ProfileCurve.of(judge(fit), "delta4")
    low, high = np.degrees(profile_intervals(problem, fit, np.array([i]), HALF)[0])
    np.testing.assert_allclose(curve.interval(0.95), (low, high), atol=0.01 * (high - low))
    narrow = curve.interval(0.5)
    assert low < narrow[0] < curve.estimate < narrow[1] < high
    assert ProfileCurve.of(judge(fit), "delta4", width=1.0).interval(0.95) is None
    with pytest.raises(BadInput, match="between 0 and 1"):
        curve.interval(95)


def test_with_an_estimated_noise_the_distance_is_students():
    """Of a nearly linear fit the profile is Student's, and has no deviation from it."""
    _, problem = simulated_problem(good_plan(12, noise={"scale": "estimated"}), TABLE_2, seed=4)
    solution = judge(fit_likelihood(problem, starts=0))
    curve = ProfileCurve.of(solution, "delta3")
    assert np.isfinite(curve.dof)
    assert curve.deviation < 0.02
    row = solution["delta3"]
    np.testing.assert_allclose(curve.interval(0.95), row.interval(0.95), atol=0.02 * row.u)


def test_tolerances_do_not_scale_with_an_estimated_noise():
    """Some offsets of a typical arm are as uncertain as the noise, some as the tolerances. None deviates."""
    plan = good_plan(28, geometry=None, noise={"scale": "estimated"})
    _, problem = simulated_problem(plan, TABLE_2, seed=4)
    solution = judge(fit_likelihood(problem, starts=0))
    dofs = {row.name: row.dof for row in solution.offsets if not row.held}
    for name in (min(dofs, key=dofs.get), max(dofs, key=dofs.get)):
        curve = ProfileCurve.of(solution, name, size=7)
        assert curve.dof == dofs[name]
        assert curve.deviation < 0.15
    assert max(dofs.values()) > 5 * min(dofs.values())


def test_a_contour_reaches_to_the_quantile_of_two_parameters(weak):
    """At a point of its boundary the log-posterior has dropped by half the quantile of chi-squared: by brute
    force over all other parameters. The ellipse is the one of the covariance."""
    problem, fit, _ = weak
    solution = judge(fit)
    contour = ProfileContour.of(solution, "delta4", "delta5", level=0.68, size=8)
    wanted_drop = float(-2 * np.log(0.32))
    plain = PlainProfile(problem, fit, 0)
    both = np.array([problem.parameters.index(name) - 1 for name in contour.names])
    rest = np.setdiff1d(np.arange(len(fit.z)), both)
    scale = problem.parameters.prior_std[problem.parameters.free][both]
    for point in contour.points[[0, 3]]:
        z = fit.z.copy()
        z[both] = np.radians(point) / scale

        def full(values, z=z):
            point = z.copy()
            point[rest] = values
            return point

        best = optimize.least_squares(
            lambda values: plain.plain.residuals(full(values)).real,
            fit.z[rest],
            jac=lambda values: plain.plain.residual_jacobian(full(values))[:, rest],
            x_scale=fit.std[rest],
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-12,
        )
        assert 2 * (best.cost - plain.best) == pytest.approx(wanted_drop, rel=5e-3)
    covariance = solution.covariance.select(contour.names).matrix
    off = contour.ellipse - contour.estimates
    np.testing.assert_allclose((off @ np.linalg.inv(covariance) * off).sum(axis=1), wanted_drop, rtol=1e-6)
    np.testing.assert_array_equal(contour.points[0], contour.points[-1])


@pytest.mark.parametrize("name", ["delta1", "psd.x", "delta9"])
def test_what_has_no_profile_is_refused(weak, name):
    _, fit, _ = weak
    with pytest.raises(BadInput, match=name):
        ProfileCurve.of(judge(fit), name)
    with pytest.raises(BadInput, match=name):
        ProfileContour.of(judge(fit), "delta4", name)


def test_what_the_data_do_not_determine_has_no_profile():
    position = np.array([900.0, 0.0, 0.0])
    made_header = header(target=position)
    _, fit, _ = fitted(plan_of(made_header, pattern(made_header, irb1600(), position, "x", 7)), seed=3)
    solution = judge(fit)
    assert solution["delta2"].status == "unidentifiable"
    with pytest.raises(BadInput, match="do not determine"):
        ProfileCurve.of(solution, "delta2")


def test_of_what_is_stated_elsewhere_than_at_zero_it_is_about_the_estimate():
    """A tip 60, 20, 150 mm from the flange: the interval is about its own coordinates, not about 0."""
    _, problem = simulated_problem(good_plan(20, tool=OPEN_PROBE), TABLE_2, seed=4)
    fit = fit_likelihood(problem, starts=0)
    parameters = problem.parameters
    which = np.flatnonzero(parameters.free & parameters.group("tool"))
    assert (np.abs(parameters.prior_mean[which]) > 10).any()
    ends = profile_intervals(problem, fit, which, np.full(len(which), HALF))
    by_curvature = linear(problem, fit, which)
    off = np.abs(ends - by_curvature) / np.diff(by_curvature)
    assert (off < 0.2).all()  # the profile is bent where the tip is weak
    assert (off[2] < 0.01).all()
