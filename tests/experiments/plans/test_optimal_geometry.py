"""Plans for arms of uncertain geometry: what is chosen, its certificate, and what `check` says of it."""

import functools
import io
from pathlib import Path

import numpy as np
import pytest
from cells import LASER, header, irb1600, plan_of
from command_line import WIDTH
from rich.console import Console

from zerobeam.analysis.design.continuous_design import offset_covariance, variance
from zerobeam.analysis.observability.check import Check, check
from zerobeam.experiments.plans.candidates import candidates
from zerobeam.experiments.plans.make import MadePlan
from zerobeam.experiments.plans.optimal import Planner, Proposal
from zerobeam.model.files.header import Header
from zerobeam.reports.output.terminal import print_page
from zerobeam.reports.plan.check_page import proposal_page

TARGET = (950.0, 150.0, 100.0)
GEOMETRY = {"tolerance": {"length_mm": 0.3, "angle_deg": 0.1}, "gravity": False, "harmonics": False}


def stated(free: bool) -> Header:
    return header(LASER, target=TARGET, **({"geometry": GEOMETRY} if free else {}))


@functools.cache
def planner(free: bool, count: int) -> Planner:
    own, place = stated(free), np.array(TARGET)
    return Planner(own, irb1600(), {"psd": place}, [candidates(own, irb1600(), place, count, seed=0)])


@functools.cache
def proposed(shots: int, free: bool, count: int = 1000) -> Proposal:
    return planner(free, count).optimal(shots)


def checked(proposal: Proposal) -> Check:
    return check(plan_of(stated(True), proposal.postures))


def worst(found: Check, *without: str) -> float:
    stds = [
        row.std
        for row in found.parameters
        if row.group == "offset" and not row.held and row.name not in without
    ]
    assert all(std is not None for std in stds)
    return max(std for std in stds if std is not None)


@pytest.mark.long
def test_seven_measurements_are_no_degenerate_plan_although_their_numbers_are_fewer_than_unknowns() -> None:
    """14 numbers for 25 unknowns: the tolerances are knowledge."""
    found = checked(proposed(7, True))
    assert found.verdict == "pass"
    assert worst(found) == pytest.approx(proposed(7, True).worst, rel=0.02)
    # A control: without tolerances to speak of, so few numbers do not do.
    wide = {**GEOMETRY, "tolerance": {"length_mm": 1000.0, "angle_deg": 90.0}}
    own = header(LASER, target=TARGET, geometry=wide)
    assert check(plan_of(own, proposed(7, True).postures)).verdict == "degenerate"


@pytest.mark.parametrize("shots", [7, 12])
@pytest.mark.long
def test_a_plan_for_uncertain_geometry_holds_up_better_under_it(shots: int) -> None:
    # That of J6 is set by the tool's tolerance, whatever the plan.
    deviating, exact = (worst(checked(proposed(shots, free)), "delta6") for free in (True, False))
    assert deviating < 0.8 * exact


def test_the_bound_holds() -> None:
    own = proposed(7, True)
    assert 0 < own.efficiency <= 1
    random = np.random.default_rng(0)
    roots = planner(True, 1000).candidates
    for _ in range(20):
        rows = random.choice(roots.count, 7, replace=False)
        covariance = offset_covariance(roots, roots.information(rows))
        assert variance(covariance, "A") * 25 >= own.bound


def printed(shots: int) -> str:
    proposal = proposed(shots, True)
    made = MadePlan("optimal", None, Path("plan.yaml"), checked(proposal), proposal, None, "1000 are left")
    out = io.StringIO()
    print_page(Console(file=out, width=WIDTH), proposal_page(made))
    return " ".join(out.getvalue().split())


@pytest.mark.long
def test_a_loose_certificate_says_what_limits_it() -> None:
    assert proposed(7, True).efficiency < 0.8
    said = f"The bound divides 7 measurements among {proposed(7, True).support} postures, which whole ones"
    assert said in printed(7)
    assert proposed(20, True).efficiency > 0.8
    assert "The bound divides" not in printed(20)


@pytest.mark.long
def test_twelve_measurements_of_ten_thousand_candidates_know_every_offset_to_a_hundredth_of_a_degree() -> (
    None
):
    """Issue 15: worst u of δ2 … δ6 at most 0.012°, certified."""
    own = proposed(12, True, 10_000)
    assert worst(checked(own), "delta6") <= 0.012
    assert own.efficiency >= 0.75


def typical() -> Planner:
    """Of a typical arm with a tool within its sigma."""
    typical_header, place = header(LASER, target=TARGET, geometry={}), np.array(TARGET)
    return Planner(
        typical_header,
        irb1600(),
        {"psd": place},
        [candidates(typical_header, irb1600(), place, 400, seed=0)],
    )


@pytest.mark.long
def test_the_order_and_the_number_of_measurements_are_for_what_a_run_notices() -> None:
    planner_of_typical = typical()
    few = planner_of_typical.optimal(9, starts=2)
    assert {each.wrong for each in few.lacking} == {"jump", "backlash", "noise"}
    # A tool within its tolerance takes the error up: no plan notices it, and it does no harm.
    assert not next(each for each in few.power if each.wrong == "tool").noticed
    # So does joint 6 with a beam off its direction: it is as good as the mounting, and no part of a pass.
    assert {each.wrong for each in few.unnoticed} == {each.wrong for each in few.hopeless} == {"reading"}
    answer = planner_of_typical.fewest(2 * few.worst, 24)
    assert answer.proposal is not None
    assert answer.proposal.lacking == ()
    assert len(answer.proposal.postures) > 9  # which u alone would do
    assert all(each.noticed for each in answer.proposal.power if each.wrong in {"jump", "backlash", "noise"})


@pytest.mark.long
def test_a_power_that_is_not_reached_is_named() -> None:
    answer = typical().fewest(1.0, 8)
    assert answer.proposal is None
    assert answer.limit is not None
    assert answer.limit.startswith("the power: a run may not detect")
