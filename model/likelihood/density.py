"""The log-posterior: the likelihood with the covariance that moves with the parameters, and the priors.

One density serves a run, many starts on a run, or many runs that share all but the recorded numbers: the
rows of a parameter array x (W, p) are computed side by side, and `of` (W,) names the data set of each row.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ..arrays import Index, Matrix
from ..c_source import GridInput, Offsets, columns, constant, per_both, per_inner, per_outer
from .problem import Problem


class Slopes(NamedTuple):
    """`value` (W,) log-posterior, `gradient` (W, f) and `information` (W, f, f), by the scaled free
    parameters z. The gradient is exact; the information is Fisher's of the residuals (J' S^-1 J), with the
    priors' and the ties' (of no rows where it was not asked for)."""

    value: Matrix
    gradient: Matrix
    information: Matrix


class _Block(NamedTuple):
    """Of one target: its `shots`; `free` (m,) the columns among the free parameters, `local` (m,) among those
    of a shot.

    `pairs` and `lower`: where each pair of the r of the residual is among the f * f of an information, and in
    the lower triangle of that of a shot, row by row; `noise_pairs` and `noise_lower` those of the noise
    factors."""

    shots: Index
    free: slice | Index
    local: slice | Index
    pairs: slice | Index
    lower: Index
    noise_pairs: slice | Index
    noise_lower: Index


class Density:
    """Log-posterior of B data sets: `joints` (B, N, n), `spots` (B, N, d) and `readings` (B, N, w), the
    problem's own by default. `size` f is the number of free parameters.

    `weights` (B, N) multiply what each shot adds (0 leaves it out); the problem's own by default.
    """

    def __init__(
        self,
        problem: Problem,
        joints: Matrix | None = None,
        spots: Matrix | None = None,
        weights: Matrix | None = None,
        readings: Matrix | None = None,
    ) -> None:
        self.problem = problem
        self.joints = problem.joints[None] if joints is None else joints
        self.spots = problem.spots[None] if spots is None else spots
        self.weights = problem.weights[None] if weights is None else weights
        self.readings = problem.readings[None] if readings is None else readings
        self._data = self.spots
        if problem.tool.reading_size:
            read = np.broadcast_to(self.readings, (len(self.spots), *problem.readings.shape))
            self._data = np.concatenate([self.spots, read], axis=2)
        parameters = problem.parameters
        self._free = np.flatnonzero(parameters.free)
        self._free_columns = together(self._free)
        self._mean, self._scale = parameters.prior_mean[self._free], parameters.prior_std[self._free]
        self._scale_squared = np.outer(self._scale, self._scale)
        self.size = len(self._free)
        self._kernel = problem.functions.kernel
        self._kept: dict[int | None, list[GridInput]] = {}  # by target, where they are those of every row
        self._stated: dict[int, GridInput] = {}  # by the number of shots
        self._columns: dict[int | None, tuple[Offsets, Offsets, Offsets]] = {}  # by target

    def weighted(self, weights: Matrix) -> Density:
        """The same data with weights (B, N) times those of the problem."""
        weights = self.problem.weights * weights
        return Density(self.problem, self.joints, self.spots, weights, self.readings)

    # Values

    def log_likelihood(self, x: Matrix, of: Index | None = None) -> Matrix:
        """(W,) log-likelihood of parameter vectors (W, p): -m' S^-1 m / 2 summed over the shots, with the S
        of those parameters, and the log det of `ShotFunctions`.

        With an estimated noise scale the common factor is integrated out (a Student-t in the residuals).
        Values are up to a constant; where a number is not finite the result is -inf.
        """
        # What overflows or is no number is -inf, not by numpy's warnings.
        with np.errstate(all="ignore"):
            quad, logdet = self._shot_sums(x, of)
            value = self._value(quad, logdet, self._tie_quad(x), of)
        return np.where(np.isfinite(value), value, -np.inf)

    def log_prior(self, x: Matrix) -> Matrix:
        """(W,) log of the normal priors of what is not held, up to a constant."""
        with np.errstate(all="ignore"):
            value = -(self.scaled(x) ** 2).sum(axis=1) / 2
        return np.where(np.isnan(value), -np.inf, value)

    def log_posterior(self, x: Matrix, of: Index | None = None) -> Matrix:
        """(W,) of parameter vectors (W, p), up to a constant; never a NaN."""
        return self.log_likelihood(x, of) + self.log_prior(x)

    def scaled(self, x: Matrix) -> Matrix:
        """z (W, f): the free parameters in prior stds from their prior means."""
        return np.asarray((x[:, self._free_columns] - self._mean) / self._scale)

    def quads(self, x: Matrix) -> Matrix:
        """(N,) m' S^-1 m of every shot at one x (p,), unweighted; data set 0."""
        problem = self.problem
        parts = problem.split(x)
        targets = parts.targets[problem.target_index]
        quad, _ = self._kernel("terms")(
            self._turns[0],
            self._data[0],
            np.ones(1),
            parts.arm,
            targets[:, :0] if problem.tool.target_is == "nothing" else targets,
            parts.tool,
            problem.variances(x),
            problem.noise.variances,
        )
        return quad

    def noise_weight(self, x: Matrix, of: Index | None = None) -> Matrix:
        """(W,) 1 for known noise; where the scale is estimated, the mode of 1 / scale^2 at x (W, p)."""
        if not self.problem.noise.estimated:
            return np.ones(len(x))
        quad, _ = self._shot_sums(x, of)
        return self.numbers(of) / quad

    def numbers(self, of: Index | None = None) -> Matrix:
        """(W,) or (1,): how many residuals' components the data sets have, those left out not counted."""
        count = self.weights @ self.problem.sizes
        return np.asarray(count if of is None or len(count) == 1 else count[of])

    # Slopes

    @np.errstate(all="ignore")  # as in log_likelihood
    def slopes(self, x: Matrix, of: Index | None = None, *, with_information: bool = True) -> Slopes:
        """Value, gradient and information at parameter vectors (W, p)."""
        problem, rows, size = self.problem, len(x), self.size
        quad, logdet = np.zeros(rows), np.zeros(rows)
        by_quad, gradient = np.zeros((rows, size)), np.zeros((rows, size))
        flat = np.zeros((rows if with_information else 0, size * size))
        with_log_det = problem.functions.log_det != "none"
        for k, block in enumerate(self._blocks):
            inputs = self._grid(x, of, block.shots, k)
            sums = self._kernel("slopes").sums(inputs, rows, len(block.shots), gram=with_information)
            quad += sums[0]
            by_quad[:, block.free] += sums[2][:, block.local]
            if with_log_det:
                logdet += sums[1]
                gradient[:, block.free] += sums[3][:, block.local]
            if with_information:
                flat[:, block.pairs] += sums[5].take(block.lower, axis=1)
                if problem.noise.separate:
                    flat[:, block.noise_pairs] += sums[4].take(block.noise_lower, axis=1)
        information = flat.reshape(len(flat), size, size)
        if problem.noise.estimated:
            weight = self.numbers(of) / quad
            by_quad *= weight[:, None]
            information *= weight[: len(information), None, None]
        gradient += by_quad
        tied: Matrix | float = 0.0
        if problem.ties:
            tied, by_tie, own_information = self._tie_slopes(x)
            gradient += by_tie[:, self._free]
            if with_information:
                information += own_information[:, self._free[:, None], self._free]
        z = self.scaled(x)
        value = self._value(quad, logdet, tied, of) - (z**2).sum(axis=1) / 2
        information *= self._scale_squared
        flat[:, :: size + 1] += 1.0
        value[~np.isfinite(value)] = -np.inf
        return Slopes(value, gradient * (-self._scale / 2) - z, information)

    def prior_information(self, x: Matrix) -> Matrix:
        """(W, f, f) the part of the information that does not come from the shots."""
        _, _, information = self._tie_slopes(x)
        return information[:, self._free[:, None], self._free] * self._scale_squared + np.eye(self.size)

    # How it is made up

    def _value(self, quad: Matrix, logdet: Matrix, tied: Matrix | float, of: Index | None) -> Matrix:
        if self.problem.noise.estimated:
            quad = self.numbers(of) * np.log(quad)
        return -(quad + logdet + tied) / 2

    def _shot_sums(self, x: Matrix, of: Index | None) -> tuple[Matrix, Matrix]:
        """(W,) sums over the shots of m' S^-1 m and log det S."""
        quad, logdet = self._kernel("terms").sums(self._grid(x, of), len(x), self.problem.shots)
        return quad, logdet

    def _tie_slopes(self, x: Matrix) -> tuple[Matrix, Matrix, Matrix]:
        """Of the sum of squares of the whitened ties: (W,), gradient (W, p), information (W, p, p)."""
        residual, jacobian = self.problem.tie_rows(x)
        gradient = 2 * (residual[:, None, :] @ jacobian)[:, 0]
        return (residual**2).sum(axis=1), gradient, jacobian.transpose(0, 2, 1) @ jacobian

    def _tie_quad(self, x: Matrix) -> Matrix:
        if not self.problem.ties:
            return np.zeros(len(x))
        residual, _ = self.problem.tie_rows(x)
        return np.asarray((residual**2).sum(axis=1))

    def _grid(
        self,
        x: Matrix,
        of: Index | None,
        shots: Index | None = None,
        target: int | None = None,
    ) -> list[GridInput]:
        """The inputs of `terms` and `slopes` at x (W, p): all shots, or `shots` of one target."""
        problem = self.problem
        x = np.ascontiguousarray(x)
        count = problem.shots if shots is None else len(shots)
        kept = of is None or len(self.joints) == len(self.spots) == len(self.weights) == 1
        if kept and target in self._kept:
            recorded = self._kept[target]
        else:
            over = (self._turns, self._data, self.weights[:, :, None])
            recorded = [_over(values, of, shots) for values in over]
            if kept:
                self._kept[target] = recorded
        return [*recorded, *columns(x, *self._places(target, count)), *self._variances(x, count)]

    def inputs(self, x: Matrix, shots: Index, target: int) -> list[GridInput]:
        """Those of `slopes` at x (W, p) for the shots of a target, row w being data set w."""
        return self._grid(x, None, shots, target)

    def _places(self, target: int | None, count: int) -> tuple[Offsets, Offsets, Offsets]:
        """The columns of arm, target and tool in x, for `count` shots: all, or those of one target."""
        if target not in self._columns:
            parameters, problem = self.problem.parameters, self.problem
            if target is None:
                first = parameters.block("target").start
                real = problem.target_index < len(problem.targets) - problem.stations
                targets = np.where(real, first + 3 * problem.target_index, first)
            else:
                targets = np.full(count, parameters.of_shot(target)[parameters.in_shot("target")][:1].sum())
            arm, tool = (np.full(count, block.start) for block in (parameters.arm, parameters.instrument))
            self._columns[target] = (Offsets.of(arm), Offsets.of(targets), Offsets.of(tool))
        return self._columns[target]

    def _variances(self, x: Matrix, count: int) -> list[GridInput]:
        """The variances at x (W, p), and the stated ones, as inputs of a kernel."""
        if count not in self._stated:
            self._stated[count] = constant(self.problem.noise.variances, count)
        as_stated = self._stated[count]
        if not self.problem.noise.separate:
            return [as_stated, as_stated]
        return [per_outer(self.problem.variances(x), count), as_stated]

    @cached_property
    def _turns(self) -> Matrix:
        return self.problem.geometry.recorded(self.problem.robot, self.joints)

    @cached_property
    def _blocks(self) -> list[_Block]:
        """Per target the places of the slopes of its shots among the free parameters."""
        parameters, blocks = self.problem.parameters, []
        for k in range(len(self.problem.targets)):
            shots, columns = np.flatnonzero(self.problem.target_index == k), parameters.of_shot(k)
            local = np.flatnonzero(parameters.free[columns])
            size = len(parameters.of_shot(k, noise=False))
            of_residual, noise = local[local < size], local[local >= size] - size
            free = parameters.among_free[columns[local]]
            pairs, noise_pairs = (
                together((part[:, None] * self.size + part).reshape(-1))
                for part in (free[: len(of_residual)], free[len(of_residual) :])
            )
            places = (together(free), together(local), pairs, _lower(of_residual), noise_pairs, _lower(noise))
            blocks.append(_Block(shots, *places))
        return blocks


def together(places: Index) -> slice | Index:
    """Places as a slice where they follow each other: that is faster."""
    together = len(places) > 0 and bool((np.diff(places) == 1).all())
    return slice(int(places[0]), int(places[-1]) + 1) if together else places


def _lower(places: Index) -> Index:
    """(m * m,) where each pair of `places` (m,) is in a lower triangle, row by row."""
    rows, others = np.maximum.outer(places, places), np.minimum.outer(places, places)
    return np.asarray(rows * (rows + 1) // 2 + others, dtype=np.int64).reshape(-1)


def _over(values: Matrix, of: Index | None, shots: Index | None) -> GridInput:
    """Values (B, N, size) of data sets, some of their shots: the one that there is, or those of `of`."""
    values = values if shots is None or len(shots) == values.shape[1] else values[:, shots]
    if len(values) == 1:
        return per_inner(values[0], values.shape[1])
    return per_both(values, of)


@lru_cache(maxsize=8)
def density_of(problem: Problem) -> Density:
    """The density of the problem's own measurements, made once."""
    return Density(problem)
