"""Predictions for a plan: with fewer measurements, with targets and mounts elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...model.arrays import Matrix
from ...model.files.header import Header
from ...model.likelihood.problem import Problem, Whitened
from .aim import aim, servo_joints

_DRAWS, _MOUNTS, _TYPICAL = 16, 64, 256  # of targets; of mounts too, whose lever decides more; for their mean
GUESSED = {"mm": 50.0, "deg": float(np.radians(30.0))}  # std of where something is that is only guessed

_KNOWN = 1.0  # mm, deg: where a reflector or a tip is to less is no matter of the plan


@dataclass(frozen=True)
class CurvePoint:
    """`worst_std` (deg; mm) of the offsets after the first `shots` shots, priors included."""

    shots: int
    worst_std: float


@dataclass(frozen=True)
class OverTarget:
    """The plan with its targets moved by random errors, by their stated sigma; with `mounts` also the
    reflectors, mounts and tips on the flange, by theirs, or by `GUESSED` where nothing is stated.

    `worst_std` is the largest predicted std (deg; mm) of each offset over the `draws`; `hit` the share
    of the shots that the servo can still turn onto the target.
    """

    draws: int
    hit: float
    worst_std: dict[str, float]
    mounts: bool = False


def predicted_std(problem: Problem, x: Matrix) -> Matrix:
    """(f,) std of the free parameters scaled by their priors, priors included, at x (p,)."""
    return np.asarray(np.sqrt(np.diag(predicted_covariance(problem, x))))


def predicted_covariance(problem: Problem, x: Matrix) -> Matrix:
    """(f, f) of the free parameters scaled by their priors, priors included, at x (p,)."""
    return np.asarray(np.linalg.inv(_information(problem, x)))


def curve(problem: Problem, x: Matrix) -> tuple[CurvePoint, ...]:
    """The worst std of the offsets after the first 2, 3, … shots of aimed shots."""
    whitened = problem.whiten(x)
    roots = problem.roots(whitened)
    so_far = np.cumsum(roots.transpose(0, 2, 1) @ roots, axis=0) + besides(problem, whitened)
    worst = _worst(problem, so_far[1:])
    return tuple(CurvePoint(shots, float(std)) for shots, std in enumerate(worst, start=2))


def over_target(problem: Problem, x: Matrix, spread: Matrix, *, mounts: bool = False) -> OverTarget | None:
    """The plan for targets, and `mounts`, drawn with std `spread` (p,), internal units; None where none is
    spread."""
    if not spread.any():
        return None
    drawn = _drawn(problem, x, spread, _MOUNTS if mounts else _DRAWS)
    largest = dict(zip(drawn.names, drawn.stds.max(axis=0).tolist(), strict=True))
    return OverTarget(len(drawn.x), drawn.hit, largest, mounts)


def mounted_spread(header: Header, problem: Problem) -> Matrix:
    """(p,) std of where on the flange that is which an instrument without a beam measures or touches with,
    internal units: its prior's, at most `GUESSED`; 0 of what is known to a millimetre or a degree."""
    spread = np.zeros(len(problem.parameters))
    for i, item in enumerate(problem.parameters.items):
        kind = header.kinds.get(item.of.partition(".")[0])
        if (
            item.group == "tool"
            and not (item.held or (kind is not None and kind.beam))
            and item.prior_std * item.display > _KNOWN
        ):
            spread[i] = min(item.prior_std, GUESSED[item.unit])
    return spread


def typical(problem: Problem, x: Matrix, spread: Matrix) -> tuple[Problem, Matrix]:
    """The shots and x (p,) with the mounts of one draw by `spread` (p,): that whose std of the offsets are
    nearest to the root mean squares over all draws. Nothing moves where none is spread.

    What a run will know of the offsets depends on where a reflector is. A plan that is chosen for the place
    where it is guessed promises for that place alone.
    """
    if not spread.any():
        return problem, x
    drawn = _drawn(problem, x, spread, _TYPICAL)
    mean = np.log((drawn.stds**2).mean(axis=0)) / 2
    there = drawn.x[np.argmin(((np.log(drawn.stds) - mean) ** 2).sum(axis=1))]
    return problem.at_predicted(there), there


class _Drawn(NamedTuple):
    """Drawn parameters `x` (D, p), the share of the shots that hit, and the `stds` (D, offsets) of the free
    offsets by their `names`."""

    x: Matrix
    hit: float
    names: list[str]
    stds: Matrix


def _drawn(problem: Problem, x: Matrix, spread: Matrix, draws: int) -> _Drawn:
    count = problem.shots
    there = x + spread * np.random.default_rng(1).normal(size=(draws, len(x)))
    every = problem.select(np.tile(np.arange(count), draws))
    aimed = aim(every, np.repeat(there, count, axis=0), servo_joints(every))
    hits = (k * count + np.flatnonzero(hit) for k, hit in enumerate(aimed.hit.reshape(draws, count)))
    information = np.array(
        [_information(aimed.problem.select(hit), values) for hit, values in zip(hits, there, strict=True)]
    )
    return _Drawn(there, float(aimed.hit.mean()), *_offset_stds(problem, information))


def _information(problem: Problem, x: Matrix) -> Matrix:
    """(f, f) of the scaled free parameters at x: Fisher's, with that of distances and priors."""
    jacobian = problem.whiten(x).jacobian[:, problem.parameters.free]
    return jacobian.T @ jacobian + np.eye(jacobian.shape[1])


def besides(problem: Problem, whitened: Whitened) -> Matrix:
    """(f, f) the information of distances and priors."""
    rows = problem.shots * problem.tool.residual_size
    jacobian = whitened.jacobian[rows:, problem.parameters.free]
    return jacobian.T @ jacobian + np.eye(jacobian.shape[1])


def roots_with_ties(problem: Problem, whitened: Whitened) -> Matrix:
    """(N, d, f) the roots of the shots, by coordinates in which prior and ties together are a unit prior.
    Ties are of targets alone, so that the offsets remain as they are."""
    roots = problem.roots(whitened)
    tied = whitened.jacobian[roots.shape[0] * roots.shape[1] :, problem.parameters.free]
    if not len(tied):
        return roots
    lower = np.linalg.cholesky(np.eye(tied.shape[1]) + tied.T @ tied)
    return np.asarray(np.linalg.solve(lower, roots.transpose(0, 2, 1)).transpose(0, 2, 1))


def _offset_stds(problem: Problem, information: Matrix) -> tuple[list[str], Matrix]:
    """Names of the free offsets, and their std (deg; mm) (…, offsets) by information (…, f, f)."""
    items = [item for item in problem.parameters.items if not item.held]
    offsets = [i for i, item in enumerate(items) if item.group == "offset"]
    units = np.array([items[i].prior_std * items[i].display for i in offsets])
    columns = np.linalg.solve(information, np.eye(len(items))[:, offsets])  # of the inverse: no others count
    variances = np.diagonal(columns[..., offsets, :], axis1=-2, axis2=-1)
    return [items[i].name for i in offsets], np.asarray(np.sqrt(variances) * units)


def _worst(problem: Problem, information: Matrix) -> Matrix:
    """(…) the largest std (deg; mm) of the offsets, by information (…, f, f)."""
    return np.asarray(_offset_stds(problem, information)[1].max(axis=-1, initial=0.0))
