"""Where the arm is, by its estimated offsets and geometry."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.covariance import frame, noted
from ..analysis.solution import Solution
from ..analysis.status import UNVALIDATED
from ..analysis.tcp_positions import NO_EFFECT, arm_covariance, tool_point, undetermined_offsets
from ..model.errors import BadInput
from ..model.files.from_arrays import joint_positions
from ..model.files.limits import joint_warnings
from .checked_arguments import vector

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
    for doubt in joint_warnings(problem.robot, degrees, "posture"):
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
