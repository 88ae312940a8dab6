"""Where the arm is, by its estimated offsets and geometry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.covariance import frame
from ..analysis.diagnostics.tcp_positions import NO_EFFECT, arm_covariance, tool_point, undetermined_offsets
from ..analysis.solution import Solution
from ..analysis.status import UNVALIDATED
from ..model.errors import BadInput
from ..model.files.arguments import joint_positions
from .arguments import vector

if TYPE_CHECKING:
    import pandas as pd


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
    recorded = joint_positions(np.atleast_2d(joints), "joints", problem.robot, unit) / problem.robot.display
    point = problem.tool.point if point_mm is None else np.array(vector(point_mm, 3, "point_mm"))
    position, jacobian = tool_point(problem, fit.x, point, recorded)
    covariance = arm_covariance(problem, fit.covariance)
    variance = np.einsum("pia,ab,pib->pi", jacobian, covariance, jacobian)
    offsets = problem.parameters.block("offset")
    effect = np.linalg.norm(jacobian[:, :, offsets], axis=1) * problem.parameters.prior_std[offsets]
    unknown = (effect[:, undetermined_offsets(problem, solution.status)] > NO_EFFECT).any(axis=1)
    numbers = np.hstack([position, np.sqrt(variance)])
    numbers[unknown] = np.nan
    return frame(numbers, columns=["x_mm", "y_mm", "z_mm", "u_x_mm", "u_y_mm", "u_z_mm"])
