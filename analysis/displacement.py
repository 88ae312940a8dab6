"""Has a target been displaced during the run: did someone bump the PSD between two shots?

For each target and each change point between two of its shots the likelihood-ratio test of two places against
one, at the linearised fit. Residuals count there only as far as no offset, target or tool can explain them,
whatever the priors: the drop of their sum of squares is then exactly chi-squared (or an F ratio, where the
noise scale is estimated; Seber & Lee, Linear Regression Analysis, 2003, section 4.3). What a rival of stated
size can do, such as links within their tolerance, is taken out too, as far as it is that small.
"""

from __future__ import annotations

from dataclasses import field
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy

from ..model.arrays import Index, Matrix
from ..model.records import internal, record, worded
from .estimation.fit import LikelihoodFit
from .recordings.recordings import by_targets

_SIGNIFICANCE = 1e-3  # that a run without a displacement is said to have one; that what is left is not noise
_REACH = 0.01  # what moves the residuals by less (stds, within its prior std) explains none of them
_DETERMINED_MM = 10.0  # a direction that the measurements determine no better is free
_DECIDES = 1e-4  # leverage 1: the fit leaves no more of the measurement's residual than this share
_ROUNDING = 1e-12  # of the information that all shots together have on a place
_EXCLUDES = 20.0  # likelihood ratio by which one explanation excludes another


class ChangePoint(NamedTuple):
    """Between two shots at one target that follow each other there, by their numbers."""

    target: str
    after_shot: int
    before_shot: int


@record
class Displacement:
    """The most likely displacement of a run: of `target`, between two shots.

    `p_value` is that of one as clear anywhere in the run, by Bonferroni's bound over the change points.
    `shift_mm` (base frame) and its `std_mm` have None for an undetermined component; `size_mm` and
    `size_std_mm` are None while one is. `elsewhere` are the change points that explain the residuals nearly
    as well (likelihood ratio within 20), `alone` is the measurement that does so if it alone is off, and
    `better_alone` says that it does so better. `rest_agrees` says that with the displacement the residuals
    agree with the stated noise (True where its scale is estimated). Of a `station` it is the instrument that
    moved relative to the base.
    """

    kind: Literal["moved_target"] = field(default="moved_target", kw_only=True)

    target: str
    after_shot: int
    before_shot: int
    p_value: float
    shift_mm: Annotated[tuple[float | None, ...], internal]
    std_mm: Annotated[tuple[float | None, ...], internal]
    size_mm: float | None
    size_std_mm: float | None
    elsewhere: Annotated[tuple[ChangePoint, ...], internal]
    alone: Annotated[int | None, internal]
    better_alone: Annotated[bool, internal]
    rest_agrees: Annotated[bool, internal]
    station: Annotated[bool, internal] = False
    sentence: Annotated[str | None, worded("in words")] = field(default=None, kw_only=True)

    @property
    def significant(self) -> bool:
        """Beyond noise, not better explained by one measurement that is off, and enough to explain the
        residuals: where the model does not fit, a displacement takes up a part of that too."""
        return self.p_value < _SIGNIFICANCE and not self.better_alone and self.rest_agrees


def displacement(fit: LikelihoodFit, rival: Matrix | None = None) -> Displacement | None:
    """The most likely displacement in the run of `fit`, whether it is significant or not.

    `rival` (M, g) are whitened columns of another explanation of the residuals, times the prior stds of its
    parameters (`link_columns`): it is marginalised.

    None where no change point can be tested: no target has two shots, or the shots are so few that offsets,
    places and tool explain whatever a displacement would do.
    """
    left = _Residuals.of(fit, rival)
    points, gram, slope, floor = _displaced(fit, left)
    if not points:
        return None
    moved = left.explained(gram, slope, floor)
    best = int(np.argmax(moved.score))
    if moved.rank[best] == 0:
        return None
    single = left.explained(left.open_part, left.residual, _DECIDES)
    off = int(np.argmax(single.score))
    near = moved.score[best] - 2 * np.log(_EXCLUDES)
    shift, covariance = left.estimate(moved, best)
    std = np.sqrt(np.diag(covariance))
    determined = std < _DETERMINED_MM
    size = float(np.linalg.norm(shift)) if determined.all() else None
    return Displacement(
        **points[best]._asdict(),
        p_value=min(1.0, left.p_value(moved, best) * int((moved.rank > 0).sum())),
        shift_mm=tuple(float(v) if known else None for v, known in zip(shift, determined, strict=True)),
        std_mm=tuple(float(v) if known else None for v, known in zip(std, determined, strict=True)),
        size_mm=size,
        size_std_mm=float(np.sqrt(shift @ covariance @ shift)) / size if size else None,
        elsewhere=tuple(points[i] for i in np.flatnonzero(moved.score > near) if i != best),
        alone=fit.problem.shot_numbers[off] if single.score[off] > near else None,
        # One shot before or after it is the same as that shot off alone: equal, but for rounding.
        better_alone=bool(single.score[off] > moved.score[best] + 1e-6 * left.chi2),
        rest_agrees=left.agrees(moved, best),
        station=fit.problem.is_station(points[best].target),
    )


class _Explained(NamedTuple):
    """What some explanations (C,) do to the sum of squares: its `drop`, with `rank` degrees of freedom, and
    the `score` of each, twice the log-likelihood's rise less Akaike's price of 2 a degree of freedom.

    `values` (C, a) and `vectors` (C, a, a) of the information on what is assumed, `along` (C, a) the slopes.
    """

    drop: Matrix
    rank: Index
    score: Matrix
    values: Matrix
    vectors: Matrix
    along: Matrix


class _Residuals(NamedTuple):
    """What is left of the residuals once all that offsets, targets and tool can do is taken out.

    `basis` (N, d, r) of what they can do, by shots; `residual` (N, d) what is left, in stds; `active` (N, d)
    1 for each of its components that was read, else 0; `chi2` its sum
    of squares (with that of the stated distances) and `numbers` its degrees of freedom; `known` the scale is.
    """

    basis: Matrix
    residual: Matrix
    active: Matrix
    chi2: float
    numbers: int
    known: bool

    @classmethod
    def of(cls, fit: LikelihoodFit, rival: Matrix | None = None) -> _Residuals:
        problem, whitened = fit.problem, fit.whitened
        shots, d = problem.shots, problem.tool.residual_size
        residual, columns = whitened.residual, whitened.jacobian[:, problem.parameters.free]
        tolerated = problem.parameters.among_free[problem.tolerated]
        if len(tolerated):
            # The geometry has its tolerances, in units of the stated noise as well.
            known = np.eye(columns.shape[1])[tolerated] / np.sqrt(fit.weight)
            columns = np.vstack([columns, known])
            residual = np.append(residual, fit.z[tolerated] / np.sqrt(fit.weight))
        if rival is not None:
            # Least squares with a row for each prior of the rival, in units of the stated noise as well.
            count = rival.shape[1]
            priors = np.hstack([np.zeros((count, columns.shape[1])), np.eye(count) / np.sqrt(fit.weight)])
            beside = np.vstack([rival, np.zeros((len(columns) - len(rival), count))])  # of no tolerance's row
            columns = np.vstack([np.hstack([columns, beside]), priors])
            residual = np.append(residual, np.zeros(count))
        basis, reach, _ = np.linalg.svd(columns, full_matrices=False)
        basis = basis[:, reach > _REACH]
        rest = residual - basis @ (basis.T @ residual)
        return cls(
            basis[: shots * d].reshape(shots, d, -1),
            rest[: shots * d].reshape(shots, d),
            problem.active,
            float(rest @ rest),
            problem.measured_size + len(residual) - len(whitened.residual) - basis.shape[1],
            problem.noise.known,
        )

    def explained(self, gram: Matrix, slope: Matrix, floor: float) -> _Explained:
        """Explanations with the information `gram` (C, a, a) and the slopes (C, a) of the sum of squares;
        directions with less information than `floor` are not determined, and explain nothing."""
        values, vectors = np.linalg.eigh(gram)
        along = (vectors.transpose(0, 2, 1) @ slope[:, :, None])[:, :, 0]
        determined = values > floor
        rank = determined.sum(axis=1)
        if not self.known:
            # No degrees of freedom would be left for the scale.
            rank = np.where(rank < self.numbers, rank, 0)
        drop = (along**2 / np.maximum(values, floor)).sum(axis=1, where=determined & (rank > 0)[:, None])
        drop = np.minimum(drop, self.chi2)
        rise = drop if self.known else -self.numbers * np.log1p(-drop / max(self.chi2, 1e-300))
        score = np.where(rank > 0, rise - 2.0 * rank, -np.inf)
        return _Explained(drop, rank, score, np.maximum(values, _ROUNDING * floor), vectors, along)

    @property
    def open_part(self) -> Matrix:
        """(N, d, d) information on a measurement that alone is off: the residual's share that is left."""
        read = np.eye(self.residual.shape[1]) * self.active[:, :, None]
        return read - self.basis @ self.basis.transpose(0, 2, 1)

    def agrees(self, explained: _Explained, i: int) -> bool:
        """Whether what an explanation leaves of the residuals is no more than the noise (if it is known)."""
        dof = self.numbers - int(explained.rank[i])
        return (
            not self.known
            or dof <= 0
            or bool(scipy.special.chdtrc(dof, self.chi2 - explained.drop[i]) >= _SIGNIFICANCE)
        )

    def p_value(self, explained: _Explained, i: int) -> float:
        """Of the drop of the sum of squares by noise."""
        drop, rank = float(explained.drop[i]), int(explained.rank[i])
        if self.known:
            return float(scipy.special.chdtrc(rank, drop))
        rest = self.numbers - rank
        return float(scipy.special.fdtrc(rank, rest, drop / rank * rest / max(self.chi2 - drop, 1e-300)))

    def estimate(self, explained: _Explained, i: int) -> tuple[Matrix, Matrix]:
        """(a,) the explanation's size and its covariance (a, a), which is huge where it is not determined."""
        values, vectors = explained.values[i], explained.vectors[i]
        scale = 1.0
        if not self.known:
            scale = (self.chi2 - float(explained.drop[i])) / (self.numbers - int(explained.rank[i]))
        return vectors @ (explained.along[i] / values), scale * (vectors / values) @ vectors.T


def _displaced(fit: LikelihoodFit, left: _Residuals) -> tuple[list[ChangePoint], Matrix, Matrix, float]:
    """All change points (C,), the information (C, 3, 3) on displacements there (1 / mm^2), the slopes (C, 3),
    and the information below which a direction is not determined."""
    problem = fit.problem
    by_place = by_targets(problem, fit.whitened)
    by_residual = -(by_place.transpose(0, 2, 1) @ left.residual[:, :, None])[:, :, 0]
    squares = by_place.transpose(0, 2, 1) @ by_place
    shared = left.basis.transpose(0, 2, 1) @ by_place
    order = np.argsort(problem.shot_numbers, kind="stable")
    points: list[ChangePoint] = []
    grams, slopes = [np.empty((0, 3, 3))], [np.empty((0, 3))]
    for k, target in enumerate(problem.targets):
        mine = order[problem.target_index[order] == k]
        # Sums over the shots after each change point.
        square, cross, slope = (
            np.cumsum(part[mine[:0:-1]], axis=0)[::-1] for part in (squares, shared, by_residual)
        )
        grams.append(square - cross.transpose(0, 2, 1) @ cross)
        slopes.append(slope)
        numbers = [problem.shot_numbers[i] for i in mine]
        points += [ChangePoint(target, a, b) for a, b in pairwise(numbers)]
    # What the fit takes out leaves rounding of the size of what was there.
    floor = max(_DETERMINED_MM**-2, _ROUNDING * float(np.trace(squares.sum(axis=0))))
    return points, np.concatenate(grams), np.concatenate(slopes), floor
