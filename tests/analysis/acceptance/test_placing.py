"""A plan of an acceptance test has more numbers of each target than its place takes up."""

import numpy as np
from cells import irb1600
from measured_arms import CELLS, recorded

from zerobeam.analysis.acceptance import _placing
from zerobeam.model.likelihood.problem import Problem


def sockets() -> Problem:
    """A ball bar, ten readings in each of two sockets in turn."""
    cell = CELLS["ballbar"]
    arm = recorded(cell, 20, np.random.default_rng(1), exact=True, joint_deg=0.01)
    return Problem.of_measured(
        cell.header(geometry=None, joint_deg=0.01), irb1600(), arm.joints, arm.measured
    )


def test_lengths_of_a_socket_are_made_up_to_four_or_left_out():
    problem = sockets()
    assert _placing(problem, [0, 2, 4, 6], np.arange(problem.shots)) == [0, 2, 4, 6]
    completed = _placing(problem, [0, 2, 4, 6, 8, 1, 3], np.arange(problem.shots))
    assert completed[:7] == [0, 2, 4, 6, 8, 1, 3]
    assert [row % 2 for row in completed[7:]] == [1, 1]
    few = problem.select(np.array([0, 2, 4, 6, 8, 1, 3]))
    assert _placing(few, [0, 1, 2, 3, 5], np.arange(few.shots)) == [0, 1, 2, 3]
