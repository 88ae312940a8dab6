"""What a picture of a run shows: the arm at every shot, its beams, the targets and how well they are known.

Nothing here shows what the data do not determine: an offset or a tool parameter that they leave open is drawn
at its prior mean, and a target that they leave open has no place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...model.arrays import Index, Matrix
from ..solution import Solution

Point = tuple[float, float, float]

MOST_SHOTS = 60


@dataclass(frozen=True)
class SceneShot:
    """One shot, points in mm in the base frame: `links` from the base over all joints and the flange to the
    laser (or to the tip of the probe), `beam_to` where its beam comes nearest to the target, None for a
    probe. `ahead` is False where the laser points away from the target: `beam_to` is then as far as that is.
    """

    shot: int
    target: str
    links: tuple[Point, ...]
    beam_to: Point | None
    ahead: bool


@dataclass(frozen=True)
class SceneTarget:
    """A target's place, None where the data do not determine it, and the covariance (3 rows of 3) of that:
    None as well where a coordinate is held."""

    name: str
    at_mm: Point | None
    covariance_mm2: tuple[Point, Point, Point] | None


@dataclass(frozen=True)
class RunScene:
    """Shots and targets of a fit that converged; `radius2` is the squared radius, in standard deviations, of
    the ellipsoid that holds a target's place at 95 %."""

    shots: tuple[SceneShot, ...]
    targets: tuple[SceneTarget, ...]
    radius2: float

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates of the targets that have a place."""
        placed = [target.name for target in self.targets if target.at_mm is not None]
        return tuple(f"{name}.{axis}" for name in placed for axis in "xyz")


def scene(solution: Solution) -> RunScene | None:
    """The scene of a fit, None if it did not converge. Of more than 60 shots 60, evenly over the run."""
    if not solution.converged:
        return None
    problem, x = solution.problem, _drawn(solution)
    parts = problem.split(x)
    chosen = np.unique(np.linspace(0, problem.shots - 1, MOST_SHOTS).round().astype(np.int64))
    (points,) = problem.functions.kernel("skeleton")(problem.joints[chosen], parts.arm)
    origin, direction = (beam[chosen] for beam in problem.beams(x))
    between = parts.targets[problem.target_index[chosen]] - origin
    length = (between * direction).sum(axis=1)
    end = origin + np.where(length >= 0, length, np.linalg.norm(between, axis=1))[:, None] * direction
    beam = problem.tool.beam
    return RunScene(
        shots=tuple(
            SceneShot(
                shot=problem.shot_numbers[i],
                target=problem.targets[problem.target_index[i]],
                links=(*(_point(joint_position) for joint_position in points[row].T), _point(origin[row])),
                beam_to=_point(end[row]) if beam else None,
                ahead=bool(length[row] >= 0),
            )
            for row, i in enumerate(chosen)
        ),
        targets=tuple(
            _target(solution, coordinates, name)
            for name in problem.targets
            if ((coordinates := problem.parameters.place_of(name)) >= 0).all()
        ),
        radius2=_radius2(solution),
    )


def _drawn(solution: Solution) -> Matrix:
    """(p,) the mode, but for offsets and tool that the data leave open: those are at their prior means, and
    all else where it would be then (the conditional mean of a normal), so that beams still meet targets."""
    fit, parameters = solution.fit, solution.problem.parameters
    open_ = np.array([status == "unidentifiable" for status in solution.status])
    open_ &= parameters.group("offset") | parameters.group("tool")
    rows = parameters.among_free[open_ & parameters.free]
    by = fit.covariance[:, rows] @ np.linalg.solve(fit.covariance[np.ix_(rows, rows)], fit.z[rows])
    x = fit.x.copy()
    x[parameters.free] -= by * parameters.prior_std[parameters.free]
    return x


def _target(solution: Solution, coordinates: Index, name: str) -> SceneTarget:
    """A point, or the origin of a free frame; planes and known frames are not drawn."""
    problem, fit = solution.problem, solution.fit
    position = covariance = None
    status = {solution.status[i] for i in coordinates.tolist()}
    if "unidentifiable" not in status:
        position = _point(fit.x[coordinates])
        if "held" not in status:
            rows = problem.parameters.among_free[coordinates]
            std = problem.parameters.prior_std[coordinates]
            matrix = fit.covariance[np.ix_(rows, rows)] * np.outer(std, std)
            covariance = (_point(matrix[0]), _point(matrix[1]), _point(matrix[2]))
    return SceneTarget(name, position, covariance)


def _radius2(solution: Solution) -> float:
    """Chi-squared's quantile for three coordinates together, 7.815; Hotelling's 3 F(3, dof) where the noise
    scale is estimated from the residuals (Anderson, Multivariate Statistical Analysis, 2003, section 5.2)."""
    dof = solution.dof
    if solution.problem.noise.estimated and dof:
        return float(3 * scipy.special.fdtri(3, dof, 0.95))
    return float(scipy.special.chdtri(3, 0.05))


def _point(values: Matrix) -> Point:
    x, y, z = (float(value) for value in values)
    return x, y, z
