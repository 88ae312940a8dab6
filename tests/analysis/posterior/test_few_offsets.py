"""A run that moves some joints alone: it ends soon, as degenerate, and is not sampled."""

import numpy as np
import pytest
from pose_runs import pose_header, pose_run, postures

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.posterior.posterior import not_worth_sampling
from zerobeam.analysis.solution import solve
from zerobeam.analysis.status import known
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.finding_words import posterior_message

PLANAR = (2, 3, 4)  # parallel axes: all poses are turned about one


def require_degenerate_and_unsampled(run):
    analysis = analyse(run)
    assert analysis.converged
    assert analysis.verdict == "degenerate"
    by_name = {row.name: row.status for row in analysis.offsets}
    assert by_name["delta3"] in ("identified", "weak")
    assert by_name["delta2"] == by_name["delta4"] == by_name["delta5"] == "unidentifiable"
    assert analysis["delta3"].estimate == pytest.approx(0.5, abs=3 * analysis["delta3"].std)
    assert analysis.draws is None
    assert analysis.result.posterior.useless == "little known"
    assert posterior_message(analysis.result.posterior) == (
        "not sampled: the data determine less than half of the offsets"
    )


@pytest.mark.long
def test_most_offsets_unidentifiable_ends_without_draws():
    require_degenerate_and_unsampled(pose_run(postures(12, PLANAR), {"delta3": 0.5}))


@pytest.mark.long
def test_the_same_with_a_geometry_within_tolerances():
    require_degenerate_and_unsampled(
        pose_run(postures(12, PLANAR), {"delta3": 0.5}, own=pose_header(geometry=None))
    )


@pytest.mark.parametrize(
    ("moving", "worth"), [((2, 3, 4, 5), True), ((1, 2, 3, 4, 5, 6), True), ((4, 6), False)]
)
def test_half_of_the_offsets_are_worth_a_posterior(moving, worth):
    solution = solve(Problem.from_run(pose_run(postures(12, moving), {"delta3": 0.5})), starts=0)
    found = [known(row.status) for row in solution.offsets if not row.held]
    assert (2 * sum(found) >= len(found)) == worth
    assert (not_worth_sampling(solution) is None) == worth


def test_what_one_axis_leaves_open_of_a_mount_starts_at_its_guess():
    problem = Problem.from_run(pose_run(postures(12, PLANAR), {"delta3": 0.5}))
    start = problem.started(problem.nominal()[None])[0]
    at = [problem.parameters.index(f"cam.mount.r{axis}") for axis in "xyz"]
    assert np.degrees(np.abs(start[at])).max() < 1.0
    assert problem.rms_mm(problem.linearise(start)[0]) < 10.0


@pytest.mark.parametrize("moving", [PLANAR, (1, 2, 3, 4, 5, 6)])
def test_a_start_without_any_error_is_the_truth_but_for_what_is_open(moving):
    """The start is in closed form: with a perfect arm its residuals are those of the noise alone."""
    own = pose_header()
    own = own.model_copy(update={"noise": own.noise.model_copy(update={"joint_deg": 1e-9})})
    problem = Problem.from_run(pose_run(postures(12, moving), {"cam.mount.rx": 20.0}, own=own))
    start = problem.started(problem.nominal()[None])[0]
    assert problem.rms_mm(problem.linearise(start)[0]) < 1.0
