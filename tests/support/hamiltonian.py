"""Hamiltonian Monte Carlo in plain numpy, many chains at once: a second sampler for tests of a posterior."""

from collections.abc import Callable

import numpy as np

# (W,) log-density and (W, f) gradient at (W, f).
Slopes = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
_ACCEPTED = 0.8


def hamiltonian(
    slopes: Slopes, size: int, *, chains: int, warm: int, steps: int, leaps: int, seed: int
) -> np.ndarray:
    """(steps, chains, size) draws of a density, near its mode at 0 a unit normal but for what is curved.

    Unit mass, half to all of `leaps` leapfrog steps, of a size that is found in the `warm` first steps.
    """
    random = np.random.default_rng(seed)
    at = 0.5 * random.standard_normal((chains, size))
    value, gradient = slopes(at)
    length, draws = 0.1, []
    for k in range(warm + steps):
        speed = random.standard_normal((chains, size))
        energy = value - (speed**2).sum(axis=1) / 2
        step = length * random.uniform(0.8, 1.2, (chains, 1))
        there, by = at, gradient
        with np.errstate(all="ignore"):
            for _ in range(random.integers(leaps // 2, leaps + 1)):
                speed = speed + step / 2 * by
                there = there + step * speed
                value_there, by = slopes(there)
                speed = speed + step / 2 * by
            moved = np.log(random.random(chains)) < value_there - (speed**2).sum(axis=1) / 2 - energy
        at = np.where(moved[:, None], there, at)
        value, gradient = np.where(moved, value_there, value), np.where(moved[:, None], by, gradient)
        if k < warm:
            length *= np.exp(0.15 * (moved.mean() - _ACCEPTED))
        else:
            draws.append(at)
    return np.array(draws)
