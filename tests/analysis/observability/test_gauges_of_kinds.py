"""What each kind of instrument, and mixes of two, determine of random arms: the verdict in double precision
against ranks in fifty digits, by a model of each kind that shares nothing with the package."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from exact_judge import faint_at, gauges_of, null_space, unresolved, values_near_by
from exact_kinds import INSTRUMENTS, MIXES, KindsCell, KindsJudge, Mix, at_point, random_mix
from hypothesis import Phase, assume, example, given, settings

from zerobeam.analysis.observability.aim import aim
from zerobeam.analysis.observability.identifiability import Identified, identify
from zerobeam.model.likelihood.problem import Problem

verdict = identify
TURNING = Mix(7, 4, ("pose",), shots=4, freed=True)  # the mount turns as joint 4 does
SETTINGS: dict[str, Any] = {"deadline": None, "derandomize": True, "database": None}
SETTINGS["phases"] = [Phase.explicit, Phase.generate]


def compare(mix: Mix) -> bool:
    """Assert that the package says what the judge says; False where there is no such cell."""
    cell = random_mix(mix)
    if cell is None:
        return False
    problem = cell.problem
    points = [at_point(cell, seed) for seed in (None, 1, 2)]
    if any(point is None for point in points):
        return False
    answers = [gauges_of(point, problem) for point in points]
    # What is a gauge at both bounds of every point is one; what is at some bound and point may be called one.
    sure = np.all([part for answer in answers for _, part in answer.values()], axis=0)
    may_be = np.any([part for answer in answers for _, part in answer.values()], axis=0)
    dimensions = [dimension for answer in answers for dimension, _ in answer.values()]
    judged = verdict(problem, cell.x)
    free = problem.parameters.free
    names, status = np.array(problem.parameters.names)[free], np.array(judged.status)[free]
    unbounded = np.isinf(judged.data_std[free])
    # The rule above all: no gauge has a finite std.
    assert set(names[sure]) <= set(names[unbounded]), (mix, set(names[sure]) - set(names[unbounded]))
    assert (status[sure] == "unidentifiable").all(), mix
    assert judged.facts.rank <= free.sum() - min(dimensions), mix
    exact = sum(direction.kind == "exact" for direction in judged.facts.null_space)
    assert exact >= min(dimensions), (mix, exact, dimensions)
    beyond = unbounded & ~may_be
    if beyond.any() or exact > max(dimensions):
        most, faint = faintly(cell, points)
        assert exact <= max(*dimensions, most), (mix, exact, dimensions, most)
        assert not (beyond & ~faint).any(), (mix, names[beyond & ~faint])
    return True


def faintly(cell: KindsCell, points: list[Any]) -> tuple[int, np.ndarray]:
    """How many directions the data say next to nothing of at some point, and (f,) which parameters have a
    part in one, or a tolerance to which the data add next to nothing."""
    problem = cell.problem
    free, tolerated = problem.parameters.free, problem.parameters.tolerated
    plain = free & ~tolerated
    held = dataclasses.replace(problem, parameters=problem.parameters.holding(~plain))
    most, faint = 0, np.zeros(len(free), dtype=bool)
    for point in points:
        columns = point[:, plain]
        size = unresolved(held, columns)
        most = max(most, size)
        faint[plain] |= np.array(null_space(columns, columns.shape[1] - size)[1])
    for seed in (None, 1, 2):
        x = cell.x + values_near_by(problem, seed) - problem.nominal()
        faint[free] |= faint_at(problem, x)
    return most, faint[free]


@settings(max_examples=1, **SETTINGS)
@given(mix=MIXES.filter(lambda mix: mix.shots < 8 and mix.joints < 5 and not mix.uncertain))
@example(Mix(5, 4, ("tracker",), shots=4))  # axes 1 and 2 are parallel
@example(TURNING)
def test_no_gauge_of_any_kind_is_called_known(mix: Mix) -> None:
    assume(compare(mix))


@pytest.mark.long
@settings(max_examples=60, **SETTINGS)
@given(mix=MIXES)
@example(Mix(3, 4, ("plane", "ballbar, zero free"), shots=10, uncertain=True))
def test_no_gauge_of_any_kind_is_called_known_at_length(mix: Mix) -> None:
    assume(compare(mix))


@pytest.mark.long
def test_a_gauge_that_is_overlooked_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: each verdict that calls a gauge known, and one that knows nothing."""

    def overlooked(problem: Problem, x: np.ndarray) -> Identified:
        judged = identify(problem, x)
        return dataclasses.replace(judged, data_std=np.where(np.isinf(judged.data_std), 1.0, judged.data_std))

    def too_cautious(problem: Problem, x: np.ndarray) -> Identified:
        judged = identify(problem, x)
        return dataclasses.replace(judged, data_std=judged.data_std + np.inf)

    for wrong in (overlooked, too_cautious):
        monkeypatch.setitem(globals(), "verdict", wrong)
        with pytest.raises(AssertionError):
            compare(TURNING)


@pytest.mark.parametrize(
    "kind", ["tracker", "pose", "plane", "sphere", "ballbar, zero free", "dial", "laser, free", "probe"]
)
@pytest.mark.at_length(r"^(?!pose$)")
def test_the_judge_and_the_package_have_the_same_model_of_each_kind(kind: str) -> None:
    """Products of the columns of both Jacobians: the judge may turn its rows, and has a rotation of nine
    numbers, and a square in place of a distance to a ball."""
    cell = random_mix(Mix(8, 4, (kind,), shots=3, uncertain=True))
    assert cell is not None
    problem = cell.problem
    x = cell.x + values_near_by(problem, 3) - problem.nominal()
    near = aim(problem, x, cell.moving)
    assert near.hit.all()
    judged = KindsJudge(cell).jacobian(x, near.problem.joints)
    assert judged is not None
    _, jacobians = near.problem.linearise(x)
    rows = np.zeros((problem.shots, jacobians.shape[1], len(problem.parameters)))
    np.put_along_axis(rows, problem.columns[:, None, :].repeat(rows.shape[1], axis=1), jacobians, axis=2)
    metres = np.array([1.0 if item.unit == "deg" else 0.001 for item in problem.parameters.items])
    per_shot = np.array(judged.tolist(), dtype=float).reshape(problem.shots, -1, len(metres)) * metres
    if INSTRUMENTS[kind]["kind"] == "pose":
        per_shot[:, 3:] /= 1000 * np.sqrt(2)
    elif INSTRUMENTS[kind]["kind"] == "sphere":
        per_shot /= 2 * 0.023
    own, other = (np.einsum("nri,nrj->nij", each, each) for each in (rows, 1000 * per_shot))
    np.testing.assert_allclose(own, other, rtol=2e-6, atol=2e-6 * np.abs(own).max())
