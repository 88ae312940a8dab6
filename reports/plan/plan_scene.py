"""A plan in 3D: the postures as the servo will leave them, targets at their nominal places."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...analysis.estimation.threads import one_blas_thread
from ...analysis.observability.aim import AimedPlan
from ...model.arrays import Matrix
from ...model.files.plan import Plan
from ..scenes.scene import Placed, Posed, Scene3D, floor_of


class Postures(NamedTuple):
    """The postures of a plan as places in the base frame, where the servo can turn them onto their targets.

    `joints` (N, n) rad or mm, as planned where `hit` (N,) is False; `arm` (N, n + 2, 3), `origin` (N, 3) and
    `end` (N, 3) of the beam (the tip of a probe), `targets` (K, 3) mm; `length` (N,) mm along the beam to the
    point nearest to the target, negative where the laser points away from it; `reaches` (N,) whether beam or
    probe comes to the target: a laser shines one way only.
    """

    joints: Matrix
    hit: NDArray[np.bool_]
    arm: Matrix
    origin: Matrix
    end: Matrix
    targets: Matrix
    length: Matrix
    reaches: NDArray[np.bool_]


def postures_of(aimed_plan: AimedPlan) -> Postures:
    """What `check` judges: no offsets, targets at their nominal places. A beam that does not reach its target
    is as long as that is far."""
    problem, x, aimed = aimed_plan.problem, aimed_plan.x, aimed_plan.aimed
    joints = np.where(aimed.hit[:, None], aimed.problem.joints, problem.joints)
    with one_blas_thread():
        parts = problem.split(x)
        (points,) = problem.functions.kernel("skeleton")(joints, parts.arm)
        origin, direction = problem.moved(joints).beams(x)
    between = parts.targets[problem.target_index] - origin
    along = (between * direction).sum(axis=1)
    reaches = aimed.hit & aimed.ahead
    length = np.where(reaches, along, np.linalg.norm(between, axis=1))
    end = origin + length[:, None] * direction
    return Postures(joints, aimed.hit, points.transpose(0, 2, 1), origin, end, parts.targets, along, reaches)


def plan_scene(plan: Plan, seen: Postures) -> Scene3D:
    """The scene of a plan; there is no beam for a probe."""
    laser, count = plan.header.tool.kind == "laser", len(plan.postures)
    return Scene3D(
        [
            Posed(
                name=f"posture {i} (of 0 to {count - 1})",
                arm=seen.arm[i],
                tool=seen.origin[i],
                end=seen.end[i] if laser else None,
                reaches=bool(seen.reaches[i]),
            )
            for i in range(count)
        ],
        [Placed(name, at, "nominal") for name, at in zip(plan.target_names, seen.targets, strict=True)],
        floor_of(plan.robot),
    )
