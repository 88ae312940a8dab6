"""Fits whose offsets and covariance are made up, for answers that can be worked out by hand."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from cells import header
from numpy.typing import ArrayLike

from zerobeam.analysis.estimation.fit import LikelihoodFit
from zerobeam.analysis.observability.identifiability import Identifiability, Identified
from zerobeam.analysis.solution import Solution
from zerobeam.analysis.status import Status
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.problem import Problem


def by_hand(
    robot: Robot,
    tool: dict[str, Any],
    delta: ArrayLike,
    covariance: ArrayLike,
    status: Mapping[int, Status] | None = None,
) -> Solution:
    """The solution of a fit that ended at `delta` (n,) with that covariance (n, n), internal units. All is
    identified but what `status` has another word for, by index."""
    noise = {"joint_mm": 0.02} if any(joint.kind == "prismatic" for joint in robot.joints) else {}
    held = [
        f"delta{i + 1}" for i, made_header in {0: "held", **(status or {})}.items() if made_header == "held"
    ]
    made_header = header(tool, target=None, noise=noise, held=held)
    joints = robot.lower + np.random.default_rng(0).uniform(0.4, 0.6, (5, robot.n)) * (
        robot.upper - robot.lower
    )
    problem = Problem.build(made_header, robot, joints, ["psd"] * 5)
    parameters, n = problem.parameters, robot.n
    x, of_x = parameters.prior_mean.copy(), np.diag(parameters.prior_std) ** 2
    x[:n], of_x[:n, :n] = delta, covariance
    free = parameters.free
    z = ((x - parameters.prior_mean) / parameters.prior_std)[free]
    scaled = (of_x / np.outer(parameters.prior_std, parameters.prior_std))[np.ix_(free, free)]
    fit = LikelihoodFit(problem, x, z, scaled, 1.0, 0.0, 0.0, 1, True, "by hand")
    message: dict[int, Status] = {0: "held", **(status or {})}
    statuses = tuple(message.get(i, "identified") for i in range(len(parameters)))
    facts = Identifiability(len(z), len(z), None, {}, ())
    return Solution(fit, Identified(statuses, np.zeros(len(parameters)), facts))
