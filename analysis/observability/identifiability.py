"""What the data determine, and what not: statuses, null-space directions and their causes (design, section
2).

Everything follows from A, the Jacobian of the whitened residuals by the scaled parameters, taken at
measurements that hit. There is no pseudo-inverse here: where the data say nothing, the answer is None.

The cause of a direction is tested, not guessed. A mechanism is a set of parameters that can move together
without changing the residuals. It explains a null-space direction if a direction within that set alone is
null (or as nearly null) too."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.likelihood.parameters import Parameter, Parameters
from ...model.likelihood.problem import Problem
from ..status import Status
from .causes import (
    BaseFrame,
    Cause,
    CommonMotion,
    NoiseSplit,
    NullDirection,
    OnAxis,
    OnePosition,
    ParallelAxes,
    TargetUnseen,
    TooFewMeasurements,
    ToolAgainstTarget,
    ToolRotation,
    Unexplained,
)
from .gauges import PART, ROUNDING, complement, gauge_of

_CONSTANT = 1e-9  # degrees or mm
_NEARLY_CONSTANT_DEG = 10.0
_NEARLY_CONSTANT_MM = 50.0
_PARALLEL = 1e-9  # of the cosine
_NO_SUPPORT = np.zeros(0, dtype=bool)
_NO_INFORMATION = 1e-8  # on a geometry parameter, over that of its tolerance
_AS_KNOWN = 1 - 1e-6  # singular value of a direction of which the data say no more than a unit prior
_NEW = 1e-4  # a null direction is not named yet if this part of it is outside those named
_AS_NEARLY_NULL = 3.0  # a mechanism explains a direction if it is null to within this factor
_MOST = 0.5  # of the std of a weak offset is a mechanism's that explains it alone
_NEGLIGIBLE = 1e-3  # terms of a combination whose effect is below this share are left out
_LARGEST_TERMS = 8  # of a direction without a known mechanism, which may have a little of everything


@dataclass(frozen=True, eq=False)
class Mechanism:
    """`support` (p,) marks the parameters that move together."""

    support: Mask
    cause: Cause


def mechanisms(problem: Problem) -> Iterator[Mechanism]:
    """The known mechanisms for these measurements, the most special first."""
    n, parameters, free = problem.robot.n, problem.parameters, problem.parameters.free
    targets, tool = parameters.group("target"), parameters.group("tool")

    def offset(i: int) -> Mask:
        return np.equal(np.arange(len(parameters)), i)

    for which, name in enumerate(problem.targets):
        only = np.zeros(len(parameters), dtype=bool)
        only[parameters.block("target", which)] = True
        yield Mechanism(only, TargetUnseen(name, int((problem.target_index == which).sum())))
    # Without its own offset among the unknowns a mechanism would explain what others do.
    if free[0]:
        yield Mechanism(offset(0) | targets, BaseFrame())
    if problem.noise.separate:
        yield Mechanism(parameters.group("noise"), NoiseSplit())
    yield Mechanism(offset(n - 1), OnAxis(problem.tool.kind, n))
    if tool.any() and free[n - 1]:
        yield Mechanism(offset(n - 1) | tool, ToolRotation(problem.tool.kind, n))
    spread = np.ptp(problem.joints, axis=0) * problem.robot.display
    for k in range(1, n):
        if free[k]:
            yield Mechanism(offset(k) | targets, _common_motion(problem, spread, k))
    # Of too few measurements almost any pair of axes looks inseparable: that is no property of the axes.
    enough = too_few_measurements(problem, int(free.sum())) is None
    parallel = _parallel_axes(problem)
    for i, j in combinations(np.flatnonzero(free[:n]), 2):
        if enough and parallel[i, j]:
            yield Mechanism(offset(int(i)) | offset(int(j)) | targets, ParallelAxes(int(i) + 1, int(j) + 1))
    if tool.any():
        yield Mechanism(tool | targets, ToolAgainstTarget())


def _common_motion(problem: Problem, spread: Matrix, k: int) -> CommonMotion:
    """The motion of everything after joint k (1 … k do not change, or hardly).

    `spread` (n,) is the range of each joint over the measurements, degrees or mm.
    """
    revolute = np.array([joint.kind == "revolute" for joint in problem.robot.joints])
    before, turning = spread[:k], revolute[:k]

    def largest(chosen: Mask) -> float | None:
        return float(before[chosen].max()) if chosen.any() else None

    return CommonMotion(
        joint=k + 1,
        revolute=tuple(bool(each) for each in revolute[: k + 1]),
        range_deg=largest(turning),
        range_mm=largest(~turning),
        constant=bool(before.max() <= _CONSTANT),
        nearly_constant=bool((before <= np.where(turning, _NEARLY_CONSTANT_DEG, _NEARLY_CONSTANT_MM)).all()),
    )


def _parallel_axes(problem: Problem) -> Mask:
    """(n, n) True where two joint axes are parallel in every shot."""
    (axes,) = problem.functions.kernel("axes")(
        problem.joints, problem.split(problem.parameters.prior_mean).arm
    )
    axes = axes.reshape(-1, 3, problem.robot.n)  # the kernel gives one column without its axis
    cosine = np.abs(axes.transpose(0, 2, 1) @ axes).min(axis=0)
    return np.asarray(cosine > 1 - _PARALLEL)


def unexplained(problem: Problem, size: int) -> Mechanism:
    """What explains a direction that no single mechanism explains."""
    few = too_few_measurements(problem, size)
    if few is not None:
        return few
    one_position = problem.tool.kind == "probe" and len(problem.targets) == 1
    return Mechanism(_NO_SUPPORT, OnePosition() if one_position else Unexplained())


def too_few_measurements(problem: Problem, size: int) -> Mechanism | None:
    """The mechanism of having fewer numbers than unknowns, or None where there are enough."""
    if problem.data_size >= size:
        return None
    unknowns = size - len(problem.tolerated)  # what has a tolerance needs no measurement
    needed = -(-unknowns // problem.tool.residual_size)
    return Mechanism(
        np.ones(len(problem.parameters), dtype=bool),
        TooFewMeasurements(problem.shots, problem.measured_size, unknowns, needed),
    )


@dataclass(frozen=True)
class Identifiability:
    """Rank facts of the whitened, prior-scaled Jacobian (section 2 of the design).

    `rank` counts the unknowns that are determined, those with a tolerance among them. `condition` is None
    where the matrix is singular; the observability indices are 0 there.
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

    Measurements that do not hit are first turned onto their targets by the joints that vary;
    `weight` is 1 / noise scale^2, of measurements only.
    """
    parameters, free = problem.parameters, problem.parameters.free
    gauge_found = gauge_of(problem, x, weight)
    jacobian, gauge = gauge_found.jacobian, gauge_found.basis
    keep = complement(gauge)
    _, singular, right = np.linalg.svd(jacobian @ keep, full_matrices=False)
    floor = ROUNDING * max(float(singular.max(initial=0.0)), 1.0)
    singular = np.maximum(singular, floor)
    directions = keep @ right.T
    if len(singular) < directions.shape[1]:
        singular = np.append(singular, np.full(directions.shape[1] - len(singular), floor))
    share = (directions / singular) ** 2
    scaled_std = np.sqrt(share.sum(axis=1))
    scaled_std = np.where(gauge_found.part, np.maximum(scaled_std, 1 / floor), scaled_std)
    scaled_std = np.where(gauge_found.exact_part, np.inf, scaled_std)

    tolerated = parameters.tolerated[free]
    scaled_std[tolerated] = _without_own_tolerance(scaled_std[tolerated], gauge_found.spanned)
    status, data_std = _statuses(parameters, scaled_std)
    null_space = [
        *_exact_directions(gauge_found.aimed, jacobian, gauge, gauge_found.dimension),
        *_noise_directions(
            gauge_found.aimed, jacobian, directions, singular, share, status, gauge_found.exact_part
        ),
    ]
    size = int(free.sum())
    spectrum = np.append(singular, np.zeros(gauge.shape[1]))
    facts = Identifiability(
        rank=_rank(jacobian, tolerated),
        size=size,
        condition=None if gauge.shape[1] else float(spectrum.max() / spectrum.min()),
        observability=observability(spectrum, problem.shots),
        null_space=tuple(null_space),
    )
    return Identified(status, data_std, facts)


def _rank(jacobian: Matrix, tolerated: Mask) -> int:
    """How many unknowns of A (M, f) are determined: those with a tolerance, which is knowledge by itself, and
    the directions of the others of which the measurements say more than a unit prior, the tolerances
    marginalised. (The singular values of A mix both: a tolerance that makes up for a little of an offset
    has one just below 1.)
    """
    known, rest = jacobian[:, tolerated], jacobian[:, ~tolerated]
    if known.shape[1]:
        basis = np.linalg.qr(known)[0]
        rest = rest - basis @ (basis.T @ rest)
    return int(known.shape[1] + (np.linalg.svd(rest, compute_uv=False) >= _AS_KNOWN).sum())


def no_better_than(problem: Problem, identified: Identified, std: Matrix) -> Identified:
    """The same with `weak` for what counts as identified although its std (p,) is beyond the tolerance.

    Where a direction is nearly null the residuals are far from linear, and the std found at the mode can be
    larger than the one that the Jacobian promises.
    """
    status: list[Status] = [
        "weak" if status_of == "identified" and spread > item.tolerance else status_of
        for status_of, item, spread in zip(identified.status, problem.parameters.items, std, strict=True)
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


def _without_own_tolerance(scaled_std: Matrix, unbounded: Mask) -> Matrix:
    """(g,) std of geometry parameters, in tolerances, without the tolerance of each its own (that of the
    others stays): what the data add, nothing for those that are `unbounded` (g,)."""
    added = np.where(unbounded, 0.0, 1 / scaled_std**2 - 1)
    return np.where(added > _NO_INFORMATION, 1 / np.sqrt(np.maximum(added, _NO_INFORMATION)), np.inf)


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
    named: list[tuple[Matrix, Mechanism]] = []
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
            named.append((direction, mechanism))
        if named:
            taken = np.array([direction for direction, _ in named]).T
            left = gauge @ complement(np.linalg.qr(gauge.T @ taken)[0])
    rest = unexplained(problem, int(free.sum()))
    named += [(column, rest) for column in left.T]
    return [
        _named(problem, jacobian, direction, "exact" if i < dimension else "noise", mechanism)
        for i, (direction, mechanism) in enumerate(named)
    ]


def _noise_directions(
    problem: Problem,
    jacobian: Matrix,
    directions: Matrix,
    singular: Matrix,
    share: Matrix,
    status: tuple[Status, ...],
    exact_part: Mask,
) -> list[NullDirection]:
    """Directions that the noise hides: worse than the prior, or the main cause of a poor offset."""
    parameters = problem.parameters
    free_items = [item for item in parameters.items if not item.held]
    free_status = [s for s, item in zip(status, parameters.items, strict=True) if not item.held]
    chosen: dict[int, list[int]] = {int(k): [] for k in np.flatnonzero(singular < _AS_KNOWN)}
    for row, (item, state) in enumerate(zip(free_items, free_status, strict=True)):
        if item.group == "offset" and state in ("weak", "unidentifiable") and not exact_part[row]:
            chosen.setdefault(int(np.argmax(share[row])), []).append(row)
    std = np.sqrt(share.sum(axis=1))
    alone = list(_alone(problem, jacobian)) if chosen else []
    null_directions: list[NullDirection] = []
    explained: list[Matrix] = []
    for k in sorted(chosen, key=lambda k: singular[k]):
        direction, mechanism = directions[:, k], unexplained(problem, len(free_items))
        for candidate, vector, value in alone:
            if any(abs(vector @ known) > 0.9 for known in explained):
                continue
            # It must be this direction, not another that happens to be as weak; or be enough alone.
            same = value <= _AS_NEARLY_NULL * singular[k] and abs(vector @ direction) >= 0.5
            if same or any(
                abs(vector[row]) / value >= _enough(free_items[row], free_status[row], std[row])
                for row in chosen[k]
            ):
                direction, mechanism = vector, candidate
                break
        explained.append(direction)
        null_directions.append(_named(problem, jacobian, direction, "noise", mechanism))
    return null_directions


def _alone(problem: Problem, jacobian: Matrix) -> Iterator[tuple[Mechanism, Matrix, float]]:
    """Each mechanism with (f,) the direction that it hides best, were all other parameters known, and the
    singular value of that."""
    for mechanism in mechanisms(problem):
        support = mechanism.support[problem.parameters.free]
        if not support.any():
            continue
        _, values, right = np.linalg.svd(jacobian[:, support], full_matrices=False)
        if len(values) < support.sum():
            continue
        vector = np.zeros(len(support))
        vector[support] = right[-1]
        yield mechanism, vector, float(max(values[-1], ROUNDING))


def _enough(item: Parameter, status: Status, std: float) -> float:
    """The std, in prior stds, that a mechanism alone must give an offset to be its reason: what makes it
    unidentifiable; of one that is weak most of its `std`."""
    return 1.0 if status == "unidentifiable" else max(item.tolerance / item.prior_std, _MOST * std)


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
