"""Real arms with their geometry estimated: held-out placements, half against half, verdicts.

Bounds are those of an independent prototype (leave-one-placement-out residuals, mm) and of a public
calibrated model of the same arm. All runs state the noise of the readings as 0.01° and 0.1 mm, and have its
scale estimated.
"""

import dataclasses
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from halves import HalfAgainstHalf, half_against_half, rms, splits
from recordings import DINOVA_1, KUKA_14, PANDA_1, PANDA_2, recorded

from zerobeam.analysis.diagnostics.hold_out import LeaveOneOut, fits_without, hold_out, leave_one_out
from zerobeam.analysis.estimation.fit import fit_from, fit_likelihood
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.posterior.profiles import profile_intervals
from zerobeam.analysis.recordings.recordings import effective, placements
from zerobeam.analysis.recordings.steps import steps
from zerobeam.analysis.solution import Solution, judge
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import EXACT, StatedGeometry, StatedNoise
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.likelihood.problem import Problem

NOISE = StatedNoise(joint_deg=0.01, spot_mm=0.1, scale="estimated")
SLIPPED = ("high_0", "high_1")  # of panda_2: the plate slipped while they were recorded
SPLITS = 6


def whole(scale: Literal["known", "estimated"] = "known") -> StatedGeometry:
    return StatedGeometry(gravity=True, harmonics=True, scale=scale)


class Runs(dict[str, Run]):
    """By the arm's name, read when one is asked for."""

    def __init__(self, data: Path) -> None:
        self.data = data

    def __missing__(self, name: str) -> Run:
        (arm,) = (own for own in (KUKA_14, PANDA_1, PANDA_2, DINOVA_1) if own.name == name)
        self[name] = read_run(recorded(self.data, arm)[1])
        return self[name]


@pytest.fixture(scope="module")
def run(shared_data: Path) -> Runs:
    return Runs(shared_data)


def stated(run: Run, geometry: StatedGeometry | None) -> Run:
    header = run.header.model_copy(update={"geometry": geometry or EXACT, "noise": NOISE})
    return dataclasses.replace(run, header=header)


def answer(
    run: Run, geometry: StatedGeometry | None, *, without: tuple[str, ...] = (), once: bool = False
) -> Solution:
    """The run solved as `analyse` does; `once`: each measurement as it is, not at the effective number."""
    own = stated(run, geometry)
    problem = Problem.from_run(own)
    if without:
        problem = problem.without_targets(without)
    found = solve_run(problem, own.header)
    if once:
        plain = found.problem.weighted(1 / found.problem.weights)
        return judge(fit_from(plain, found.fit.x))
    return found


def held_out(solution: Solution) -> LeaveOneOut:
    found = leave_one_out(solution, fits_without(solution))
    assert found is not None
    return found


def compared(solution: Solution, count: int) -> list[HalfAgainstHalf]:
    names = [placement.name for placement in placements(solution.problem)]
    found = [half_against_half(solution, first) for first in splits(names, count)]
    assert all(half.converged for half in found)
    return found


# --- kuka_14 and panda_1 --------------------------------------------------------------


@pytest.fixture(scope="module")
def kuka(run: Runs) -> Solution:
    return answer(run["kuka_14"], whole())


@pytest.mark.long
def test_kuka_14_predicts_placements_that_it_has_not_seen(kuka: Solution, run: Runs) -> None:
    assert (held_out(kuka).rms_mm or np.inf) <= 0.21
    # Negative control: nominal geometry.
    assert (held_out(answer(run["kuka_14"], None)).rms_mm or 0.0) > 0.5


@pytest.mark.long
def test_a_split_of_kuka_14_agrees(kuka: Solution) -> None:
    assert rms(compared(kuka, 1)) <= 1.2


@pytest.mark.long
def test_a_profile_counts_measurements_by_their_effective_number(kuka: Solution) -> None:
    """Its ends are those by the curvature, to a tenth: of so many measurements the fit is nearly linear."""
    assert kuka.problem.weights.max() < 0.7
    which = np.array([i for i in kuka.known if kuka.parameters[i].group == "offset"], dtype=int)
    ends = profile_intervals(kuka.problem, kuka.fit, which, kuka.quantiles[which], kuka.effective_dof[which])
    linear = np.radians([kuka.parameters[i].interval95 for i in which])
    assert len(which) >= 5
    np.testing.assert_allclose(np.diff(ends), np.diff(linear), rtol=0.1)


@pytest.mark.long
def test_a_split_of_panda_1_disagrees_with_nominal_geometry(run: Runs) -> None:
    problem = Problem.from_run(stated(run["panda_1"], None))
    nominal = judge(fit_likelihood(problem, starts=0))
    assert rms(compared(nominal, 1)) >= 2


@pytest.mark.long
def test_nominal_geometry_is_a_misfit_of_kuka_14_and_left_as_it_is(run: Runs) -> None:
    """The errors of the geometry correlate the residuals: that must not excuse them."""
    nominal = answer(run["kuka_14"], None)
    assert nominal.problem.weights.max() == 1  # a misfit is left as it is
    assert nominal.verdict == "misfit"


@pytest.mark.long
def test_a_slipped_recording_does_not_speak_for_all(kuka: Solution) -> None:
    found = effective(kuka.fit, kuka.link_columns)
    rho = {row.target: row.rho for row in found.recordings}
    assert min(rho["raised_left_0"] or 0, rho["raised_left_1"] or 0) > 0.5
    assert found.rho is not None
    assert found.rho < 0.35
    # The socket moved by 0.7 mm before measurement 166.
    named = {(row.target, row.last_shot) for row in steps(kuka.fit, kuka.link_columns).rows}
    assert ("raised_left_1", 165) in named


@pytest.mark.long
@pytest.mark.parametrize("chosen", [[], ["nowhere"], ["front", "left_back", "raised_left"]])
def test_halves_that_are_none_are_refused(kuka: Solution, chosen: list[str]) -> None:
    with pytest.raises(BadInput, match="no part of the run"):
        half_against_half(kuka, chosen)


def test_the_variance_of_a_difference_is_that_of_simulated_halves() -> None:
    """The formula against draws: a linear model, two data sets, one prior, wrong by one and the same draw."""
    rng, size = np.random.default_rng(0), 6
    roots = [rng.normal(size=(8, size)) * rng.uniform(0.1, 3, size) for _ in range(2)]
    covariances = [np.linalg.inv(root.T @ root + np.eye(size)) for root in roots]
    true, count = rng.normal(size=(40_000, size)), 40_000
    estimates = [
        (true @ root.T + rng.normal(size=(count, 8))) @ root @ covariance
        for root, covariance in zip(roots, covariances, strict=True)
    ]
    one, other = covariances
    stated_variance = np.diag(one + other - one @ other - other @ one)
    ratio = (estimates[0] - estimates[1]).var(axis=0) / stated_variance
    # Four standard errors of a variance.
    np.testing.assert_allclose(ratio, 1.0, atol=4 * np.sqrt(2 / count))
    # Negative control: independent halves would differ by more.
    assert (np.diag(one + other) / stated_variance > 1.05).any()


def test_splits_are_different_halves() -> None:
    assert splits(["a", "b", "c"], 9)
    assert {len(own) for own in splits(["a", "b", "c"], 9)} == {1}
    even = splits(["a", "b", "c", "d"], 9)
    assert sorted(even) == [("a", "b"), ("a", "c"), ("a", "d")]


# --- all arms ---------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "without", "scale", "bound"),
    [
        # With the prototype's 0.48 for the plate that slipped: 0.485 (0.481 with a spot_mm of 0.2).
        ("panda_2", (), "estimated", 0.495),
        ("panda_2", SLIPPED, "estimated", 0.31),
        ("panda_1", (), "estimated", 0.61),
        ("kuka_14", (), "estimated", 0.21),
    ],
)
def test_placements_that_the_fit_has_not_seen(
    run: Runs,
    name: str,
    without: tuple[str, ...],
    scale: Literal["known", "estimated"],
    bound: float,
) -> None:
    found = held_out(answer(run[name], whole(scale), without=without))
    assert round(found.rms_mm or np.inf, 2) <= bound  # whose digits are those of the prototype
    assert (held_out(answer(run[name], None, without=without)).rms_mm or 0.0) > 1.8 * bound


@pytest.mark.long
def test_from_one_placement_the_others_of_panda_2(run: Runs) -> None:
    """At least as good as the public model of the arm, by the same placement: 0.569 mm."""
    problem = Problem.from_run(stated(run["panda_2"], whole()))
    others = [place.name for place in placements(problem) if place.name != "front_center"]
    assert (hold_out(problem, others).rms_mm or np.inf) <= 0.56
    nominal = problem.from_run(stated(run["panda_2"], None))
    assert (hold_out(nominal, others).rms_mm or 0.0) > 1.0


@pytest.mark.long
def test_halves_of_all_arms_agree(run: Runs) -> None:
    freed, nominal = [], []
    for name, without in (("panda_2", SLIPPED), ("panda_1", ()), ("kuka_14", ())):
        freed.append(compared(answer(run[name], whole(), without=without), SPLITS))
        nominal.append(compared(answer(run[name], None, without=without, once=True), SPLITS))
        assert rms(freed[-1]) <= 1.2, name
    assert rms([half for own in freed for half in own]) <= 1.2
    assert rms([half for own in nominal for half in own]) >= 2


@pytest.mark.long
@pytest.mark.parametrize("name", ["panda_2", "panda_1", "kuka_14", "dinova_1"])
def test_nominal_geometry_is_a_misfit_of_every_arm(run: Runs, name: str) -> None:
    assert answer(run[name], None).verdict == "misfit"


@pytest.mark.long
def test_panda_2_with_its_geometry(run: Runs) -> None:
    found = answer(run["panda_2"], whole())
    # Confounded with link 6 and the tip: 0.3 mm of a6 are 0.07°.
    row = found["delta6"]
    assert row.std is not None
    assert row.std > 0.04
    assert row.tolerance_share is not None
    assert row.tolerance_share > 0.9
    named = {row.target: (row.first_shot, row.last_shot) for row in steps(found.fit).rows}
    first, last = named["high_0"]
    assert abs(first - 318) <= 1
    assert abs(last - 325) <= 1
    # The block with both sockets slipped: a step of its recordings, and no target is said to have moved.
    moved = found.moved_target
    assert moved is None or moved.target in named
