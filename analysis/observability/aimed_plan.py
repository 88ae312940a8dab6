"""A plan as its shots will be: the wrist turned onto the targets, as the servo will turn it."""

from __future__ import annotations

from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from ...model.files.plan import Plan
from ...model.problem import Problem
from ...model.robot import Matrix
from .aim import Aimed, aim, servo_joints


@dataclass(frozen=True, eq=False)
class AimedPlan:
    """`problem` has the postures as planned, `x` (p,) is what is supposed before any shot: no offsets,
    targets where they are thought to stand; `aimed` are the postures turned onto them there."""

    plan: Plan
    problem: Problem
    x: Matrix
    aimed: Aimed


def aim_plan(plan: Plan) -> AimedPlan:
    """Turn every posture of a plan onto its target; BadInput where no problem can be made of the plan."""
    with threadpool_limits(limits=1, user_api="blas"):
        problem = Problem.from_plan(plan)
        x = problem.supposed()
        return AimedPlan(plan, problem, x, aim(problem, x, servo_joints(problem)))
