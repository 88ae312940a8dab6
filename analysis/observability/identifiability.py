"""What the data can tell, and what not: statuses, null directions and why (section 2 of the design).

Everything follows from A, the Jacobian of the whitened misses by the scaled parameters, taken at
shots that hit. There is no pseudo-inverse here: where the data say nothing, the answer is None.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix
from ...model.likelihood.parameters import Parameters
from ...model.likelihood.problem import Problem
from ..status import Status
from .causes import NullDirection
from .gauges import PART, ROUNDING, complement, gauge_of
from .mechanisms import Mechanism, mechanisms, unexplained
from .tolerances import without_own

_AS_KNOWN = 1 - 1e-6  # singular value of a direction of which the data tell no more than a unit prior
_NEW = 1e-4  # a null direction is not yet told if this part of it is outside those found
_AS_NEARLY_NULL = 3.0  # a mechanism explains a direction if it is null to within this factor
_NEGLIGIBLE = 1e-3  # terms of a combination whose effect is below this share are left out
_LARGEST_TERMS = 8  # of a direction without a known mechanism, which may have a little of everything


@dataclass(frozen=True)
class Identifiability:
    """Rank facts of the whitened, prior-scaled Jacobian (section 2 of the design).

    `condition` is None where the matrix is singular; the observability indices are 0 there.
    """

    rank: int
    size: int
    condition: float | None
    observability: dict[str, float | None]
    null_space: tuple[NullDirection, ...]


@dataclass(frozen=True, eq=False)
class Identified:
    """Per parameter (p,): `status`, and `data_std` in internal units (inf for a gauge, nan if held)."""

    status: tuple[Status, ...]
    data_std: Matrix
    facts: Identifiability


def identify(problem: Problem, x: Matrix, weight: float = 1.0) -> Identified:
    """Judge the shots of `problem` at the parameters x (p,).

    Shots that miss are first turned onto their targets by the joints that change over the shots;
    `weight` is 1 / noise scale^2 (shots only).
    """
    parameters, free = problem.parameters, problem.parameters.free
    found = gauge_of(problem, x, weight)
    jacobian, gauge = found.jacobian, found.basis
    keep = complement(gauge)
    _, singular, right = np.linalg.svd(jacobian @ keep, full_matrices=False)
    floor = ROUNDING * max(float(singular.max(initial=0.0)), 1.0)
    singular = np.maximum(singular, floor)
    directions = keep @ right.T
    if len(singular) < directions.shape[1]:
        singular = np.append(singular, np.full(directions.shape[1] - len(singular), floor))
    share = (directions / singular) ** 2
    scaled_std = np.sqrt(share.sum(axis=1))
    scaled_std = np.where(found.part, np.maximum(scaled_std, 1 / floor), scaled_std)
    scaled_std = np.where(found.exact_part, np.inf, scaled_std)

    tolerated = parameters.group("geometry")[free]
    scaled_std[tolerated] = without_own(scaled_std[tolerated], found.spanned)
    status, data_std = _statuses(parameters, scaled_std)
    null_space = [
        *_exact_directions(found.aimed, jacobian, gauge, found.dimension),
        *_noise_directions(found.aimed, jacobian, directions, singular, share, status, found.exact_part),
    ]
    size = int(free.sum())
    spectrum = np.append(singular, np.zeros(gauge.shape[1]))
    facts = Identifiability(
        rank=int((spectrum >= _AS_KNOWN).sum()),
        size=size,
        condition=None if gauge.shape[1] else float(spectrum.max() / spectrum.min()),
        observability=observability(spectrum, problem.shots),
        null_space=tuple(null_space),
    )
    return Identified(status, data_std, facts)


def no_better_than(problem: Problem, identified: Identified, std: Matrix) -> Identified:
    """The same with `weak` for what counts as identified although its std (p,) is beyond the tolerance.

    Where a direction is nearly lost the misses are far from linear, and the std found at the mode can be
    larger than the one that the Jacobian promises.
    """
    status: list[Status] = [
        "weak" if own == "identified" and spread > item.tolerance else own
        for own, item, spread in zip(identified.status, problem.parameters.items, std, strict=True)
    ]
    return replace(identified, status=tuple(status))


def observability(singular: Matrix, shots: int) -> dict[str, float | None]:
    """O1…O5 of the singular values: Borm & Menq 1991, Driels & Pathre 1990, Nahvi et al. 1994,
    Nahvi & Hollerbach 1996, Sun & Hollerbach 2008. All are 0 for a singular matrix."""
    largest, smallest = float(singular.max()), float(singular.min())
    if smallest <= 0:
        return {f"O{i}": 0.0 for i in range(1, 6)}
    return {
        "O1": float(np.exp(np.log(singular).mean()) / np.sqrt(shots)),
        "O2": smallest / largest,
        "O3": smallest,
        "O4": smallest**2 / largest,
        "O5": float(1 / (1 / singular).sum()),
    }


def _statuses(parameters: Parameters, scaled_std: Matrix) -> tuple[tuple[Status, ...], Matrix]:
    """Status and data_std (internal units) of every parameter from those of the free ones (f,)."""
    data_std = parameters.unscaled(scaled_std)
    status: list[Status] = []
    for item, std in zip(parameters.items, data_std, strict=True):
        if item.held:
            status.append("held")
        elif std >= item.prior_std:
            status.append("unidentifiable")
        else:
            status.append("weak" if std > item.tolerance else "identified")
    return tuple(status), data_std


def _exact_directions(
    problem: Problem, jacobian: Matrix, gauge: Matrix, dimension: int
) -> list[NullDirection]:
    """Name the null space direction by direction: known mechanisms first, then what is left."""
    free = problem.parameters.free
    found: list[tuple[Matrix, Mechanism]] = []
    left = gauge  # what of the gauge is orthogonal to the directions found
    for mechanism in mechanisms(problem):
        support = mechanism.support[free]
        if left.shape[1] == 0 or not support.any():
            continue
        # All null directions within the support: two of them may share a part, such as the target's.
        _, singular, right = np.linalg.svd(gauge[~support], full_matrices=True)
        singular = np.append(singular, np.zeros(gauge.shape[1] - len(singular)))
        within = gauge @ right[singular <= PART].T
        fresh, amount, _ = np.linalg.svd(within.T @ left, full_matrices=False)
        for direction in (within @ fresh[:, amount > _NEW]).T:
            found.append((direction, mechanism))
        if found:
            taken = np.array([direction for direction, _ in found]).T
            left = gauge @ complement(np.linalg.qr(gauge.T @ taken)[0])
    rest = unexplained(problem, int(free.sum()))
    found += [(column, rest) for column in left.T]
    return [
        _named(problem, jacobian, direction, "exact" if i < dimension else "noise", mechanism)
        for i, (direction, mechanism) in enumerate(found)
    ]


def _noise_directions(
    problem: Problem,
    jacobian: Matrix,
    directions: Matrix,
    singular: Matrix,
    share: Matrix,
    status: tuple[Status, ...],
    exact_part: NDArray[np.bool_],
) -> list[NullDirection]:
    """Directions that the noise hides: worse than the prior, or the main cause of a poor offset."""
    parameters = problem.parameters
    free_items = [item for item in parameters.items if not item.held]
    free_status = [s for s, item in zip(status, parameters.items, strict=True) if not item.held]
    wanted = {int(k) for k in np.flatnonzero(singular < _AS_KNOWN)}
    for row, (item, state) in enumerate(zip(free_items, free_status, strict=True)):
        if item.group == "offset" and state in ("weak", "unidentifiable") and not exact_part[row]:
            wanted.add(int(np.argmax(share[row])))
    found: list[NullDirection] = []
    explained: list[Matrix] = []
    for k in sorted(wanted, key=lambda k: singular[k]):
        direction, mechanism = directions[:, k], unexplained(problem, len(free_items))
        for candidate in mechanisms(problem):
            support = candidate.support[parameters.free]
            if not support.any():
                continue
            _, values, right = np.linalg.svd(jacobian[:, support], full_matrices=False)
            if len(values) < support.sum() or values[-1] > _AS_NEARLY_NULL * singular[k]:
                continue
            vector = np.zeros(len(support))
            vector[support] = right[-1]
            if any(abs(vector @ known) > 0.9 for known in explained):
                continue
            # It must be this direction, not another that happens to be as weak.
            if abs(vector @ direction) < 0.5:
                continue
            direction, mechanism = vector, candidate
            break
        explained.append(direction)
        found.append(_named(problem, jacobian, direction, "noise", mechanism))
    return found


def _named(
    problem: Problem,
    jacobian: Matrix,
    direction: Matrix,
    kind: Literal["exact", "noise"],
    mechanism: Mechanism,
) -> NullDirection:
    """The direction as a combination of named parameters, the large terms first, the largest +1."""
    names = [item.name for item in problem.parameters.items if not item.held]
    effect = np.abs(direction) * np.linalg.norm(jacobian, axis=0)
    large = (effect >= _NEGLIGIBLE * effect.max()) | (np.abs(direction) >= 0.01 * np.abs(direction).max())
    large &= np.abs(direction) > PART * np.abs(direction).max()
    order = [int(i) for i in np.argsort(-np.abs(direction)) if large[i]]
    if not mechanism.support.any():
        order = order[:_LARGEST_TERMS]
    effect_size = max(float(np.linalg.norm(jacobian @ direction)), ROUNDING)
    data_std = None if kind == "exact" else 1 / effect_size
    weights = direction / direction[order[0]]
    combination = {names[i]: float(weights[i]) for i in order}
    return NullDirection(combination, kind, mechanism.cause, data_std)
