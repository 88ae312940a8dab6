"""What the data can tell, and what not: statuses, null directions and why (section 2 of the design).

Everything follows from A, the Jacobian of the whitened misses by the scaled parameters, taken at
shots that hit. There is no pseudo-inverse here: where the data say nothing, the answer is None.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...model.parameters import Parameters
from ...model.problem import Problem
from ...model.robot import Matrix
from ..status import Status
from .aim import aim, moving_joints
from .causes import NullDirection
from .mechanisms import Mechanism, mechanisms, unexplained

_ROUNDING = 1e-11  # singular values below this share of a unit column are rounding
_ROUNDING_SPECIAL = 1e-9  # the same beside a special point, where shots come to hit by small steps only
_PART = 1e-6  # a parameter with more than this in a unit null vector has a part in it, whatever the rounding
_TARGET_MM, _CONFIRMATIONS = 50.0, 3  # points near by, and the way to them of a target
# Where points differ in what they tell: one in five that tells less than the rest is missed in one of 5000.
_SPECIAL_CONFIRMATIONS = {50.0: 6, 5.0: 16, 0.5: 16}
_NEARER = 6  # halvings of the way to them, until all shots can hit there
_CANNOT_FOLLOW = 1e-6  # of a shot's miss by its joints: smallest singular value by the largest
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
    aimed, jacobian, hit = information_root(problem, x, weight)
    null = _null_space(jacobian)
    followed = _followed(aimed, x, hit, moving_joints(problem.joints) > 0)
    if followed:
        near_by = _near_by(problem, x, hit) if null.size else []
    else:
        # What hits there may be a matter of the tool: a tip hardly off the last axis reaches hardly further.
        near_by = [
            point
            for target_mm, points in _SPECIAL_CONFIRMATIONS.items()
            for point in _near_by(problem, x, hit, target_mm, points, _ROUNDING_SPECIAL)
        ]
        least_told = max(near_by, key=lambda point: point.null.size, default=None)
        if least_told is not None and least_told.null.size > null.size:
            # The shots are judged where the true values may just as well be, and where they tell less.
            aimed, jacobian, _ = information_root(problem, least_told.x, weight)
            null = _null_space(jacobian, _ROUNDING_SPECIAL)
    exact_dimension, exact_part = _confirm(null, [point.null for point in near_by], followed)

    gauge = null.basis
    keep = _complement(gauge)
    _, singular, right = np.linalg.svd(jacobian @ keep, full_matrices=False)
    floor = _ROUNDING * max(float(singular.max(initial=0.0)), 1.0)
    singular = np.maximum(singular, floor)
    directions = keep @ right.T
    if len(singular) < directions.shape[1]:
        singular = np.append(singular, np.full(directions.shape[1] - len(singular), floor))
    share = (directions / singular) ** 2
    scaled_std = np.sqrt(share.sum(axis=1))
    scaled_std = np.where(null.part, np.maximum(scaled_std, 1 / floor), scaled_std)
    scaled_std = np.where(exact_part, np.inf, scaled_std)

    status, data_std = _statuses(parameters, scaled_std)
    null_space = [
        *_exact_directions(aimed, jacobian, gauge, exact_dimension),
        *_noise_directions(aimed, jacobian, directions, singular, share, status, exact_part),
    ]
    size = int(free.sum())
    spectrum = np.append(singular, np.zeros(gauge.shape[1]))
    facts = Identifiability(
        rank=int((spectrum >= 1.0).sum()),
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


def information_root(problem: Problem, x: Matrix, weight: float) -> tuple[Problem, Matrix, NDArray[np.bool_]]:
    """The problem at shots that hit the centre, A there (M, f) for the free parameters, and (N,) which hit.

    Recorded spots are noise: kept, they would pass for information on the roll of the beam's axes.
    """
    centred = problem.moved(problem.joints, np.zeros_like(problem.spots))
    aim_found = aim(centred, x, moving_joints(problem.joints))
    aimed = aim_found.problem
    whitened = aimed.whiten(x)
    rows = problem.shots * problem.tool.miss_size
    jacobian = whitened.jacobian
    jacobian[:rows] *= np.sqrt(weight)
    if problem.noise.separate:
        # The misses tell the noise by their scatter, not by where they are.
        _, own = aimed.linearise(x)
        root = np.linalg.cholesky(aimed.noise_information(x, own, whitened.factor)).T
        noise = problem.parameters.group("noise")
        jacobian = np.vstack([jacobian, np.zeros((2, len(noise)))])
        jacobian[-2:, noise] = root * problem.parameters.prior_std[noise]
    return aimed, jacobian[:, problem.parameters.free], aim_found.hit


@dataclass(frozen=True, eq=False)
class _NullSpace:
    """Numerical null space: an orthonormal `basis` (f, g), and (f,) which parameters have a `part` in it."""

    basis: Matrix
    part: NDArray[np.bool_]

    @property
    def size(self) -> int:
        return self.basis.shape[1]


def _null_space(jacobian: Matrix, rounding: float = _ROUNDING) -> _NullSpace:
    """The null space of A (M, f), judged on columns of unit length.

    So are the parts in it: on them rounding turns a null vector by no more than its share of the smallest
    singular value that is not null, and a part larger than that is one. A small share of a large prior, as a
    target's, can be all that the data leave open of it, and leaves it open without a bound.
    """
    size = jacobian.shape[1]
    length = np.linalg.norm(jacobian, axis=0)
    # A column that is rounding altogether must not be blown up to unit length.
    zero = length <= _ROUNDING * max(1.0, float(length.max(initial=0.0)))
    unit = np.where(zero, 0.0, jacobian / np.where(zero, 1.0, length))
    if len(unit) > size:
        unit = np.asarray(np.linalg.qr(unit, mode="r"))
    _, singular, right = np.linalg.svd(unit, full_matrices=True)
    singular = np.append(singular, np.zeros(size - len(singular)))
    floor = rounding * max(1.0, float(singular.max(initial=0.0)))
    null = right[singular <= floor].T
    if not null.shape[1]:
        return _NullSpace(null, np.zeros(size, dtype=bool))
    turned = floor / float(singular[singular > floor].min(initial=1.0))
    basis = np.linalg.qr(null / np.where(zero, 1.0, length)[:, None])[0]
    part = (np.linalg.norm(null, axis=1) > turned) | (np.linalg.norm(basis, axis=1) > _PART)
    return _NullSpace(basis, part)


def _complement(basis: Matrix) -> Matrix:
    """(f, f - g) orthonormal basis of what is orthogonal to `basis` (f, g)."""
    if basis.shape[1] == 0:
        return np.eye(basis.shape[0])
    return np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :]


def _followed(aimed: Problem, x: Matrix, hit: NDArray[np.bool_], moving: NDArray[np.bool_]) -> bool:
    """Whether the shots of `hit` (N,) can go on hitting, by a small turn of the joints `moving` (n,), where x
    changes a little.

    If so, what they tell at x they tell near by too: the rank of A does not fall at a small step (implicit
    function theorem). If not, the shots that hit near by are others, and may tell less: a beam along the
    last axis hits at any turn of that joint, one beside it at two turns only.
    """
    scale = np.array([1.0 if joint.kind == "revolute" else 1000.0 for joint in aimed.robot.joints])
    _, own = aimed.linearise(x)
    by_joints = (own[:, :, : aimed.robot.n] * scale)[hit][:, :, moving]
    if by_joints.shape[2] < aimed.tool.miss_size:
        return len(by_joints) == 0
    singular = np.linalg.svd(by_joints, compute_uv=False)
    return bool((singular[:, -1] > _CANNOT_FOLLOW * singular[:, 0]).all())


@dataclass(frozen=True, eq=False)
class _NearBy:
    """Parameter values x (p,) and the null space of the shots that hit there."""

    x: Matrix
    null: _NullSpace


def _near_by(
    problem: Problem,
    x: Matrix,
    hit: NDArray[np.bool_],
    target_mm: float = _TARGET_MM,
    points: int = _CONFIRMATIONS,
    rounding: float = _ROUNDING,
) -> list[_NearBy]:
    """At most `points` points beside x at which the same shots hit, with the target about `target_mm` off.

    A shot that misses breaks a gauge that it has where it hits. So these points must let all shots of
    `hit` (N,) hit; they are taken ever nearer to x until they do. There may be none.
    """
    # Other directions at every distance; those of the first are the ones for shots that can be followed.
    rng = np.random.default_rng(2014 if target_mm == _TARGET_MM else [2014, int(10 * target_mm)])
    parameters = problem.parameters
    size = np.where(
        parameters.group("target"),
        target_mm,
        np.minimum(parameters.prior_std, np.maximum(np.radians(1.0), 0.2 * parameters.prior_std)),
    )
    found = []
    for _ in range(points):
        for nearer in range(_NEARER):
            step = rng.normal(size=len(x)) * size / 2**nearer
            other = x + np.where(parameters.free, step, 0.0)
            _, jacobian, still = information_root(problem, other, 1.0)
            if still[hit].all():
                found.append(_NearBy(other, _null_space(jacobian, rounding)))
                break
    return found


def _confirm(null: _NullSpace, near_by: list[_NullSpace], followed: bool) -> tuple[int, NDArray[np.bool_]]:
    """Dimension of the exact gauge and (f,) which parameters have a part in it, from the null space
    at the point judged and those near by.

    What is null at one point must be null near by too; where more is null than there, the shots are others.
    If not all shots are `followed`, points near by may disagree: the one counts that tells least, it may be
    the true one. A parameter has a part in the gauge if it has one at any of them: at a point of symmetry
    (a target on the x axis, say) a turn may leave a coordinate alone to first order that it moves everywhere
    else.
    """
    spaces = [space for space in (null, *near_by) if space.size <= null.size]
    sizes = [space.size for space in spaces]
    dimension = min(sizes) if followed else max(sizes[1:], default=sizes[0])
    return dimension, np.any([space.part for space in spaces if space.size <= dimension], axis=0)


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
        within = gauge @ right[singular <= _PART].T
        fresh, amount, _ = np.linalg.svd(within.T @ left, full_matrices=False)
        for direction in (within @ fresh[:, amount > _NEW]).T:
            found.append((direction, mechanism))
        if found:
            taken = np.array([direction for direction, _ in found]).T
            left = gauge @ _complement(np.linalg.qr(gauge.T @ taken)[0])
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
    wanted = {int(k) for k in np.flatnonzero(singular <= 1.0)}
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
    large &= np.abs(direction) > _PART * np.abs(direction).max()
    order = [int(i) for i in np.argsort(-np.abs(direction)) if large[i]]
    if not mechanism.support.any():
        order = order[:_LARGEST_TERMS]
    effect_size = max(float(np.linalg.norm(jacobian @ direction)), _ROUNDING)
    data_std = None if kind == "exact" else 1 / effect_size
    weights = direction / direction[order[0]]
    combination = {names[i]: float(weights[i]) for i in order}
    return NullDirection(combination, kind, mechanism.cause, data_std)
