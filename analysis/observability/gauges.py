"""Exact gauges: the null space of the Jacobian of measurements that hit, confirmed at parameter values near
by."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.problem import Problem
from .aim import HIT_MM, Aimed, aim, at_one_position, at_rest, joint_scale, moving_joints, to_meet


class Marginal(NamedTuple):
    """A (M, f) with t of its columns eliminated, those of what has a tolerance; m are left.

    `root` (k, m) is A of those left: `root.T @ root` is their information, the tolerances as noise (a Schur
    complement). `response` (t, m) is by how many tolerances the eliminated move with each of them, `std` (t,)
    their std in tolerances, were the others known.
    """

    root: Matrix
    response: Matrix
    std: Matrix

    @classmethod
    def of(cls, jacobian: Matrix, tolerated: Mask) -> Marginal:
        """By a QR factorisation with the eliminated columns first; their tolerances are rows of A."""
        count = int(tolerated.sum())
        if not count:
            return cls(jacobian, np.zeros((0, jacobian.shape[1])), np.zeros(0))
        ordered = np.hstack([jacobian[:, tolerated], jacobian[:, ~tolerated]])
        factor: Matrix = np.asarray(np.linalg.qr(ordered, mode="r"))
        right = np.hstack([-factor[:count, count:], np.eye(count)])
        solved = np.asarray(np.linalg.solve(factor[:count, :count], right), dtype=float)
        left = jacobian.shape[1] - count
        return cls(factor[count:, count:], solved[:, :left], np.linalg.norm(solved[:, left:], axis=1))

    def shares(self, direction: Matrix) -> Matrix:
        """(t,) the part of a direction's variance that each tolerance sets; `direction` (m,)."""
        variance = float(((self.root @ direction) ** 2).sum())
        return np.asarray((self.response @ direction) ** 2 / max(variance, np.finfo(float).tiny))


ROUNDING = 1e-11  # singular values below this share of a unit column are rounding
_ROUNDING_SPECIAL = 1e-9  # the same near a special point, where measurements come to hit by small steps only
PART = 1e-6  # a parameter with more than this in a unit null vector has a part in it, whatever the rounding
_TARGET_MM, _CONFIRMATIONS = 50.0, 3  # points near by, and the way to them of a target
# Where points differ in rank: one in five with a lower rank than the rest is overlooked in one of 5000.
_SPECIAL_CONFIRMATIONS = 38
_TURN = np.radians(2.0)  # standard deviation of a joint (or as a share of a metre) where a target is put
_NEARER = 6  # halvings of the way to them, until all shots can hit there
_NEARER_FOLLOWED = 12  # the same where they must be the same shots besides
_CANNOT_FOLLOW = 1e-6  # of a residual by its joints: smallest singular value by the largest
_PREDICTED = 0.1  # of a residual may not be as its Jacobian predicts: else it may come to another posture
_ELSEWHERE_MM = 2.0  # from where it was stated: no mounting that is known deviates by so much
_CLEARLY = 10.0  # standard uncertainties of that distance
_AIMED_AT_ONCE = 5000  # shots: more are no faster


@dataclass(frozen=True, eq=False)
class Gauge:
    """The Jacobian of measurements that hit at a point, and its null space.

    `aimed` has the shots there, `jacobian` is A (M, f). A tolerance is a row of A, so only the m parameters
    without one can have a part in the null space: `basis` (m, g) spans it and `part` (m,) says which have.
    `dimension` of it are confirmed near by: an exact gauge, in which those of `exact_part` (m,) have a part.
    `spanned` (t,) says which parameters with a tolerance do nothing that the others cannot do. Where more is
    null here than near by, `near_by` has A and its null space there: what is null here takes up there, by a
    little, what others do to the data. `nominal` (p,) is the point judged without deviations (`_nominal`).
    """

    aimed: Problem
    jacobian: Matrix
    basis: Matrix
    part: Mask
    dimension: int
    exact_part: Mask
    spanned: Mask
    near_by: tuple[tuple[Matrix, Matrix], ...] = ()
    nominal: Matrix | None = None


def gauge_of(problem: Problem, x: Matrix, weight: float) -> Gauge:
    """The gauge of the shots at x (p,), or near by, if the true values may be there and the rank is lower.

    They may be where nothing deviates that has a tolerance. An estimate of such a deviation, be it that of
    the noise alone, must not pass for information on what would be a gauge without it. What is far from where
    it was stated is where it is found.
    """
    aimed, jacobian, hit = information_root(problem, x, weight)
    tolerated = problem.parameters.tolerated[problem.parameters.free]
    null = _null_space(jacobian, tolerated)
    nominal = _nominal(problem, x, jacobian)
    if not np.array_equal(nominal, x):
        ((there, root, hits),) = information_roots(problem, nominal[None], weight)
        null_there = _null_space(root, tolerated)
        if null_there.size > null.size:
            x, aimed, jacobian, hit, null = nominal, there, root, hits, null_there
    taken_up = [spanned(jacobian, tolerated)]
    followed = _followed(aimed, x, hit, _weights(problem) > 0)
    near_by = []
    if null.size or tolerated.any() or not followed:
        near_by = _near_by(problem, x, hit, aimed, followed)
    if not followed:
        lowest_rank = max(near_by, key=lambda point: point.null.size, default=None)
        if lowest_rank is not None and lowest_rank.null.size > null.size:
            # Judged where the true values may just as well be, and where the rank is lower.
            aimed, jacobian, _ = information_root(problem, lowest_rank.x, weight)
            null = _null_space(jacobian, tolerated, _ROUNDING_SPECIAL)
    confirming = near_by
    if null.size and tolerated.any():
        confirming = _near_by(problem, x, hit, aimed, followed, problem.parameters.untolerated)
    dimension, exact_part = _confirm(null, confirming, followed)
    # What deviates takes parts along that are none of the nominal arm.
    exact_part = np.any(
        [exact_part, *(point.null.part for point in near_by if point.null.size <= dimension)], axis=0
    )
    taken_up += [spanned(point.jacobian, tolerated) for point in near_by if point.same or not followed]
    every = np.any(taken_up, axis=0)
    gauge = Gauge(aimed, jacobian, null.basis, null.part, dimension, exact_part, every, nominal=nominal)
    return replace(gauge, near_by=tuple(_less_null(problem, null.size, near_by, weight)))


def _nominal(problem: Problem, x: Matrix, jacobian: Matrix) -> Matrix:
    """(p,) x without the deviations of what has a tolerance, but for tips and reflectors that are found, by A
    (M, f) at x, millimetres from where they were stated: there they are, however wide the tolerance.
    """
    parameters = problem.parameters
    nominal = np.where(parameters.tolerated, parameters.prior_mean, x)
    of_point: dict[str, list[int]] = {}
    for i in np.flatnonzero(parameters.tolerated & parameters.group("tool")).tolist():
        if parameters.items[i].unit == "mm":
            of_point.setdefault(parameters.items[i].of, []).append(i)
    # The row of A of each.
    row_of = len(jacobian) - int(parameters.tolerated.sum()) - 1 + np.cumsum(parameters.tolerated)
    for places in of_point.values():
        off = (x - nominal)[places]
        if np.linalg.norm(off) < _ELSEWHERE_MM:
            continue
        rows, among = np.delete(jacobian, row_of[places], axis=0), parameters.among_free[places]
        moved = rows[:, among] @ (off / parameters.prior_std[places])
        others = np.delete(rows, among, axis=1)
        left = moved - others @ np.linalg.lstsq(others, moved, rcond=None)[0]
        if np.linalg.norm(left) > _CLEARLY:
            nominal[places] = x[places]
    return nominal


def gauge_at(problem: Problem, x: Matrix, weight: float) -> Gauge:
    """The gauge of the shots at x (p,) alone, all of it taken as exact."""
    aimed, jacobian, _ = information_root(problem, x, weight)
    tolerated = problem.parameters.tolerated[problem.parameters.free]
    null = _null_space(jacobian, tolerated)
    return Gauge(aimed, jacobian, null.basis, null.part, null.size, null.part, spanned(jacobian, tolerated))


def _less_null(
    problem: Problem, size: int, near_by: list[_NearBy], weight: float
) -> Iterator[tuple[Matrix, Matrix]]:
    """A (M, f), its measurements with the `weight`, and a basis of its null space where that has a lower
    dimension than `size` for the same shots."""
    points = [point for point in near_by if point.same and point.null.size < size]
    if points:
        roots = information_roots(problem, np.array([point.x for point in points]), weight)
        for point, (_, jacobian, _) in zip(points, roots, strict=True):
            yield jacobian, point.null.basis


def information_root(problem: Problem, x: Matrix, weight: float) -> tuple[Problem, Matrix, Mask]:
    """The problem at shots that hit the centre, A (M, f) there by the free parameters, and (N,) which hit."""
    return _information_root(problem, x.tobytes(), weight)


@lru_cache(maxsize=1)  # one run calls it several times
def _information_root(problem: Problem, x: bytes, weight: float) -> tuple[Problem, Matrix, Mask]:
    (root,) = information_roots(problem, np.frombuffer(x)[None], weight)
    for array in root[1:]:
        array.flags.writeable = False
    return root


def information_roots(problem: Problem, xs: Matrix, weight: float) -> list[tuple[Problem, Matrix, Mask]]:
    """`information_root` at many points (k, p), whose shots are aimed side by side.

    Recorded spots are noise: kept, they would pass for information on the roll of the beam's axes. So is what
    a joint at rest varies by.
    """
    centred, shots = problem.moved(problem.joints, np.zeros_like(problem.spots)), problem.shots
    weights, at_once = moving_joints(problem), max(1, _AIMED_AT_ONCE // max(shots, 1))
    rest = at_rest(problem) & (weights > 0)
    roots = []
    for some in (xs[i : i + at_once] for i in range(0, len(xs), at_once)):
        every = centred.select(np.tile(np.arange(shots), len(some)))
        aimed = aim(every, np.repeat(some, shots, axis=0), weights)
        for k, x in enumerate(some):
            rows = slice(k * shots, (k + 1) * shots)
            there, hit = aimed.problem.select(np.arange(k * shots, (k + 1) * shots)), aimed.hit[rows]
            if rest.any():
                still = at_one_position(
                    Aimed(there, aimed.off_mm[rows], hit, aimed.ahead[rows]), x, rest, weights
                )
                there, hit = still.problem, still.hit
            roots.append((there, _root(there, x, weight), hit))
    return roots


def _weights(problem: Problem) -> Matrix:
    """(n,) weights by which recorded shots may be moved, 0 of joints at rest."""
    return np.where(at_rest(problem), 0.0, moving_joints(problem))


def _root(aimed: Problem, x: Matrix, weight: float) -> Matrix:
    """A (M, f) for the free parameters, of shots that hit at x."""
    whitened = aimed.whiten(x)
    rows = aimed.shots * aimed.tool.residual_size
    jacobian, parameters = whitened.jacobian, aimed.parameters
    jacobian[:rows] *= np.sqrt(weight)
    if aimed.noise.separate:
        # The noise is determined by the scatter of the residuals, not by where they are.
        _, jacobian_mm = aimed.linearise(x)
        root = np.linalg.cholesky(aimed.noise_information(x, jacobian_mm, whitened.factor)).T
        noise = parameters.group("noise")
        jacobian = np.vstack([jacobian, np.zeros((len(root), len(noise)))])
        jacobian[-len(root) :, noise] = root * parameters.prior_std[noise]
    # A tolerance of the geometry is knowledge, as a measurement is; an offset's prior is not.
    known = np.eye(len(parameters))[aimed.tolerated]
    return np.asarray(np.vstack([jacobian, known])[:, parameters.free])


@dataclass(frozen=True, eq=False)
class _NullSpace:
    """Numerical null space: an orthonormal `basis` (m, g), and (m,) which parameters have a `part` in it."""

    basis: Matrix
    part: Mask

    @property
    def size(self) -> int:
        return int(self.basis.shape[1])


def _null_space(jacobian: Matrix, tolerated: Mask, rounding: float = ROUNDING) -> _NullSpace:
    """The null space of A (M, f) by the m parameters without a tolerance, judged on columns of unit length.

    So are the parts in it: on them rounding turns a null vector by no more than its share of the smallest
    singular value that is not null, and a part larger than that is one. A small share of a large prior, as a
    target's, can be all that the data leave open of it, and leaves it open without a bound.
    """
    # The tolerances are the last rows, and keep what has one out of it.
    jacobian = jacobian[: len(jacobian) - int(tolerated.sum()), ~tolerated]
    size = jacobian.shape[1]
    length = np.linalg.norm(jacobian, axis=0)
    # A column that is rounding altogether must not be blown up to unit length.
    zero = length <= ROUNDING * max(1.0, float(length.max(initial=0.0)))
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
    part = (np.linalg.norm(null, axis=1) > turned) | (np.linalg.norm(basis, axis=1) > PART)
    return _NullSpace(basis, part)


def spanned(jacobian: Matrix, tolerated: Mask) -> Mask:
    """(t,) which parameters with a tolerance do to the data what the others that are free can do as well.

    From A (M, f), of which the last t rows are the tolerances. Rounding hides it in a std: one direction that
    the data see a million times better than a tolerance is enough.
    """
    count = int(tolerated.sum())
    if count == 0:
        return np.zeros(0, dtype=bool)
    data = jacobian[: len(jacobian) - count]
    geometry, others = data[:, tolerated], data[:, ~tolerated]
    length = np.linalg.norm(others, axis=0)
    left, singular, _ = np.linalg.svd(others / np.where(length > 0, length, 1.0), full_matrices=False)
    kept = left[:, singular > ROUNDING * max(1.0, float(singular.max(initial=0.0)))]
    beyond = geometry - kept @ (kept.T @ geometry)
    largest = float(np.linalg.norm(jacobian, axis=0).max(initial=0.0))
    bound = np.maximum(PART * np.linalg.norm(geometry, axis=0), ROUNDING * max(1.0, largest))
    return np.asarray(np.linalg.norm(beyond, axis=0) <= bound)


def complement(basis: Matrix) -> Matrix:
    """(f, f - g) orthonormal basis of what is orthogonal to `basis` (f, g)."""
    if basis.shape[1] == 0:
        return np.eye(basis.shape[0])
    return np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :]


def _followed(aimed: Problem, x: Matrix, hit: Mask, moving: Mask) -> bool:
    """Whether the shots of `hit` (N,) can go on hitting, by a small turn of the joints `moving` (n,), where x
    changes a little.

    If so, the rank of A does not fall at a small step (implicit function theorem). If not, the measurements
    that hit near by are others, and A may have a lower rank: a beam along the last axis hits at any turn of
    that joint, one off the axis at two turns only.
    """
    _, jacobian_mm = aimed.linearise(x)
    by_joints = (aimed.by_joints(jacobian_mm) * joint_scale(aimed))[:, :, moving]
    for components, shots in _alike(aimed.met, hit):
        some = by_joints[shots][:, components]
        if some.shape[2] < some.shape[1]:
            return False
        singular = np.linalg.svd(some, compute_uv=False)
        if (singular[:, -1] <= _CANNOT_FOLLOW * singular[:, 0]).any():
            return False
    return True


def _alike(met: Matrix, hit: Mask) -> Iterator[tuple[Index, Index]]:
    """Of the shots `hit` (N,) those whose joints are turned by the same components of `met` (N, d): these,
    and the shots."""
    for kind in np.unique(met[hit], axis=0):
        components = np.flatnonzero(kind)
        if len(components):
            yield components, np.flatnonzero(hit & (met == kind).all(axis=1))


@dataclass(frozen=True, eq=False)
class _NearBy:
    """Parameter values x (p,), A of the shots that hit there and its null space, and whether those are the
    `same` as at the point judged, turned by a little."""

    x: Matrix
    jacobian: Matrix
    null: _NullSpace
    same: bool


def _near_by(
    problem: Problem, x: Matrix, hit: Mask, aimed: Problem, followed: bool, moved: Mask | None = None
) -> list[_NearBy]:
    """Points near x at which all shots of `hit` (N,) hit, all that were found on the way to each of some
    points, of the parameters `moved` (p,) alone if that is given. `aimed` has the shots at x. There may be
    none.

    All are tried side by side, then those again that will not do, by half the way. A shot that does not hit
    breaks a gauge that it has where it hits, and so does one that jumps to another posture, such as the
    second one from which a tip reaches the target. So points are taken ever nearer to x until all shots have
    turned there about as their Jacobian at x, where they are `followed`, predicts. Those on the way, where
    some have jumped, say less of the dimension of a gauge, but more of what has a part in it: the nearer the
    point, the smaller the part of what has none at x. Where shots cannot be followed they need not be the
    same; fewer joints than a residual has coordinates reach no other point then.
    """
    weights, tolerated = _weights(problem), problem.parameters.tolerated[problem.parameters.free]
    if not followed and np.count_nonzero(weights) < problem.met.sum(axis=1).max():
        return []
    rng = np.random.default_rng(2014)
    rounding, nearer = (ROUNDING, _NEARER_FOLLOWED) if followed else (_ROUNDING_SPECIAL, _NEARER)
    numbered: list[tuple[int, _NearBy]] = []
    missing = list(range(_CONFIRMATIONS if followed else _SPECIAL_CONFIRMATIONS))
    for halved in range(nearer):
        if not missing:
            break
        tried = missing
        steps = [_step(problem, rng) * (1.0 if moved is None else moved) for _ in tried]
        others = x + np.reshape(steps, (len(tried), len(x))) / 2**halved
        if not followed:
            others = _within_reach(aimed, others, hit, rng, _TURN / 2**halved)
        missing = []
        roots = information_roots(problem, others, 1.0)
        for k, other, (there, jacobian, still) in zip(tried, others, roots, strict=True):
            same = False
            if still[hit].all():
                same = followed and _same_shots(aimed, x, there, other, hit)
                numbered.append(
                    (k, _NearBy(other, jacobian, _null_space(jacobian, tolerated, rounding), same))
                )
            if not (same if followed else still[hit].all()):
                missing.append(k)
    return [point for _, point in sorted(numbered, key=lambda pair: pair[0])]


def _step(problem: Problem, rng: np.random.Generator) -> Matrix:
    """(p,) a random way to a point near by."""
    parameters = problem.parameters
    size = np.where(
        parameters.group("target"),
        _TARGET_MM,
        np.minimum(parameters.prior_std, np.maximum(np.radians(1.0), 0.2 * parameters.prior_std)),
    )
    return np.where(parameters.free, rng.normal(size=len(parameters)) * size, 0.0)


def _within_reach(aimed: Problem, xs: Matrix, hit: Mask, rng: np.random.Generator, turn: float) -> Matrix:
    """xs (k, p) with each target moved, as little as can be, to where one of its shots of `hit` (N,) meets
    it: a random one, whose joints are turned by about `turn`.

    Where shots cannot follow a target, hardly any random target is within reach. The tip of an arm without
    shoulder and elbow, say, reaches a shell about as thick as its links deviate from nominal. Without points
    near by, the verdict would be that of the special point, at which the shots say more than nearly anywhere
    else.
    """
    parameters, xs = aimed.parameters, xs.copy()
    for which in range(len(aimed.targets) - aimed.stations):
        shots = np.flatnonzero(hit & (aimed.target_index == which))
        if len(shots) == 0:
            continue
        chosen = aimed.select(rng.choice(shots, len(xs)))
        turns = rng.normal(size=chosen.joints.shape) * joint_scale(aimed) * turn
        joints = chosen.joints + np.where(_weights(aimed) > 0, turns, 0.0)
        residual, jacobian = to_meet(chosen, xs, joints, slice(None))
        block = parameters.block("target", which)
        by_target = jacobian[:, :, parameters.in_shot("target")] * parameters.prior_std[block]
        step = (np.linalg.pinv(by_target) @ residual[:, :, None])[:, :, 0]
        xs[:, block] -= step * parameters.prior_std[block]
    return xs


def _same_shots(aimed: Problem, x: Matrix, there: Problem, other: Matrix, hit: Mask) -> bool:
    """Whether the shots of `hit` (N,), aimed at x and `there` at `other`, have turned as their Jacobian at x
    predicts: the turn of the joints takes away what `other` adds to the residuals, but for little.

    One that jumped to another posture has turned by more than that. Whether a step of Newton's leads near is
    no test: a shot near the end of what its joint reaches jumps after such a step too.
    """
    _, jacobian_mm = to_meet(aimed, x, aimed.joints, slice(None))
    added, _ = to_meet(aimed, other, aimed.joints, slice(None))
    turned = (there.joints - aimed.joints)[:, :, None]
    left = added + (aimed.by_joints(jacobian_mm) @ turned)[:, :, 0]
    before, after = (np.linalg.norm(residual[hit], axis=1) for residual in (added, left))
    return bool((after <= _PREDICTED * before + HIT_MM).all())


def _confirm(null: _NullSpace, near_by: list[_NearBy], followed: bool) -> tuple[int, Mask]:
    """Dimension of the exact gauge and (m,) which parameters have a part in it, from the null space
    at the point judged and those near by.

    What is null at one point must be null near by too, for the same shots; where more is null than there, the
    shots are others. If not all shots are `followed`, points near by may disagree: the one with the lowest
    rank counts, it may be the true one. A parameter has a part in the gauge if it has one at any of them,
    whatever the shots: at a point of symmetry (a target on the x axis, say) a turn may leave a coordinate
    alone to first order that it moves everywhere else.
    """
    points = [point for point in near_by if point.null.size <= null.size]
    if followed:
        dimension = min([null.size, *(point.null.size for point in points if point.same)])
    else:
        dimension = max((point.null.size for point in points), default=null.size)
    spaces = [null, *(point.null for point in points)]
    return dimension, np.any([space.part for space in spaces if space.size <= dimension], axis=0)
