"""The two moves for emcee: independence from a multivariate t, and differential evolution.

emcee's own accept walkers one by one, and emcee checks and copies each log-density in Python: dearer than the
density. These accept all at once, evaluate the proposals of many steps in one call, and draw from a
generator of their ensemble's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix

_ROWS = 16_384  # of one call of the density


class IndependenceProposal:
    """A multivariate t to propose from: location (f,), lower Cholesky factor (f, f), nu."""

    def __init__(self, location: Matrix, factor: Matrix, nu: float) -> None:
        self.location, self.factor, self.nu = location, factor, nu
        self._inverse = np.linalg.inv(factor)

    def log_density(self, points: Matrix) -> Matrix:
        """(W,) up to a constant."""
        inner = (points - self.location) @ self._inverse.T
        size = len(self.location)
        result: Matrix = -(self.nu + size) / 2 * np.log1p(np.einsum("ij,ij->i", inner, inner) / self.nu)
        return result

    def draw(self, count: int, random: np.random.Generator) -> Matrix:
        normal = random.standard_normal((count, len(self.location)))
        chi2 = random.chisquare(self.nu, size=count)
        result: Matrix = self.location + (normal * np.sqrt(self.nu / chi2)[:, None]) @ self.factor.T
        return result

    def refitted(self, draws: Matrix, fewest: int) -> IndependenceProposal:
        """With the centre and spread of draws (N, f); itself where fewer than `fewest` of them differ."""
        size = len(self.location)
        if len(np.unique(draws[:, 0])) < fewest:
            return self
        try:
            factor = np.asarray(np.linalg.cholesky(np.cov(draws.T).reshape(size, size)), dtype=float)
        except np.linalg.LinAlgError:
            return self
        return IndependenceProposal(draws.mean(axis=0), factor, self.nu)


def degrees_of_freedom(size: int) -> float:
    """nu of the proposal: heavy tails (6) in few dimensions, lighter in many, where the radius of a t
    with few degrees of freedom would scatter far more than the posterior's."""
    return max(6.0, 2.0 * size)


class _Move:
    """What emcee asks of a move is `propose` and nothing else."""

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self.accepted = self.proposed = 0

    def settle(
        self,
        state: Any,
        chosen: NDArray[np.int64],
        points: Matrix,
        log_density: Matrix,
        factors: Matrix | float,
    ) -> Any:
        """Metropolis and Hastings for the walkers `chosen` (indices); returns which of them moved."""
        # From -inf to -inf is NaN, and no move.
        with np.errstate(invalid="ignore"):
            gain = log_density - state.log_prob[chosen] + factors
        moved = -self.random.standard_exponential(len(points)) < gain
        state.coords[chosen[moved]] = points[moved]
        state.log_prob[chosen[moved]] = log_density[moved]
        self.accepted += int(moved.sum())
        self.proposed += len(moved)
        return moved


class IndependenceMove(_Move):
    """Every walker to a draw of the proposal.

    The draws do not depend on where the walkers are: those of `ahead` steps go to the density together.
    """

    def __init__(self, proposal: IndependenceProposal, random: np.random.Generator, ahead: int = 1) -> None:
        super().__init__(random)
        self.proposal = proposal
        self.ahead = ahead
        self._drawn: Iterator[tuple[Matrix, Matrix, Matrix]] = iter(())

    def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
        walkers = len(state.coords)
        drawn = next(self._drawn, None)
        if drawn is None:
            steps = max(1, min(self.ahead, _ROWS // walkers))
            self.ahead -= steps
            points = self.proposal.draw(steps * walkers, self.random)
            many = (points, model.log_prob_fn(points), self.proposal.log_density(points))
            self._drawn = zip(*(np.split(values, steps) for values in many), strict=True)
            drawn = next(self._drawn)
        points, log_density, own = drawn
        factors = self.factors(self.proposal.log_density(state.coords), own)
        return state, self.settle(state, np.arange(walkers), points, log_density, factors)

    def factors(self, here: Matrix, there: Matrix) -> Matrix:
        """(W,) as in emcee's moves, what the proposal itself favours: ln g of the walkers and of what is
        proposed to them."""
        return here - there


class DifferentialMove(_Move):
    """Differential evolution (Ter Braak 2006; Nelson et al. 2013), half of the walkers by pairs of the other.

    emcee's DEMove lists all pairs of walkers at each call; here a walker draws its pair. With `groups` the
    walkers are so many groups of one size, one after the other, and every pair is of the walker's own group.
    """

    def __init__(self, random: np.random.Generator, groups: int = 1) -> None:
        super().__init__(random)
        self.groups = groups

    def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
        walkers, size = state.coords.shape
        accepted = np.zeros(walkers, dtype=bool)
        starts = np.arange(self.groups)[:, None] * (walkers // self.groups)
        halves = np.array_split(self.random.permutation(walkers // self.groups), 2)
        # Now and then a whole difference: from one mode to another.
        scale = 1.0 if self.random.random() < 0.1 else 2.38 / np.sqrt(2 * size)
        for half, other in (halves, halves[::-1]):
            own = (starts + half).reshape(-1)
            first = self.random.integers(len(other), size=len(own))
            second = (first + self.random.integers(1, len(other), size=len(own))) % len(other)
            start = np.repeat(starts[:, 0], len(half))
            stretch = scale * (1 + 1e-5 * self.random.standard_normal((len(own), 1)))
            steps = stretch * (state.coords[start + other[first]] - state.coords[start + other[second]])
            points = state.coords[own] + steps
            accepted[own] = self.settle(state, own, points, model.log_prob_fn(points), 0.0)
        return state, accepted
