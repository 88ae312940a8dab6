"""What a plan promises where a reflector is only guessed, against what its rehearsals know."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import good_plan, run_of
from plan_requests import plan_request

from zerobeam.analysis.observability import check as module
from zerobeam.analysis.observability.aim import aim_plan
from zerobeam.analysis.observability.check import check, without_posture
from zerobeam.analysis.observability.predictions import GUESSED, predicted_std
from zerobeam.experiments.plans.make import make_plan
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.experiments.validated_solution import converged_solution
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, read_plan
from zerobeam.words.observability import over_target_sentence

PLAN = Path(__file__).parents[2] / "support" / "tracker_by_guess.yaml"
OFFSETS = ("delta2", "delta3", "delta4", "delta5")


def promised(plan: Plan) -> dict[str, float]:
    rows = {row.name: row.std for row in check(plan).parameters}
    return {name: rows[name] or np.nan for name in OFFSETS}


def at_truths(plan: Plan, seeds: int) -> dict[str, float]:
    """Root mean squares of the u that runs of drawn arms, reflectors and trackers would have."""
    squares = []
    for seed in range(seeds):
        truth = Truth.drawn(plan, np.random.default_rng(seed))
        problem = truth.problem.at_predicted(truth.x)
        std = problem.parameters.unscaled(predicted_std(problem, truth.x))
        items = {item.name: std[i] * item.display for i, item in enumerate(problem.parameters.items)}
        squares.append([items[name] ** 2 for name in OFFSETS])
    return dict(zip(OFFSETS, np.sqrt(np.mean(squares, axis=0)).tolist(), strict=True))


def test_the_promise_is_what_rehearsals_know(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = read_plan(PLAN)
    own, rehearsed = promised(plan), at_truths(plan, 40)
    assert own == pytest.approx(rehearsed, rel=0.25)
    # A control: the guess alone promises a third of it.
    monkeypatch.setattr(module, "mounted_spread", lambda header, problem: np.zeros(len(problem.parameters)))
    guessed = promised(plan)
    assert guessed["delta5"] < rehearsed["delta5"] / 2.5
    assert check(plan).over_target is None


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, *(pytest.param(s, marks=pytest.mark.long) for s in range(2, 10))])
def test_a_rehearsal_has_the_u_that_is_predicted_at_its_truth(seed: int) -> None:
    plan = read_plan(PLAN)
    truth = Truth.drawn(plan, np.random.default_rng(seed))
    shots = simulated_shots(truth, np.random.default_rng(seed + 100))
    solution = converged_solution(run_of(plan.header, shots, plan.robot), "it is a rehearsal")
    problem = truth.problem.at_predicted(truth.x)
    std = problem.parameters.unscaled(predicted_std(problem, truth.x))
    items = {item.name: std[i] * item.display for i, item in enumerate(problem.parameters.items)}
    found = {row.name: row.std for row in solution.offsets if not row.held}
    assert found == pytest.approx({name: items[name] for name in OFFSETS}, rel=0.1)


@pytest.mark.long
def test_it_is_said_and_a_stated_reflector_is_taken_at_its_word() -> None:
    plan = read_plan(PLAN)
    guessed = check(plan)
    over = guessed.over_target
    assert over is not None
    assert over.mounts
    assert over.draws == 64
    assert over.worst_std["delta5"] > promised(plan)["delta5"]
    said = over_target_sentence(guessed)
    assert said is not None
    assert "reflectors, mounts and targets where they may be" in said
    assert said.endswith("The predicted u of the plan are those at a typical place.")
    content = plan.header.model_dump(by_alias=True, exclude_unset=True)
    content["instruments"]["tracker"]["reflectors"]["R1"]["sigma_mm"] = 0.2
    stated = replace(plan, header=Header.model_validate(content))
    known = check(stated)
    assert known.over_target is None
    exact = {row.name: row.std for row in known.parameters}
    assert (exact["delta5"] or np.inf) < promised(plan)["delta5"] / 2.5


def test_the_plan_without_a_posture_is_judged_at_a_typical_place_too() -> None:
    turned = aim_plan(read_plan(PLAN))
    rest = without_posture(turned, 0)
    assert rest is not None
    assert (rest.std["delta5"] or 0.0) > 0.9 * promised(turned.plan)["delta5"]


@pytest.mark.long
def test_a_plan_is_chosen_and_decided_on_for_a_typical_place() -> None:
    """What the planner says of a plan is what its check promises; by the guess alone it was a third."""
    header = read_plan(PLAN).header
    request = plan_request(header=header, target=None, candidates=60, shots=8, tolerance=None)
    made = make_plan(request, None, lambda stage, share: None)
    assert made.proposal is not None
    assert made.checked is not None
    checked = {row.name: row.std for row in made.checked.parameters}
    assert made.proposal.std == pytest.approx({name: checked[name] for name in made.proposal.std}, rel=1e-3)


def test_a_laser_and_its_mount_are_judged_as_stated() -> None:
    """Its tilt and shift are what `tool` states or assumes: nothing is only guessed."""
    assert check(good_plan(7)).over_target is None


@pytest.mark.long
def test_simulations_draw_what_the_promise_is_for() -> None:
    plan = read_plan(PLAN)
    problem = aim_plan(plan).problem
    spread = module.mounted_spread(plan.header, problem)
    assert sorted({*spread.tolist()}) == [0.0, GUESSED["mm"]]
    drawn = np.array([Truth.drawn(plan, np.random.default_rng(seed)).x for seed in range(200)])
    places = drawn[:, spread > 0] - problem.nominal()[spread > 0]
    assert places.std() == pytest.approx(GUESSED["mm"], rel=0.1)
