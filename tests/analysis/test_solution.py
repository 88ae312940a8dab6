"""Several local optima that explain the data about as well: no one of them is reported for what differs."""

from dataclasses import replace

import numpy as np
import pytest
from cells import LASER, TABLE_2, good_plan, simulated_problem
from example_results import analysed

from zerobeam.analysis.answer.findings import OtherBasins
from zerobeam.analysis.estimation.fit import LikelihoodFit, Optimum, fit_likelihood
from zerobeam.analysis.observability.causes import LocalOptima
from zerobeam.analysis.solution import EQUALLY_GOOD, judge, undecided_names
from zerobeam.model.arrays import Matrix
from zerobeam.words.finding_words import finding_sentence
from zerobeam.words.observability import direction_kind, reason, remedy


@pytest.fixture(scope="module")
def good() -> LikelihoodFit:
    _, problem = simulated_problem(good_plan(), TABLE_2, seed=2)
    return fit_likelihood(problem)


def with_other(fit: LikelihoodFit, away: Matrix, below: float, spread: float = 1.0) -> LikelihoodFit:
    """The fit with an optimum `away` (f,) stds, its stds `spread` times those of the best."""
    return replace(fit, others=(Optimum(fit.z + away * fit.std, spread * fit.std, below),))


def along(fit: LikelihoodFit, name: str, stds: float) -> Matrix:
    names = [item.name for item in fit.problem.parameters.items if not item.held]
    return np.where(np.array(names) == name, stds, 0.0)


def test_two_optima_of_a_run_are_not_one_estimate() -> None:
    """The X-Pattern with two of them, 0.2 apart in log-posterior; the true offset is 0.005°. (The covariance
    of such a solution: `test_only_what_differs_is_lost`.)"""
    found = analysed("hostile")
    assert found.result.likelihood.other_basins
    rows = {own.name: own for own in found.result.parameters}
    row = rows["delta5"]
    assert row.status == "unidentifiable"
    assert row.estimate is row.std is row.interval95 is row.data_std is None
    assert found.draws is not None
    assert "delta5" not in found.draws.names
    assert {interval.name for interval in found.result.intervals}.isdisjoint({"delta5"})
    (posterior,) = (own for own in found.result.posterior.parameters if own.name == "delta5")
    assert posterior.source == "prior"
    # What the optima agree on is still there, and is right.
    for name, status in (("delta4", "weak"), ("delta6", "assumed")):
        assert rows[name].status == status
        low, high = rows[name].interval95 or (0.0, 0.0)
        assert low < TABLE_2[name] < high

    assert isinstance(row.cause, LocalOptima)
    (at,) = (own for own in row.cause.parameters if own.name == "delta5")
    assert at.values == pytest.approx((-5.52, 4.57), abs=0.05)
    assert reason(row.cause).startswith("two local optima explain the data about equally well: ")
    assert "delta5 = \u22125.5° or 4.6°" in reason(row.cause)
    assert "add measurements" in remedy(row.cause)
    (told,) = (finding for finding in found.result.findings if isinstance(finding, OtherBasins))
    assert "delta5" in told.undecided
    assert "What differs between them is unidentifiable" in finding_sentence(told)


def test_an_optimum_that_is_far_worse_takes_nothing_away() -> None:
    """Negative control: four measurements with wide priors have a second optimum, 10 below the best."""
    tool = {**LASER, "sigma": {"tilt_deg": 1e-6, "shift_mm": 1e-6}}  # four are too few to find it
    _, problem = simulated_problem(good_plan(4, tool=tool, prior={"offset_deg": 20.0}), {}, seed=1)
    fit = fit_likelihood(problem, seed=1)
    assert [own.below > EQUALLY_GOOD for own in fit.others] == [True]
    assert judge(fit).status == judge(replace(fit, others=())).status
    assert {row.status for row in judge(fit).offsets} == {"held", "weak", "identified"}
    # The same optimum, were it as good, would take the answer.
    (other,) = fit.others
    assert judge(replace(fit, others=(other._replace(below=1.0),))).verdict == "degenerate"


def test_only_what_differs_is_lost(good: LikelihoodFit) -> None:
    alone = judge(good)
    found = judge(with_other(good, along(good, "delta3", 5.0), below=EQUALLY_GOOD - 0.1))
    assert found["delta3"].status == "unidentifiable"
    assert undecided_names(found.null_space) == ("delta3",)
    for row in found:
        if row.name != "delta3":
            assert row == alone[row.name]
    rest = [name for name in alone.covariance.names if name != "delta3"]
    np.testing.assert_array_equal(found.covariance.matrix, alone.covariance.select(rest).matrix)
    (direction,) = (own for own in found.null_space if own.kind == "optima")
    assert direction.combination == {"delta3": 1.0}
    assert "another" in direction_kind(direction)


@pytest.mark.parametrize(
    ("stds", "below", "spread", "lost"),
    [
        (5.0, EQUALLY_GOOD + 0.1, 1.0, False),  # too much worse for noise to have made the best one best
        (0.9, 0.1, 1.0, False),  # within the uncertainty
        (1.1, 0.1, 1.0, True),
        (0.1, 0.1, 3.0, True),  # nearly the same value, but far less certain
    ],
)
def test_where_the_interval_holds_for_both(
    good: LikelihoodFit, stds: float, below: float, spread: float, lost: bool
) -> None:
    away = along(good, "delta3", stds)
    found = judge(with_other(good, away, below, spread))
    assert (found["delta3"].status == "unidentifiable") == lost


def test_of_several_optima_each_takes_its_own(good: LikelihoodFit) -> None:
    others = tuple(
        Optimum(good.z + along(good, name, -8.0) * good.std, good.std, 0.5) for name in ("delta2", "delta4")
    )
    found = judge(replace(good, others=others))
    assert undecided_names(found.null_space) == ("delta2", "delta4")
    for name in ("delta2", "delta4"):
        cause = found[name].cause
        assert isinstance(cause, LocalOptima)
        assert cause.count == 3
        assert [own.name for own in cause.parameters] == [name]
        assert reason(cause).startswith(f"3 local optima explain the data about equally well: {name} = ")


def test_noise_makes_a_wrong_optimum_so_much_better_once_in_a_thousand() -> None:
    """The threshold: with the truth at one of two values, the chance that the other one is so much better."""
    rng, worst = np.random.default_rng(5), 0.0
    for apart in np.linspace(1.0, 6.0, 11):
        noise = rng.normal(size=200_000)
        better = noise * apart - apart**2 / 2  # log-likelihood at the other value less that at the true one
        worst = max(worst, float((better >= EQUALLY_GOOD).mean()))
    assert 1e-5 < worst < 1e-3
