"""Tolerances that are too small, on tracker data: named with what they would have to be; and no false alarms.

The arms are those of a simulator that shares no code with the model.
"""

import numpy as np
import pytest
from cells import irb1600
from measured_arms import CELLS, Cell, recorded, tracker
from scipy import stats

from zerobeam.analysis.estimation.fit import LikelihoodFit, fit_likelihood
from zerobeam.analysis.misfit import Misfit, TightPrior, Tolerances, tight_priors
from zerobeam.analysis.solution import judge
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.misfit_words import criterion_sentence, larger_tolerance

JOINT_DEG = 0.003
GEOMETRY = {"gravity": True, "harmonics": True, "masses_kg": [150, 60, 40, 20, 8, 4]}
LEVEL = 1e-4


def measured(
    seed: int, *, cell: Cell = CELLS["tracker"], count: int = 60, off_mm: float = 0.0, **sizes: float
) -> Problem:
    """An arm at random by three reflectors, whose typical tolerances the header states."""
    header = cell.header(geometry=GEOMETRY, joint_deg=JOINT_DEG)
    arm = recorded(
        cell,
        count,
        np.random.default_rng(seed),
        exact=False,
        joint_deg=JOINT_DEG,
        off_mm=off_mm,
        lost_deg=0.0,
        **sizes,
    )
    return Problem.of_measured(header, irb1600(), arm.joints, arm.measured)


def tight(misfit: Misfit | None) -> dict[str, TightPrior]:
    criteria = () if misfit is None else misfit.criteria
    return {one.of: one for one in criteria if isinstance(one, TightPrior)}


@pytest.mark.long
def test_gravity_beyond_its_prior_is_named_with_what_the_prior_would_have_to_be() -> None:
    with one_blas_thread():
        solution = judge(fit_likelihood(measured(1, gravity_deg=0.25), starts=0))
    assert solution.verdict == "misfit"
    prior = tight(solution.misfit)["gravity"]
    assert prior.stated == pytest.approx(0.05)
    assert prior.needed == pytest.approx(prior.times * 0.05)
    # Of five joints that bend: the standard deviation of a normal is known to a factor of about 1.4.
    assert 0.25 / 2 < prior.needed < 0.25 * 2
    sentence = criterion_sentence(prior)
    assert "deflection under gravity is too small" in sentence
    assert "instead of 0.05" in sentence
    assert "geometry.gravity_deg: 0." in larger_tolerance(prior)


def tolerance_groups(fit: LikelihoodFit) -> list[TightPrior]:
    """All groups of which the data determine something, each judged with the others as they are stated."""
    tolerances = Tolerances(fit)
    return [tolerances.row(name) for name in tolerances.groups]


@pytest.mark.parametrize(
    ("of", "sizes", "key"),
    [
        ("length", {"length_mm": 2.0}, "geometry.tolerance.length_mm"),
        ("angle", {"angle_deg": 0.7}, "geometry.tolerance.angle_deg"),
        ("gravity", {"gravity_deg": 0.4}, "geometry.gravity_deg"),
        ("harmonics", {"harmonic_deg": 0.15}, "geometry.harmonics_deg"),
    ],
)
@pytest.mark.parametrize("arms", [2, pytest.param(30, marks=pytest.mark.long)])
@pytest.mark.at_length(r"^(?!2-gravity)")
def test_what_a_tolerance_would_have_to_be(of: str, sizes: dict[str, float], key: str, arms: int) -> None:
    """By the logarithms of what is needed over what was drawn from, each over its standard error."""
    errors, named, (true,) = [], 0, sizes.values()
    with one_blas_thread():
        for seed in range(arms):
            fit = fit_likelihood(measured(20 + seed, **sizes), starts=0)
            (prior,) = (group for group in tolerance_groups(fit) if group.of == of)
            assert key in larger_tolerance(prior)
            assert prior.needed is not None
            errors.append(np.log(prior.needed / true) * np.sqrt(2 * prior.dof))
            named += [group.of for group in tight_priors(fit)][:1] == [of]
    assert abs(np.mean(errors)) < 4 / np.sqrt(arms)
    # Of two joints that bend one arm in ten is within 0.05° all the same.
    assert named >= 0.75 * arms


def test_a_reflector_beyond_its_sigma_is_named() -> None:
    cell = Cell({"leica": tracker("free", 0.05)}, {}, CELLS["tracker"].turns)
    with one_blas_thread():
        (prior,) = tight_priors(fit_likelihood(measured(3, cell=cell, off_mm=1.0), starts=0))
    assert prior.of == "leica.R2"
    assert "leica.R2" in larger_tolerance(prior)


@pytest.mark.parametrize("count", [6, pytest.param(120, marks=pytest.mark.long)])
@pytest.mark.long
def test_arms_within_their_tolerances_raise_no_alarm(count: int) -> None:
    by_group: dict[str, list[float]] = {}
    with one_blas_thread():
        for seed in range(count):
            for one in tolerance_groups(fit_likelihood(measured(100 + seed), starts=0)):
                by_group.setdefault(one.of, []).append(stats.chi2.sf(one.chi2, one.dof))
    assert set(by_group) == {"length", "angle", "gravity", "harmonics"}
    for values in by_group.values():
        assert stats.kstest(values, "uniform").pvalue > LEVEL
