"""What an analysed run says besides its answer: where the arm is, and a fit without some measurements."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.covariance import frame, noted, parameter_among
from ..analysis.solution import Solution
from ..analysis.status import UNVALIDATED
from ..analysis.tcp_region import NO_EFFECT, arm_covariance, tool_point, undetermined_offsets
from ..model.errors import BadInput
from ..model.files.from_arrays import joint_positions
from ..model.files.joint_values import joint_warnings
from ..model.files.run import REFIT, Run
from ..model.options import require_number
from .checked_arguments import require_mapping, vector, whole_numbers

if TYPE_CHECKING:
    import pandas as pd


class DoubtfulJoints(UserWarning):
    """Joint positions outside the limits, or like those of another unit."""


def predicted_positions(
    solution: Solution,
    joints: ArrayLike,
    unit: Literal["deg", "rad"] | None,
    point_mm: Sequence[float] | None,
) -> pd.DataFrame:
    """A row for each posture: the position of a point of the flange with its standard uncertainties.

    The base frame is that of joint 1's own encoder. A row is nan where the position depends on an offset that
    the data do not determine.
    """
    if not solution.converged or solution.misfit is not None:
        raise BadInput(
            "there is no prediction",
            found="the fit did not converge" if not solution.converged else f"a misfit, {UNVALIDATED}",
            allowed="a fit that describes its measurements",
        )
    problem, fit = solution.problem, solution.fit
    degrees = joint_positions(
        np.atleast_2d(joints), "joints", problem.robot, unit, noun="posture", limits="warn"
    )
    for doubt in joint_warnings(problem.robot, degrees):
        warnings.warn(doubt, DoubtfulJoints, stacklevel=3)
    recorded = degrees / problem.robot.display
    point = problem.tool.point if point_mm is None else np.array(vector(point_mm, 3, "point_mm"))
    position, jacobian = tool_point(problem, fit.x, point, recorded)
    covariance = arm_covariance(problem, fit.covariance)
    variance = np.einsum("pia,ab,pib->pi", jacobian, covariance, jacobian)
    offsets = problem.parameters.block("offset")
    # Of the nominal arm: a point of its last axis is a fraction of a mm off that of an arm that deviates.
    nominal = tool_point(problem, problem.parameters.prior_mean, point, recorded)[1][:, :, offsets]
    effect = np.linalg.norm(nominal, axis=1) * problem.parameters.prior_std[offsets]
    unknown = (effect[:, undetermined_offsets(problem, solution.status)] > NO_EFFECT).any(axis=1)
    numbers = np.hstack([position, np.sqrt(variance)])
    numbers[unknown] = np.nan
    columns = ["x_mm", "y_mm", "z_mm", "u_x_mm", "u_y_mm", "u_z_mm"]
    return noted(frame(numbers, columns=columns), dict.fromkeys(columns, "mm"), solution.status)


_BY_METHOD = ("first link", "free tool")  # held whatever a header states


def refit_run(solution: Solution, run: Run, hold: Mapping[str, float], drop: Iterable[int]) -> Run:
    """The run without the measurements of the numbers `drop`, its header with the parameters `hold` held.

    Raises BadInput for a name or a number that is not there, and for a value that is not nominal.
    """
    require_mapping(hold, "hold", '{"J6": 0}: the nominal value by name')
    drop = whole_numbers(drop, "drop")
    items = solution.problem.parameters.items
    held = [item.name for item in items if item.held and item.held_by not in (None, *_BY_METHOD)]
    names = []
    for name, value in hold.items():
        row = solution[parameter_among(solution.parameters.names, name, "hold")]
        item = items[solution.problem.parameters.index(row.name)]
        nominal = item.shown(item.prior_mean)
        require_number(value, -math.inf, f"hold[{name!r}]")
        if not math.isclose(value, nominal, abs_tol=1e-12):
            raise BadInput(
                f"{row.name} can be held at its nominal value only",
                found=f"{value:g} {row.unit}",
                allowed=f"{nominal:g} {row.unit}",
                remedy="state another position as guess_mm of the target, in a new run"
                if row.group == "target"
                else f"solution.profile({row.name!r}) shows the fit at other values",
                argument="hold",
            )
        names.append(row.name)
    numbers = [shot.shot for shot in run.shots]
    for number in drop:
        if number not in numbers:
            raise BadInput(
                "no measurement has this number",
                found=repr(number),
                allowed=", ".join(map(str, numbers)),
                argument="drop",
            )
    provenance = {**run.header.provenance, "refit of": f"{run.path.name} (SHA-256 {run.sha256})"}
    if names:
        provenance["refit holds"] = ", ".join(names)
    if drop:
        provenance["refit without measurements"] = ", ".join(map(str, sorted(set(drop))))
    changes: dict[str, object] = {"provenance": provenance}
    if names:
        changes["held"] = tuple(dict.fromkeys([*held, *names]))
    kept = [shot for shot in run.shots if shot.shot not in drop]
    name = f"{run.path.stem.removesuffix(REFIT)}{REFIT}{run.path.suffix}"
    made = Run.of_shots(run.header.model_copy(update=changes), run.robot, kept, name)
    return replace(made, path=run.path.with_name(name))  # what the header names is beside the run's file
