"""Why data cannot tell a combination of parameters: each mechanism is tested, not guessed.

A mechanism is a set of parameters that can move together without moving the misses. It explains
a null direction if a direction within that set alone is null (or as nearly null) too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...model.parameters import BASE_FRAME, TOOL_TURN
from ...model.problem import Problem

_CONSTANT = 1e-9  # degrees or mm
_NEARLY_CONSTANT_DEG = 10.0
_NEARLY_CONSTANT_MM = 50.0
_PARALLEL = 1e-9  # of the cosine


@dataclass(frozen=True, eq=False)
class Mechanism:
    """`support` (p,) marks the parameters that move together."""

    support: NDArray[np.bool_]
    reason: str
    remedy: str


NO_MECHANISM = Mechanism(
    np.zeros(0, dtype=bool),
    "no known mechanism",
    "add shots from postures that differ in every joint, then check again",
)


def mechanisms(problem: Problem) -> Iterator[Mechanism]:
    """The known mechanisms for these shots, the most special first."""
    n, parameters, free = problem.robot.n, problem.parameters, problem.parameters.free
    targets, tool = parameters.group("target"), parameters.group("tool")

    def offset(i: int) -> NDArray[np.bool_]:
        return np.equal(np.arange(len(parameters)), i)

    for which, name in enumerate(problem.targets):
        only = np.zeros(len(parameters), dtype=bool)
        only[parameters.block("target", which)] = True
        yield Mechanism(
            only,
            f"the target {name} is seen by one shot only"
            if int((problem.target_index == which).sum()) == 1
            else f"the target {name} is seen from too few sides to tell where it is",
            f"add shots at {name} from other directions",
        )
    # Without its own offset among the unknowns a mechanism would explain what others do.
    if free[0]:
        yield Mechanism(
            offset(0) | targets,
            BASE_FRAME,
            "hold delta1 (the default): it is a choice of base frame and takes nothing from the accuracy",
        )
    if problem.noise.separate:
        yield Mechanism(
            parameters.group("noise"),
            "the scatter of these misses does not tell the noise of the joints from that of the spot",
            "state one of the two, or add shots with shorter and longer beams",
        )
    what = "beam" if problem.tool.kind == "laser" else "probe tip"
    yield Mechanism(
        offset(n - 1),
        f"the {what} lies on or near the axis of joint {n}: turning that joint hardly moves it",
        f"mount the tool so that the {what} stands off the axis of joint {n}, or hold delta{n}",
    )
    if tool.any() and free[n - 1]:
        yield Mechanism(
            offset(n - 1) | tool,
            TOOL_TURN
            if problem.tool.kind == "laser"
            else f"joint {n} and a free probe tip turn together: only their sum moves the tip",
            f"hold delta{n}, or calibrate the tool on its own and state it as calibrated",
        )
    spread = np.ptp(problem.joints, axis=0) * problem.robot.display
    for k in range(1, n):
        if free[k]:
            yield Mechanism(offset(k) | targets, *_common_turn(problem, spread, k))
    # Of too few shots almost any pair of axes looks inseparable: that is no property of the axes.
    enough = too_few_shots(problem, int(free.sum())) is None
    parallel = _parallel_axes(problem)
    for i, j in combinations(np.flatnonzero(free[:n]), 2):
        if enough and parallel[i, j]:
            yield Mechanism(
                offset(int(i)) | offset(int(j)) | targets,
                f"the axes of joints {i + 1} and {j + 1} stay parallel,"
                " and the shots do not tell their offsets apart",
                f"add shots that differ in the joints up to {j + 1}: vary joint {j} by 30 degrees or more",
            )
    if tool.any():
        yield Mechanism(
            tool | targets,
            "the shots turn the tool too little to tell it from the target",
            "add shots in which the wrist stands at very different angles",
        )


def _common_turn(problem: Problem, spread: NDArray[np.float64], k: int) -> tuple[str, str]:
    """Reason and remedy of the turn of everything after joint k (1 … k do not change, or hardly).

    `spread` (n,) is the range of each joint over the shots, degrees or mm.
    """
    joints, varies = ("joint 1", "varies") if k == 1 else (f"joints 1 to {k}", "vary")
    revolute = np.array([joint.kind == "revolute" for joint in problem.robot.joints])
    turn = "turn" if revolute[k] else "shift"
    everything = f"delta{k + 1} is then a {turn} of everything after joint {k}, the target included"
    x_pattern = " (the X-Pattern of section 3.2)" if k == 1 and revolute[0] and revolute[1] else ""
    before = spread[:k]
    amount = "30 degrees or more" if revolute[:k].all() else "a third of the range or more"
    remedy = f"vary {joints} by {amount} between shots"
    if before.max() <= _CONSTANT:
        do = "does" if k == 1 else "do"
        return f"{joints} {do} not change over the shots: {everything}{x_pattern}", remedy
    largest = _ranges_in_words(before, revolute[:k])
    if (before <= np.where(revolute[:k], _NEARLY_CONSTANT_DEG, _NEARLY_CONSTANT_MM)).all():
        return (
            f"{joints} {varies} by no more than {largest} over the shots:"
            f" {everything}, all but the noise{x_pattern}",
            remedy,
        )
    what = f"turn about joint {k + 1}" if revolute[k] else f"shift along joint {k + 1}"
    return (
        f"a {what} moves the target nearly the same way in every shot,"
        f" although {joints} {varies} by up to {largest}",
        f"add shots in which the axis of joint {k + 1} stands at very different places or angles",
    )


def _ranges_in_words(spread: NDArray[np.float64], revolute: NDArray[np.bool_]) -> str:
    """The largest of the ranges, of each unit that occurs."""
    parts = []
    for chosen, unit in ((revolute, "degrees"), (~revolute, "mm")):
        if chosen.any():
            parts.append(f"{float(spread[chosen].max()):.2g} {unit}")
    return " and ".join(parts)


def _parallel_axes(problem: Problem) -> NDArray[np.bool_]:
    """(n, n) True where two joint axes are parallel in every shot."""
    (axes,) = problem.functions.kernel("axes")(problem.joints, np.zeros(problem.robot.n))
    cosine = np.abs(axes.transpose(0, 2, 1) @ axes).min(axis=0)
    return np.asarray(cosine > 1 - _PARALLEL)


def unexplained(problem: Problem, size: int) -> Mechanism:
    """What is said of a direction that no single mechanism explains."""
    few = too_few_shots(problem, size)
    if few is not None:
        return few
    if problem.tool.kind == "probe" and len(problem.targets) == 1:
        return Mechanism(
            NO_MECHANISM.support,
            "all shots meet one place: what leaves that place alone is not told",
            "add shots at a second target, some hundred millimetres away",
        )
    return NO_MECHANISM


def too_few_shots(problem: Problem, size: int) -> Mechanism | None:
    """The mechanism of having fewer numbers than unknowns, or None where there are enough."""
    if problem.data_size >= size:
        return None
    needed = -(-size // problem.tool.miss_size)
    return Mechanism(
        np.ones(len(problem.parameters), dtype=bool),
        f"too few shots: {problem.shots} shots give {problem.data_size} numbers for {size} unknowns",
        f"record at least {needed} shots in varied postures, better twice as many",
    )
