"""The fits of many runs: those that differ in what was recorded alone climb side by side."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from ...model.likelihood.problem import Problem
from .fit import LikelihoodFit, fit_alike


def fits_of(problems: Sequence[Problem], *, seed: int = 0) -> list[LikelihoodFit]:
    """`fit_likelihood` of each, bit for bit: it does not depend on what is fitted beside it."""
    groups: dict[Hashable, list[int]] = {}
    for k, problem in enumerate(problems):
        groups.setdefault(_apart_from_readings(problem), []).append(k)
    found: dict[int, LikelihoodFit] = {}
    for group in groups.values():
        fits = fit_alike([problems[k] for k in group], seed=seed)
        found.update(zip(group, fits, strict=True))
    return [found[k] for k in range(len(problems))]


def _apart_from_readings(problem: Problem) -> Hashable:
    """What problems must have in common to differ in what was recorded alone."""
    noise = problem.noise
    arrays = (problem.target_index, problem.weights, problem.guessed, noise.variances)
    return (
        id(problem.functions),  # the same for arms and tools that are the same
        problem.parameters.items,
        problem.targets,
        problem.distances,
        noise.estimated,
        noise.separate,
        *(part.tobytes() for part in arrays),
    )
