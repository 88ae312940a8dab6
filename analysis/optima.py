"""Several local optima that explain the data about as well: what differs between them is not determined.

The curvature at one optimum knows nothing of another: its standard uncertainty would be that of one of
several answers, and the true values may be at any of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from .estimation.fit import LikelihoodFit, Optimum
from .observability.causes import AtOptima, LocalOptima, NullDirection
from .observability.identifiability import Identified
from .status import Status, known

# If the other optimum is the true one, noise makes the best one a thousand times as probable with a chance of
# one in a thousand at most (the mean of a likelihood ratio is 1): the level of every test of a fit.
EQUALLY_GOOD = float(np.log(1000.0))


def undecided(fit: LikelihoodFit, identified: Identified, quantile: float) -> Identified:
    """The same with `unidentifiable` for every parameter of which another optimum, about as good as the best,
    says something else: the best one's 95 % interval does not hold for it.

    `quantile` is the half width of such an interval in stds. Every such optimum is a null direction, of the
    kind `optima`: the way to it, of these parameters.
    """
    parameters = fit.problem.parameters
    status, data_std = list(identified.status), identified.data_std.copy()
    settled = np.array([known(identified.status[i]) for i in np.flatnonzero(parameters.free)])
    directions = []
    rivals = [other for other in fit.others if other.below < EQUALLY_GOOD]
    for other in rivals:
        elsewhere = settled & _leaves_out(fit, other, quantile)
        if elsewhere.any():
            directions.append(_direction(fit, other, elsewhere, 1 + len(rivals)))
        for i in np.flatnonzero(parameters.free)[elsewhere]:
            status[i], data_std[i] = "unidentifiable", np.inf
    if not directions:
        return identified
    facts = replace(identified.facts, null_space=(*identified.facts.null_space, *directions))
    decided: tuple[Status, ...] = tuple(status)
    return replace(identified, status=decided, data_std=data_std, facts=facts)


def undecided_names(null_space: Sequence[NullDirection]) -> tuple[str, ...]:
    """The parameters that have no number because of other optima."""
    taking_part = (direction.combination for direction in null_space if direction.kind == "optima")
    return tuple(dict.fromkeys(name for combination in taking_part for name in combination))


def _leaves_out(fit: LikelihoodFit, other: Optimum, quantile: float) -> NDArray[np.bool_]:
    """(f,) whether the best optimum's interval holds too little of the other's normal: less than if both had
    the same std and were one std apart."""
    half = quantile * fit.std
    within = scipy.special.ndtr((fit.z + half - other.z) / other.std) - scipy.special.ndtr(
        (fit.z - half - other.z) / other.std
    )
    return np.asarray(within < scipy.special.ndtr(quantile - 1.0) - scipy.special.ndtr(-quantile - 1.0))


def _direction(fit: LikelihoodFit, other: Optimum, elsewhere: NDArray[np.bool_], count: int) -> NullDirection:
    """The way from the best optimum to the other, of the parameters that are `elsewhere` (f,) there."""
    parameters = fit.problem.parameters
    way = np.where(elsewhere, other.z - fit.z, 0.0)
    order = [int(row) for row in np.argsort(-np.abs(way)) if elsewhere[row]]
    places, weights = np.flatnonzero(parameters.free), way / way[order[0]]
    values = []
    for row in order:
        item = parameters.items[places[row]]
        here, there = (item.prior_mean + item.prior_std * float(z[row]) for z in (fit.z, other.z))
        std = item.shown_std(here, item.prior_std * float(min(fit.std[row], other.std[row])))
        values.append(AtOptima(item.name, item.unit, (item.shown(here), item.shown(there)), std))
    combination = {values[k].name: float(weights[row]) for k, row in enumerate(order)}
    return NullDirection(
        combination, "optima", LocalOptima(count, tuple(values)), float(np.linalg.norm(way[order]))
    )
