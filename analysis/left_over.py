"""What a fit leaves of the residuals, and hypotheses that explain a part of it.

At a linearised fit the whitened residuals r have the Jacobian A by the scaled parameters. Of errors e the fit
leaves M e, M = I - R R'. With normal priors R R' = A C A', C = (A'A + I)^-1; without priors R is an
orthonormal basis of what the parameters can do. A hypothesis moves the residuals by B b. By y = B'r and
G = B'M B, b is -G^-1 y with the covariance G^-1; the sum of squares drops by y'G^-1 y, exactly chi-squared if
nothing is there, or an F ratio where the noise scale is estimated (Seber & Lee, Linear Regression Analysis,
2003, section 4.3); and with b normal of standard deviation s the log ratio of marginal likelihoods is

    y' (G + I / s^2)^-1 y / 2 - log det(I + s^2 G) / 2,

since M r0 = r for the residuals r0 at the prior means. Nothing is fitted to know it.

A wrong model that moves the residuals by b leaves M b of it, and moves the parameters by C A'b. What it
leaves and what it moves are independent of each other, as of any linear model with normal errors (`Biases`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated, NamedTuple, Self

import numpy as np
import scipy

from ..model.arrays import Index, Mask, Matrix
from ..model.likelihood.parameters import Parameter
from ..model.likelihood.problem import Problem, Whitened
from ..model.records import record, worded

_REACH = 0.01  # what moves the residuals by less (stds, within its prior std) explains none of them
EXCLUDES = 20.0  # likelihood ratio by which one explanation excludes another
DETERMINED_MM = 10.0  # a direction that the measurements determine no better is free
_ROUNDING = 1e-12


@record(kw_only=True)
class Contradiction:
    """A criterion by which measurements contradict the model."""

    sentence: Annotated[str | None, worded("in words")] = field(default=None, kw_only=True)


class Hypotheses(NamedTuple):
    """H hypotheses of k columns each: `y` (H, k) and G, `gram` (H, k, k)."""

    y: Matrix
    gram: Matrix

    @classmethod
    def stacked(cls, every: Sequence[Hypotheses]) -> Self:
        """Those of several, one after the other."""
        return cls(*(np.concatenate(part) for part in zip(*every, strict=True)))

    def drop(self, size: float) -> Matrix:
        """(H,) of the sum of squares by amounts of the prior std `size`, with that of their prior."""
        whole = np.eye(self.y.shape[1]) + size**2 * self.gram
        return np.asarray(size**2 * (self.y * np.linalg.solve(whole, self.y[..., None])[..., 0]).sum(axis=-1))

    def log_evidence(self, size: float) -> Matrix:
        """(H,) against nothing, with amounts of the prior std `size`."""
        whole = np.eye(self.y.shape[1]) + size**2 * self.gram
        return np.asarray((self.drop(size) - np.linalg.slogdet(whole)[1]) / 2)

    def freed(self, size: float) -> float:
        """The effective number of parameters of the first with that prior std: the trace of the reduction."""
        gram = self.gram[0]
        return float(len(gram) - np.trace(np.linalg.inv(np.eye(len(gram)) + size**2 * gram)))


class Explained(NamedTuple):
    """What H hypotheses do to the sum of squares: its `drop`, with `rank` degrees of freedom, and the `score`
    of each, twice the log-likelihood's rise less Akaike's price of 2 a degree of freedom.

    `values` (H, k) and `vectors` (H, k, k) of the information, `along` (H, k) the slopes.
    """

    drop: Matrix
    rank: Index
    score: Matrix
    values: Matrix
    vectors: Matrix
    along: Matrix


class LeftOver:
    """The `residual` (M,) at a fit of N measurements of d components, and the `root` R (M, f) of what it
    explains.

    Of tests against an unknown scale: `numbers` degrees of freedom of the residuals; `known` the scale is.
    """

    def __init__(
        self,
        residual: Matrix,
        root: Matrix,
        shape: tuple[int, int],
        numbers: float = np.inf,
        *,
        known: bool = True,
    ) -> None:
        self.residual, self.root, self.shape = residual, root, shape
        self.numbers, self.known = numbers, known
        self.chi2 = float(residual @ residual)

    @classmethod
    def without_priors(
        cls, residual: Matrix, columns: Matrix, shape: tuple[int, int], numbers: float, *, known: bool
    ) -> LeftOver:
        """Of what no parameter can explain, whatever its prior: of so many `numbers`, by scaled `columns`."""
        basis = _range_of(columns)
        return LeftOver(
            residual - basis @ (basis.T @ residual), basis, shape, numbers - basis.shape[1], known=known
        )

    @property
    def by_shots(self) -> tuple[Matrix, Matrix]:
        """Residuals (N, d) and roots (N, d, f) of the measurements."""
        shots, d = self.shape
        rows = shots * d
        return self.residual[:rows].reshape(shots, d), self.root[:rows].reshape(shots, d, -1)

    def of(self, columns: Matrix) -> Hypotheses:
        """One hypothesis of columns (M, k)."""
        through = self.root.T @ columns
        gram = columns.T @ columns - through.T @ through
        return Hypotheses((columns.T @ self.residual)[None], gram[None])

    def reached(self, columns: Matrix) -> Hypotheses:
        """One hypothesis of what columns (M, c) by scaled parameters reach beside a fit without priors, by an
        orthonormal basis of it: to the last digit."""
        basis = _range_of(columns - self.root @ (self.root.T @ columns))
        return Hypotheses((basis.T @ self.residual)[None], np.eye(basis.shape[1])[None])

    def each(self, columns: Matrix) -> Hypotheses:
        """A hypothesis of each column (M, H)."""
        gram = (columns**2).sum(axis=0) - ((self.root.T @ columns) ** 2).sum(axis=0)
        return Hypotheses((columns.T @ self.residual)[:, None], gram[:, None, None])

    def alone(self, parts: Matrix) -> Hypotheses:
        """A hypothesis of each measurement, by columns (N, d, k)."""
        residual, roots = self.by_shots
        transposed = parts.transpose(0, 2, 1)
        through = roots.transpose(0, 2, 1) @ parts
        gram = transposed @ parts - through.transpose(0, 2, 1) @ through
        return Hypotheses((transposed @ residual[:, :, None])[:, :, 0], gram)

    def after(self, parts: Matrix, rows: Index, fewest: int = 1) -> Hypotheses:
        """A hypothesis of each place between `rows`, in their order, `fewest` from the ends: columns
        (N, d, k) of all rows after it."""
        residual, roots = (part[rows] for part in self.by_shots)
        parts = parts[rows]
        transposed = parts.transpose(0, 2, 1)
        sums = (
            transposed @ parts,
            roots.transpose(0, 2, 1) @ parts,
            (transposed @ residual[:, :, None])[:, :, 0],
        )
        square, through, slope = (
            np.cumsum(part[::-1], axis=0)[::-1][fewest : len(rows) - fewest + 1] for part in sums
        )
        return Hypotheses(slope, square - through.transpose(0, 2, 1) @ through)

    def explained(self, hypotheses: Hypotheses, floor: float) -> Explained:
        """What hypotheses explain; directions with less information than `floor` are not determined, and
        explain nothing."""
        values, vectors = np.linalg.eigh(hypotheses.gram)
        along = (vectors.transpose(0, 2, 1) @ hypotheses.y[:, :, None])[:, :, 0]
        determined = values > floor
        rank = determined.sum(axis=1)
        if not self.known:
            # No degrees of freedom would be left for the scale.
            rank = np.where(rank < self.numbers, rank, 0)
        drop = (along**2 / np.maximum(values, floor)).sum(axis=1, where=determined & (rank > 0)[:, None])
        rise = drop
        if not self.known:
            drop = np.minimum(drop, self.chi2)
            share = np.minimum(drop / max(self.chi2, 1e-300), 1 - 1e-12)  # 1: nothing but rounding is left
            rise = -self.numbers * np.log1p(-share)
        score = np.where(rank > 0, rise - 2.0 * rank, -np.inf)
        return Explained(drop, rank, score, np.maximum(values, _ROUNDING * floor), vectors, along)

    def rest(self, explained: Explained, i: int) -> tuple[float, int]:
        """What hypothesis i leaves of the sum of squares, and its degrees of freedom."""
        return max(self.chi2 - float(explained.drop[i]), 1e-300), round(self.numbers) - int(explained.rank[i])

    def p_value(self, explained: Explained, i: int) -> float:
        """Of the drop of the sum of squares by noise."""
        drop, rank = float(explained.drop[i]), int(explained.rank[i])
        if self.known:
            return float(scipy.special.chdtrc(rank, drop))
        rest, dof = self.rest(explained, i)
        return float(scipy.special.fdtrc(rank, dof, drop / rank * dof / rest))

    def estimate(self, explained: Explained, i: int) -> tuple[Matrix, Matrix]:
        """(k,) the amount and its covariance (k, k), which is huge where it is not determined."""
        values, vectors = explained.values[i], explained.vectors[i]
        scale = 1.0
        if not self.known:
            rest, dof = self.rest(explained, i)
            scale = rest / dof
        return -vectors @ (explained.along[i] / values), scale * (vectors / values) @ vectors.T


def _range_of(columns: Matrix) -> Matrix:
    """An orthonormal basis of the directions in which columns, by scaled parameters, reach noticeably."""
    basis, reach, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(basis[:, reach > _REACH])


def by_targets(problem: Problem, whitened: Whitened) -> Matrix:
    """(N, d, 3) of the whitened residuals by what moves their target in mm, held or not: its coordinates, the
    distance of a plane, the origin of a free frame; 0 where nothing does."""
    parameters, d = problem.parameters, problem.tool.residual_size
    places = np.array([parameters.place_of(name) for name in problem.targets])[problem.target_index]
    jacobian = whitened.jacobian[: problem.shots * d].reshape(problem.shots, d, -1)
    by_scaled = np.take_along_axis(jacobian, np.repeat(places[:, None, :], d, axis=1), axis=2)
    return np.asarray(np.where(places < 0, 0.0, 1 / parameters.prior_std[places])[:, None, :] * by_scaled)


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values adjusted for being the least of so many (Holm, Scand. J. Statist. 6, 1979)."""
    raised, adjusted = 0.0, [0.0] * len(p_values)
    for k, i in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        raised = max(raised, min(1.0, (len(p_values) - k) * p_values[i]))
        adjusted[i] = raised
    return adjusted


class Linearised(LeftOver):
    """A fit at x (p,): the whitened residuals r (M,) with their Jacobians by the scaled parameters, `free`
    (M, f) = A by those that are estimated, and the `covariance` C (f, f) of these, priors included.

    Of each measurement, whitened: `by_joints` (N, d, n), rad or mm; `by_spot` (N, d, d) and `by_target`
    (N, d, 3), mm; `roots` (N, d, f) by the parameters. `order` (N,) are the measurements as time goes.
    """

    def __init__(
        self, problem: Problem, x: Matrix, rival: Matrix | None = None, *, settled: bool = False
    ) -> None:
        """`rival` (M, g) are whitened columns of what else may explain the residuals, times its prior stds:
        it is fitted as well, by one linear step. So is all, of a point that is not quite the mode, where that
        is asked for (`settled`)."""
        self.problem = problem
        whitened = problem.whiten(x)
        self.jacobian, self.factor = whitened.jacobian, whitened.factor
        self.free, residual = self.jacobian[:, problem.parameters.free], whitened.residual
        if rival is not None:
            self.free = np.hstack([self.free, rival])
        self.gram = self.free.T @ self.free
        # Not by the inverse of gram + I: with hardly any noise the unit prior would be lost in its rounding.
        rows = np.vstack([self.free, np.eye(len(self.gram))])
        inverse = np.linalg.inv(np.linalg.qr(rows, mode="r"))
        self.covariance: Matrix = inverse @ inverse.T
        self.order: Index = problem.order
        self.size = problem.tool.residual_size
        if settled or rival is not None:
            parameters = problem.parameters
            z = np.zeros(len(self.gram))
            scaled = ((x - parameters.prior_mean) / parameters.prior_std)[parameters.free]
            z[: len(scaled)] = scaled
            residual = residual - self.free @ (self.covariance @ (self.free.T @ residual + z))
        super().__init__(residual, self.free @ inverse, (problem.shots, self.size))
        _, shot_jacobians = problem.linearise(x)
        roots = np.sqrt(problem.weights)[:, None, None]
        by_joints = np.linalg.solve(whitened.factor, problem.by_joints(shot_jacobians))
        self.by_joints: Matrix = np.asarray(by_joints * roots, dtype=float)
        by_spot = -np.linalg.inv(whitened.factor) * problem.active[:, None, :]
        self.by_spot: Matrix = np.asarray(by_spot * roots, dtype=float)
        self.by_target = by_targets(problem, whitened)
        self.roots = self.free[: problem.shots * self.size].reshape(problem.shots, self.size, -1)

    def by_parameters(self, which: list[int]) -> Matrix:
        """(M, k) by some parameters, rad or mm."""
        return np.asarray(self.jacobian[:, which] / self.problem.parameters.prior_std[which])

    def rows(self, of_shots: Matrix) -> Matrix:
        """(M, k) whitened columns of all residuals, from those of the measurements (N, d, k)."""
        measured, columns = self.problem.shots * self.size, of_shots.shape[-1]
        result = np.zeros((len(self.residual), columns))
        result[:measured] = of_shots.reshape(measured, columns)
        return result


class Biases(Linearised):
    """Biases b of the whitened residuals at x (p,), by u = A'b (f, k) and the squares b'b (k,).

    Errors of offsets are those of the `counted` parameters (p,) alone: an offset that is no part of a pass
    cannot make it wrong.
    """

    def __init__(self, problem: Problem, x: Matrix, counted: Mask) -> None:
        super().__init__(problem, x)
        parameters = problem.parameters
        at = parameters.among_free[problem.tolerated]
        # |M b|^2 and the squares of what has a tolerance: b'b + u' Q u.
        self.taken = self.covariance @ self.gram @ self.covariance - 2 * self.covariance
        self.taken += self.covariance[:, at] @ self.covariance[at]
        counts = parameters.group("offset") & parameters.free & counted
        self.offsets = np.flatnonzero(counts[parameters.free])
        std = np.sqrt(np.diag(self.covariance)[self.offsets])
        self.into = self.covariance[self.offsets] / std[:, None]
        # (o,) of each offset that counts: its joint, and the standard uncertainties, rad or mm.
        places = np.flatnonzero(counts)
        self.joints: Index = places - parameters.block("offset").start
        self.std = std * parameters.prior_std[places]
        # Degrees, of those that turn.
        self.degrees = np.array(
            [item.display * (item.unit == "deg") for item in (parameters.items[i] for i in places)]
        )

    def squares(self, square: Matrix, u: Matrix) -> Matrix:
        """(k,) the noncentralities of the squares of residuals and tolerances."""
        return np.asarray(np.maximum(square + (u * (self.taken @ u)).sum(axis=0), 0.0))

    def left(self, square: Matrix, u: Matrix) -> Matrix:
        """(k,) the noncentralities b'M b of tests for these very biases."""
        return np.asarray(np.maximum(square - (u * (self.covariance @ u)).sum(axis=0), 0.0))

    def errors(self, u: Matrix) -> Matrix:
        """(o, k) the errors of the offsets by biases, in their u."""
        return np.asarray(self.into @ u)

    def off(self, u: Matrix) -> Matrix:
        """(k,) the largest error of an offset by biases, in its u."""
        return np.asarray(np.abs(self.errors(u)).max(axis=0, initial=0.0))

    def of_shots(self, parts: Matrix) -> tuple[Matrix, Matrix]:
        """The squares (k,) and u (f, k) of biases of the measurements (N, d, k)."""
        return (parts**2).sum(axis=(0, 1)), np.einsum("nda,ndk->ak", self.roots, parts)


def revolute(problem: Problem) -> list[int]:
    """The joints that turn, from 0."""
    return [i for i, joint in enumerate(problem.robot.joints) if joint.kind == "revolute"]


def tool_items(problem: Problem, unit: str) -> list[int]:
    """The places of a calibrated tool's parameters that have a tolerance, of this unit."""

    def counts(item: Parameter) -> bool:
        return item.group == "tool" and item.tolerated and item.unit == unit and not item.held

    return [i for i, item in enumerate(problem.parameters.items) if counts(item)]
