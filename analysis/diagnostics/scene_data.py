"""What a picture of a run shows: the arm at every shot, its beams, the targets and how well they are known.

Nothing here shows what the data do not determine: an offset or a tool parameter that they leave open is drawn
at its prior mean, and a target that they leave open has no place.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...model.arrays import Index, Matrix
from ...model.instruments.kind import PartRead
from ...model.likelihood.problem import Problem
from ..solution import Solution

Point = tuple[float, float, float]

MOST_SHOTS = 60


@dataclass(frozen=True)
class SceneShot:
    """One shot, points in mm in the base frame: `links` from the base over all joints and the flange to the
    laser (or to the tip of the probe, or to the first of what is measured there), `beam_to` where its beam
    comes nearest to the target, None for a probe. `ahead` is False where the laser points away from the
    target: `beam_to` is then as far as that is. `sights` are the lines to what other instruments measure.
    `residual_mm` is the residual as a vector: from where the target (or what a station measures) is by the
    fit to where this measurement has it; None where what is measured has no place, as a plane.
    """

    shot: int
    target: str
    links: tuple[Point, ...]
    beam_to: Point | None
    ahead: bool
    sights: tuple[tuple[Point, Point], ...] = ()
    residual_mm: Point | None = None


@dataclass(frozen=True)
class SceneTarget:
    """A target's place, None where the data do not determine it, and the covariance (3 rows of 3) of that:
    None as well where a coordinate is held. A `station` is an instrument in the world."""

    name: str
    at_mm: Point | None
    covariance_mm2: tuple[Point, Point, Point] | None
    station: bool = False


@dataclass(frozen=True)
class SceneOutline:
    """The lines that show a target which is no point: a plane where it was touched, a ball."""

    target: str
    lines: tuple[tuple[Point, ...], ...]


@dataclass(frozen=True)
class RunScene:
    """Shots and targets of a fit that converged; `radius2` is the squared radius, in standard deviations, of
    the ellipsoid that holds a target's place at 95 %; `outlines` of targets that are determined."""

    shots: tuple[SceneShot, ...]
    targets: tuple[SceneTarget, ...]
    radius2: float
    outlines: tuple[SceneOutline, ...] = ()

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates of the targets that have a place."""
        placed = [target.name for target in self.targets if target.at_mm is not None]
        return tuple(f"{name}.{axis}" for name in placed for axis in "xyz")


def scene(solution: Solution) -> RunScene | None:
    """The scene of a fit, None if it did not converge. Of more than 60 shots 60, evenly over the run."""
    if not solution.converged:
        return None
    problem, x = solution.problem, drawn_parameters(solution)
    targets = problem.split(x).targets
    chosen = np.unique(np.linspace(0, problem.shots - 1, MOST_SHOTS).round().astype(np.int64))
    undetermined = _undetermined(solution)
    shots: list[SceneShot] = []
    touched: dict[str, tuple[PartRead, Matrix, list[Matrix]]] = {}
    for i, (shot, read, tips) in zip(chosen, drawn_shots(problem, x, chosen, undetermined), strict=True):
        shots.append(shot)
        reads_target = next(
            (k for k, part in enumerate(read) if part.instrument.target_is != "nothing"), None
        )
        if reads_target is not None and shot.target not in undetermined:
            part = read[reads_target]
            target = targets[problem.target_index[i]]
            touched.setdefault(shot.target, (part, target, []))[2].append(tips[reads_target])
    vectors = _residual_vectors(problem, solution.fit.x, chosen)
    shots = [replace(shot, residual_mm=vector) for shot, vector in zip(shots, vectors, strict=True)]
    outlines = (
        SceneOutline(name, tuple(tuple(map(_point, line)) for line in lines))
        for name, (part, target, tips) in touched.items()
        if (lines := part.instrument.outlines(target, part.reading, np.array(tips)))
    )
    return RunScene(
        shots=tuple(shots),
        targets=tuple(
            _target(solution, coordinates, name)
            for name in problem.targets
            if ((coordinates := problem.parameters.place_of(name)) >= 0).all()
        ),
        radius2=_radius2(solution),
        outlines=tuple(outlines),
    )


def _residual_vectors(problem: Problem, x: Matrix, rows: Index) -> Iterator[Point | None]:
    """Of measurements at x (p,): the shortest displacement, mm in the base frame, of what they measure that
    leaves no residual of length."""
    residual, jacobian = problem.linearise(x, rows=rows)
    for k, i in enumerate(rows.tolist()):
        name, read = problem.targets[problem.target_index[i]], problem.length_components[i]
        coordinates = problem.parameters.place_of(name)
        if (coordinates < 0).any():
            yield None
            continue
        (columns,) = np.nonzero(np.isin(problem.columns[i], coordinates))
        moved = np.linalg.lstsq(jacobian[k][read][:, columns], -residual[k, read], rcond=1e-6)[0]
        # Where a station moves, what it measures has moved the other way.
        yield _point(-moved if problem.is_station(name) else moved)


def drawn_shots(
    problem: Problem, x: Matrix, rows: Index, undetermined: Collection[str] = ()
) -> Iterator[tuple[SceneShot, list[PartRead], list[Matrix]]]:
    """The shots `rows` (M,) of a problem at x (p,), each with the parts of the instruments that read there
    and where on the flange these are, (3,) mm; without lines to the places that are `undetermined`."""
    parts = problem.split(x)
    (points,) = problem.functions.kernel("skeleton")(problem.joints[rows], parts.arm)
    poses = problem.poses(x, problem.joints[rows])
    for row, i in enumerate(rows.tolist()):
        name = problem.targets[problem.target_index[i]]
        target = parts.targets[problem.target_index[i]]
        links = tuple(_point(joint_position) for joint_position in points[row].T)
        read = list(problem.tool.read_at(problem.readings[i]))
        tips = [
            part.instrument.on_flange(poses[row], parts.tool[part.unknowns], part.variant) for part in read
        ]
        beam_to, ahead = None, True
        for part, tip in zip(read, tips, strict=True):
            if part.instrument.beam:
                direction = part.instrument.direction_at(poses[row], parts.tool[part.unknowns])
                length = float((target - tip) @ direction)
                ahead = length >= 0
                end = tip + (length if ahead else float(np.linalg.norm(target - tip))) * direction
                beam_to = _point(end)
        shot = SceneShot(
            problem.shot_numbers[i],
            name,
            (*links, _point(tips[0])),
            beam_to,
            ahead,
            tuple(_sights(read, poses[row], target, parts.tool, name, undetermined)),
        )
        yield shot, read, tips


def _sights(
    read: Sequence[PartRead],
    pose: Matrix,
    target: Matrix,
    unknowns: Matrix,
    name: str,
    undetermined: Collection[str],
) -> Iterator[tuple[Point, Point]]:
    """Of the parts that read at a posture; none to a place that the data leave open."""
    for part in read:
        instrument = part.instrument
        line = instrument.sight(pose, target, unknowns[part.unknowns], part.reading, part.variant)
        to = instrument.label if instrument.target_is == "nothing" else name
        if line is not None and to not in undetermined:
            yield _point(line[0]), _point(line[1])


def _undetermined(solution: Solution) -> set[str]:
    """Names of the targets and stations of whose coordinates the data leave one open."""
    items = solution.problem.parameters.items
    return {
        item.of
        for item, status in zip(items, solution.status, strict=True)
        if item.group in ("target", "frame") and status == "unidentifiable"
    }


def drawn_parameters(solution: Solution) -> Matrix:
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
    return SceneTarget(name, position, covariance, problem.is_station(name))


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
