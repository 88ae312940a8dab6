"""The two moves for emcee: independence from a multivariate t, and differential evolution.

emcee's own accept walkers one by one, and emcee checks and copies each log-density in Python: dearer than the
density. These accept all at once, and draw from a generator of their ensemble's own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...model.robot import Matrix


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

    def factors(self, points: Matrix, proposed: Matrix) -> Matrix:
        """(W,) ln g(points) - ln g(proposed), as in emcee's moves: what the proposal itself favours."""
        return self.log_density(points) - self.log_density(proposed)

    def refitted(self, draws: Matrix) -> IndependenceProposal:
        """With the centre and spread of draws (N, f); itself where they are too few to tell."""
        size = len(self.location)
        if len(np.unique(draws[:, 0])) < 10 * size:
            return self
        try:
            factor = np.asarray(np.linalg.cholesky(np.cov(draws.T).reshape(size, size)), dtype=float)
        except np.linalg.LinAlgError:
            return self
        return IndependenceProposal(draws.mean(axis=0), factor, self.nu)


def degrees_of_freedom(size: int) -> float:
    """nu of the proposal: heavy tails (6) in few dimensions, lighter in many, where the radius of a t
    with few degrees of freedom would scatter far more than the posterior's."""
    return max(6.0, float(size))


class _Move:
    """What emcee asks of a move is `propose` and nothing else."""

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self.accepted = self.proposed = 0

    def settle(
        self, model: Any, state: Any, chosen: NDArray[np.int64], points: Matrix, factors: Matrix | float
    ) -> Any:
        """Metropolis and Hastings for the walkers `chosen` (indices); returns which of them moved."""
        log_density = model.log_prob_fn(points)
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
    """Every walker to a draw of the proposal."""

    def __init__(self, proposal: IndependenceProposal, random: np.random.Generator) -> None:
        super().__init__(random)
        self.proposal = proposal

    def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
        points = self.proposal.draw(len(state.coords), self.random)
        factors = self.proposal.factors(state.coords, points)
        return state, self.settle(model, state, np.arange(len(points)), points, factors)


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
            accepted[own] = self.settle(model, state, own, state.coords[own] + steps, 0.0)
        return state, accepted
