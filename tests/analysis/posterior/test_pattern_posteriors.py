"""Posteriors of the pattern of the paper, of patterns near it, and of good plans, on arms as real ones are.

What is right is said by a simulator of its own, by Hamiltonian chains, and by the truth.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from cells import header, irb1600
from deviating_arms import Arms, Sizes
from hamiltonian import hamiltonian
from measured_arms import CELLS, recorded
from scipy import stats

from zerobeam.analysis.estimation.coordinates import FlangeCoordinates
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.posterior import posterior as posterior_module
from zerobeam.analysis.posterior.posterior import Agreement, PosteriorSummary, sample_posterior
from zerobeam.analysis.solution import Solution
from zerobeam.experiments.plans.candidates import candidates
from zerobeam.experiments.plans.optimal import Planner
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.finding_words import posterior_message

TARGETS = {"front": (900.0, 0.0, 0.0), "left": (900.0, 300.0, 100.0), "near": (750.0, -150.0, 200.0)}
OFFSETS = [f"delta{k}" for k in range(2, 7)]


@functools.cache
def postures(kind: str, shots: int, place: str) -> np.ndarray:
    target = TARGETS[place]
    if kind == "y":
        return pattern(header(target=target), irb1600(), np.array(target), "y", shots)
    if kind.startswith("x"):
        # The X-Pattern whose joint 1 varies by so many degrees.
        joints = pattern(header(target=target), irb1600(), np.array(target), "x", shots).copy()
        aside = np.radians(float(kind[1:])) * np.linspace(-0.5, 0.5, shots)
        joints[:, 0] += np.random.default_rng(3).permutation(aside)
        return joints
    own, at = header(target=target, geometry=None), np.array(target)
    planner = Planner(own, irb1600(), {"psd": at}, [candidates(own, irb1600(), at, 1000, seed=0)])
    return planner.optimal(shots, starts=2).postures


def of_arms(
    kind: str, shots: int, place: str, count: int, seed: int
) -> Iterator[tuple[np.ndarray, Solution]]:
    """True offsets (6,) rad and the solution of each of so many typical arms."""
    rng = np.random.default_rng(seed)
    if kind == "tracker":
        cell = CELLS["tracker"]
        own = cell.header(geometry=None, joint_deg=0.01)
        for _ in range(count):
            arm = recorded(cell, shots, rng, exact=False, joint_deg=0.01)
            yield arm.offsets, solve_run(Problem.of_measured(own, irb1600(), arm.joints, arm.measured), own)
        return
    own, target = header(target=TARGETS[place], geometry=None), np.array(TARGETS[place])
    arms = Arms.at_random(count, rng, Sizes())
    joints, hit = arms.recorded(postures(kind, shots, place), target, rng)
    for k in range(count):
        seen = joints[k][hit[k]]
        yield arms.offsets[k], solve_run(Problem.build(own, irb1600(), seen, ["psd"] * len(seen)), own)


@functools.cache
def y_pattern() -> Solution:
    """Of one typical arm, by the seven postures of the paper."""
    ((_, solution),) = of_arms("y", 7, "front", 1, seed=9)
    return solution


def stds(summary: PosteriorSummary) -> np.ndarray:
    assert summary.parameters is not None
    return np.array([row.std for row in summary.parameters if row.name in OFFSETS])


def by_hamiltonian(solution: Solution, *, chains: int, warm: int, steps: int) -> np.ndarray:
    """(m,) stds of the offsets, deg; without the sheet, in coordinates that are whitened by the fit alone."""
    density = Density(solution.problem)
    coordinates = FlangeCoordinates(density)
    fit = solution.fit
    centre = coordinates.from_parameters(fit.x[None])[0]
    factor = np.linalg.cholesky(coordinates.covariance(fit.x[None], fit.covariance[None])[0])

    def slopes(w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at = coordinates.at(centre + w @ factor.T)
        found = density.slopes(at.x, with_information=False)
        return found.value, at.gradient(found.gradient) @ factor

    draws = hamiltonian(slopes, len(centre), chains=chains, warm=warm, steps=steps, leaps=40, seed=3)
    x = coordinates.to_parameters(centre + draws.reshape(-1, len(centre)) @ factor.T)
    parameters = solution.problem.parameters
    # The last one is part of a free tool.
    which = [i for i in map(parameters.index, OFFSETS) if parameters.free[i]]
    return np.asarray(np.degrees(x[:, which]).std(axis=0))


def test_the_posterior_of_the_papers_pattern_is_as_wide_as_it_is():
    """On this thin curved sheet of 45 dimensions curvature and posterior agree; the draws were a third too
    narrow, and their R-hat was 1.004."""
    solution = y_pattern()
    summary, _ = sample_posterior(solution, seed=1)
    assert summary.converged
    assert summary.agreement is not None
    assert summary.agreement.by == "importance"
    assert summary.agreement.pareto_k < 0.5
    assert summary.agreement.share > 0.8
    curvature = np.array([solution.parameters.named(name).std for name in OFFSETS])
    # To 4 errors of a std, and 2 % for what is not quadratic.
    assert np.abs(stds(summary) / curvature - 1).max() < 0.02 + 4 / np.sqrt(2 * summary.ess_min)
    assert posterior_message(summary).endswith(
        f". Importance sampling agrees with them (Pareto k̂ {summary.agreement.pareto_k:.2g})"
    )


def in_plain_coordinates(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sampler without the sheet."""
    monkeypatch.setattr("zerobeam.analysis.posterior.sheet.sheet_of", lambda local, size: None)


def test_without_the_sheet_the_draws_are_too_narrow_and_the_gate_says_so(monkeypatch):
    """Control: R-hat passes, the density itself does not."""
    in_plain_coordinates(monkeypatch)
    monkeypatch.setattr("zerobeam.analysis.posterior.sampler.BUDGET", 0)  # no more than the first look
    summary, draws = sample_posterior(y_pattern(), seed=1)
    assert summary.rhat_max <= 1.01
    assert summary.ess_min >= 1000
    assert not summary.converged
    assert not draws.converged
    assert summary.parameters is None
    assert isinstance(summary.agreement, Agreement)
    assert not summary.agreement.holds
    assert summary.agreement.off > 0.05
    said = posterior_message(summary)
    assert "its ensembles agree with each other" in said
    assert "but not with the profile likelihood: the 95 % interval of J" in said


@pytest.mark.long
def test_where_no_other_method_serves_the_draws_are_not_converged(monkeypatch):
    in_plain_coordinates(monkeypatch)
    monkeypatch.setattr("zerobeam.analysis.posterior.sampler.BUDGET", 0)
    monkeypatch.setattr(posterior_module, "profile_ends", lambda _, which: np.full((len(which), 2), np.nan))
    summary, _ = sample_posterior(y_pattern(), seed=1)
    assert not summary.converged
    assert summary.agreement.by is None
    assert "but no other method confirms them (Pareto k̂ " in posterior_message(summary)


@pytest.mark.long
def test_hamiltonian_chains_see_the_same():
    """Long ones, of which each step is nearly independent: 30,000 draws, a std to 0.6 %; of the chains
    9,000 effective ones, to 0.8 %, of so curved a posterior to twice that: the largest of five below 2.5."""
    solution = y_pattern()
    summary, _ = sample_posterior(solution, seed=1, ess=4000)
    expected = by_hamiltonian(solution, chains=256, warm=150, steps=120)
    assert np.abs(stds(summary) / expected - 1).max() < 0.045


@dataclass(frozen=True)
class Case:
    kind: str
    shots: int
    place: str = "front"

    def __str__(self) -> str:
        return f"{self.kind}, {self.shots}, {self.place}"


CASES = [
    *(Case("y", shots, place) for shots in (7, 14) for place in TARGETS),
    *(Case(kind, 7) for kind in ("x2", "x5", "x10")),
    *(Case("optimal", shots) for shots in (7, 12, 20)),
    Case("tracker", 12),
]


def ratios(case: Case, count: int) -> np.ndarray:
    """(A, m) of so many arms the stds of the draws over those of Hamiltonian chains."""
    found = []
    with one_blas_thread():
        for k, (_, solution) in enumerate(of_arms(case.kind, case.shots, case.place, count, seed=77)):
            if solution.misfit is not None:
                continue
            summary, _ = sample_posterior(solution, seed=k)
            assert summary.converged, posterior_message(summary)
            found.append(stds(summary) / by_hamiltonian(solution, chains=64, warm=120, steps=40))
    return np.array(found)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=str)
def test_stds_are_those_of_hamiltonian_chains(case: Case):
    """Six arms each: the median of 30 ratios, each right to 2 %."""
    found = ratios(case, 6)
    assert len(found) >= 4
    assert 0.97 < np.median(found) < 1.03


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=str)
def test_intervals_of_the_posterior_hold(case: Case):
    """Of 60 typical arms each: 95 % of the intervals contain the truth, within the binomial error."""
    held: dict[str, list[bool]] = {name: [] for name in OFFSETS}
    left_out = 0
    with one_blas_thread():
        for k, (offsets, solution) in enumerate(of_arms(case.kind, case.shots, case.place, 60, seed=11)):
            if solution.misfit is not None:
                left_out += 1
                continue
            summary, _ = sample_posterior(solution, seed=k)
            assert summary.converged, posterior_message(summary)
            for row in summary.parameters:
                if row.name in OFFSETS and row.source == "data":
                    true = np.degrees(offsets[OFFSETS.index(row.name) + 1])
                    held[row.name].append(row.q2_5 < true < row.q97_5)
    assert left_out <= 6
    # Five offsets of one arm are not independent: each is judged by itself, all tests together at 1 %.
    level = 0.01 / len(CASES) / len(OFFSETS)
    for rows in held.values():
        if rows:
            assert stats.binomtest(sum(rows), len(rows), 0.95).pvalue > level
