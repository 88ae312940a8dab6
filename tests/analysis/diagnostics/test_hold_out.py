import numpy as np
import pytest
from cells import TABLE_2, header, irb1600, plan_of, simulated_problem, varied_postures
from scipy import stats

from zerobeam.analysis.diagnostics import hold_out as module
from zerobeam.analysis.diagnostics.hold_out import hold_out
from zerobeam.model.kinematics.robot import DHRow, Robot, dh_chain
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.findings import hold_out_message

PLACES = {"left": (800.0, 300.0, 100.0), "right": (850.0, -350.0, 200.0), "psd": (900.0, 0.0, 0.0)}
LEVEL = 1e-3


def plan(shots, robot=None, **noise):
    """So many shots of each target, by name."""
    targets = {name: {"guess_mm": list(PLACES[name])} for name in shots}
    own = header(target=None, targets=targets, noise=noise)
    postures = [
        varied_postures(header(target=PLACES[name]), irb1600(), PLACES[name], count, 5 + i)
        for i, (name, count) in enumerate(shots.items())
    ]
    names = [name for name, count in shots.items() for _ in range(count)]
    return plan_of(own, np.concatenate(postures), names, robot)


TWO, THREE = {"psd": 10, "left": 6}, {"psd": 7, "left": 6, "right": 5}


def recorded(shots, stated, count):
    """`count` simulated runs of the known noise, as problems with what is `stated`."""
    truly = plan(shots)
    problem = Problem.from_plan(stated)
    for seed in range(count):
        _, run = simulated_problem(truly, TABLE_2, seed)
        yield problem.moved(run.joints, run.spots)


def p_values(shots, stated, count, names=("left",)):
    told = [hold_out(problem, names) for problem in recorded(shots, stated, count)]
    return np.array([held.p_value for held in told])


# --- the check against the noise --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shots", "names"), [(TWO, ["left"]), (THREE, ["left", "right"])], ids=["one", "two"]
)
def test_the_p_values_are_uniform(shots, names):
    """120 runs by Kolmogorov and Smirnov, at a level of 1e-3: D below 0.176."""
    p = p_values(shots, plan(shots), 120, names)
    assert stats.kstest(p, "uniform").pvalue > LEVEL
    # Negative control: as if the noise were 0.75 of what it is.
    dof = 2 * sum(shots[name] for name in names) - 3 * len(names)
    wrong = stats.chi2.sf(stats.chi2.isf(p, dof) / 0.75**2, dof)
    assert stats.kstest(wrong, "uniform").pvalue < LEVEL


def test_with_an_estimated_scale_they_are_uniform_as_well():
    """Twelve degrees of freedom of the scale are no known noise: F and not chi-squared."""
    p = p_values(TWO, plan(TWO, scale="estimated"), 120)
    assert stats.kstest(p, "uniform").pvalue > LEVEL
    # Negative control: chi-squared with the same misses would see far misses where there are none.
    ratio = stats.f.isf(p, 9, 12)
    few = stats.binom.isf(LEVEL, 120, 0.01)
    assert (p < 0.01).sum() <= few < (stats.chi2.sf(9 * ratio, 9) < 0.01).sum()


def test_an_understated_noise_is_seen():
    half = plan(TWO, joint_deg=0.005, spot_mm=0.025)
    p = p_values(TWO, half, 20)
    # chi-squared of 9 times 4: above the limit of 1e-3 (27.9) in two of three runs.
    assert (p < LEVEL).sum() >= stats.binom.ppf(LEVEL, 20, stats.chi2.sf(stats.chi2.isf(LEVEL, 9) / 4, 9))
    assert np.median(p) < LEVEL


def longer_forearm(by_mm):
    """The built-in arm with joint 4 further out."""
    rows = [(150, -90, 486.5, 0), (700, 0, 0, -90), (0, 90, 0, 180), (0, -90, 600 + by_mm, 0)]
    rows += [(0, 90, 0, 0), (0, 0, 0, 0)]
    fixed, flange = dh_chain(
        [DHRow(a, float(np.radians(alpha)), d, float(np.radians(theta))) for a, alpha, d, theta in rows],
        "standard",
    )
    nominal = irb1600()
    joints = tuple(
        type(joint)(joint.name, joint.kind, before, joint.axis, joint.lower, joint.upper)
        for joint, before in zip(nominal.joints, fixed, strict=True)
    )
    return Robot("longer", joints, flange)


@pytest.mark.parametrize(("by_mm", "seen"), [(0.0, False), (5.0, True)])
def test_a_wrong_link_length_is_seen(by_mm, seen):
    """Five millimetres: the offsets that make up for it at one target do not at another."""
    p = p_values(TWO, plan(TWO, longer_forearm(by_mm)), 10)
    assert (np.median(p) < LEVEL) == seen
    if not seen:
        assert p.min() > LEVEL


def test_what_the_fit_leaves_open_is_in_the_check():
    """Few shots fitted, many held out: without the fit's covariance the misses would be far too long."""
    shots = {"psd": 5, "left": 12}
    p = p_values(shots, plan(shots), 60)
    assert stats.kstest(p, "uniform").pvalue > LEVEL


# --- what is told -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def three():
    return simulated_problem(plan(THREE), TABLE_2, seed=3)[1]


def test_the_offsets_carry_over(three):
    held = hold_out(three, ["left"])
    assert (held.targets, held.shots, held.shots_fitted) == (("left",), 6, 12)
    assert held.dof == 2 * 6 - 3
    assert held.p_value == pytest.approx(stats.chi2.sf(held.chi2, 9))
    assert held.rms_mm < held.rms_before_mm / 5
    assert hold_out_message(held) is None


def test_the_rms_is_that_of_the_misses_once_the_target_is_placed(three, monkeypatch):
    """Offsets of a fit of the other shots alone; the target by scipy; the miss by the model."""
    from scipy import optimize

    from zerobeam.analysis.estimation.fit import fit_likelihood

    rows = np.flatnonzero(three.target_index == three.targets.index("left"))
    fit = fit_likelihood(three.select(np.setdiff1d(np.arange(three.shots), rows)), starts=0)
    at = three.robot.n + 3 * three.targets.index("left") + np.arange(3)

    def whitened(place):
        x = fit.x.copy()
        x[at] = place
        return three.select(rows).whiten(x).residual

    def weights_kept(place, factor):
        x = fit.x.copy()
        x[at] = place
        return three.select(rows).whiten(x, factor).residual

    place = np.array(PLACES["left"])
    for _ in range(20):  # as for any fit with weights that move: refreshed until they settle
        x = fit.x.copy()
        x[at] = place
        factor = three.select(rows).whiten(x).factor
        place = optimize.least_squares(weights_kept, place, args=(factor,), x_scale=1e-2).x
    x[at] = place
    miss, _ = three.select(rows).linearise(x)
    assert hold_out(three, ["left"]).rms_mm == pytest.approx(np.sqrt((miss**2).sum(axis=1).mean()), rel=1e-4)


@pytest.mark.parametrize(
    ("patterns", "names"),
    [
        (["left"], ("left",)),
        (["l*"], ("left",)),
        (["?eft"], ("left",)),
        (["*t"], ("left", "right")),
        (["right", "left"], ("left", "right")),
        (["left", "l*"], ("left",)),
    ],
)
def test_patterns_are_those_of_file_names(three, patterns, names):
    assert sorted(hold_out(three, patterns).targets) == sorted(names)


@pytest.mark.parametrize("patterns", [["wall"], ["LEFT"], ["left", "wall*"], ["lef"]])
def test_a_name_that_is_not_there_is_refused(three, refused, patterns):
    error = refused(hold_out, three, patterns)
    assert error.found == patterns[-1]
    assert error.allowed == "psd, left, right"


def test_nothing_left_to_fit_is_refused(three, refused):
    error = refused(hold_out, three, ["*"])
    assert "nothing left to fit" in error.what
    assert "leave at least one target in" in error.remedy


def test_one_shot_always_hits():
    """Two numbers for three coordinates: nothing to check, and that is said."""
    shots = {"psd": 10, "left": 1}
    _, problem = simulated_problem(plan(shots), TABLE_2, seed=3)
    held = hold_out(problem, ["left"])
    assert (held.dof, held.chi2, held.p_value) == (0, None, None)
    assert "zero degrees of freedom" in hold_out_message(held)
    assert held.rms_mm < 1e-6


def test_what_is_held_out_has_no_say_in_the_fit(three, monkeypatch):
    """Other recordings of it: the offsets are the same to the last bit. Of another target: they are not."""
    real, fits = module.fit_likelihood, []

    def watched(*args, **kwargs):
        fits.append(real(*args, **kwargs))
        return fits[-1]

    monkeypatch.setattr(module, "fit_likelihood", watched)
    first = hold_out(three, ["left"])
    for name in ("left", "right"):
        joints = three.joints.copy()
        joints[three.target_index == three.targets.index(name), 4] += np.radians(0.3)
        hold_out(three.moved(joints), ["left"])
    np.testing.assert_array_equal(fits[0].x, fits[1].x)
    np.testing.assert_array_equal(fits[0].covariance, fits[1].covariance)
    assert not np.array_equal(fits[0].x, fits[2].x)
    assert hold_out(three, ["left"]) == first


def test_a_target_that_is_not_held_out_is_fitted(three):
    """With more targets in the fit less is left open, and the held-out shots are the same."""
    both = hold_out(three, ["left"])
    assert both.shots_fitted == 12
    alone = hold_out(three, ["left", "right"])
    assert (alone.shots_fitted, alone.shots) == (7, 11)
    _, problem = simulated_problem(plan({"psd": 7, "left": 6}), TABLE_2, seed=3)
    assert hold_out(problem, ["left"]).shots_fitted == 7


def test_a_fit_that_did_not_converge_tells_nothing(three, monkeypatch):
    import dataclasses

    real = module.fit_likelihood
    monkeypatch.setattr(
        module,
        "fit_likelihood",
        lambda *args, **kwargs: dataclasses.replace(
            real(*args, **kwargs), converged=False, reason="no way up"
        ),
    )
    held = hold_out(three, ["left"])
    assert (held.rms_mm, held.rms_before_mm, held.chi2, held.dof, held.p_value) == (None,) * 5
    assert hold_out_message(held) == "the fit without them did not converge: no way up"


def test_with_separate_noise_factors():
    """The noise must not be blamed for what are offsets: the misses are as short as with known noise."""
    _, run = simulated_problem(plan(TWO), TABLE_2, seed=0)
    known = hold_out(Problem.from_plan(plan(TWO)).moved(run.joints, run.spots), ["left"])
    open_noise = hold_out(
        Problem.from_plan(plan(TWO, scale="separate")).moved(run.joints, run.spots), ["left"]
    )
    assert open_noise.rms_mm == pytest.approx(known.rms_mm, rel=0.1)
    assert open_noise.dof == known.dof
