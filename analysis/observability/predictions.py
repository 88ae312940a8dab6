"""Predictions for a plan: with fewer measurements, with targets and mounts elsewhere; and the error of the
TCP that measurements will leave, for arms at random and what is estimated of them.

That is linear about one arm. With x the scaled parameters of the arm, m their estimates, J the TCP by the
parameters and J_o M what nominal geometry with the offsets fitted to m makes of them, the TCP is off by
J x - J_o M m: by J (x - m) for the noise, and by (J - J_o M) m for the links that are not entered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.files.header import Header
from ...model.likelihood.problem import Problem, Whitened
from ..covariance import drawn_by_covariance
from ..status import Status
from ..tcp_region import (
    arm_covariance,
    arms_at_random,
    default_point,
    fitted_points,
    moving_by_nominal,
    normal_inverse,
    region_postures,
    tool_point,
    unmeasured_link,
)
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


_POSTURES, _FITTED_AT = 128, 32
_SEED = 2015


@dataclass(frozen=True, eq=False)
class ArmBelief:
    """What is known of an arm and what measures it: `mean` (f,) and `covariance` (f, f) of the scaled free
    parameters of a `problem`; `dof` degrees of freedom where the noise is estimated."""

    problem: Problem
    mean: Matrix
    covariance: Matrix
    dof: float | None = None

    @cached_property
    def deviations(self) -> Matrix:
        """(D, f) of arms at random from the mean: by `arms_at_random`, and the rest as goes with them."""
        parameters = self.problem.parameters
        arm = parameters.free[parameters.arm]
        count, rng = int(arm.sum()), np.random.default_rng(_SEED + 2)
        of_arm = arms_at_random(arm_covariance(self.problem, self.covariance), self.dof)
        of_arm = of_arm[:, arm] / parameters.prior_std[parameters.arm][arm]
        by_arm = np.linalg.solve(self.covariance[:count, :count], self.covariance[:count, count:])
        left = self.covariance[count:, count:] - self.covariance[count:, :count] @ by_arm
        return np.hstack([of_arm, of_arm @ by_arm + drawn_by_covariance(left, len(of_arm), rng)])


@dataclass(frozen=True, eq=False)
class EstimatesOfArms:
    """Of arms at random: the `estimates` (D, f), or (1, f) if all have the same, and the `errors` (D, f) by
    which the arms are off them."""

    estimates: Matrix
    errors: Matrix

    @classmethod
    def made(cls, belief: ArmBelief) -> Self:
        """Those that are made: the belief is what came of them."""
        return cls(belief.mean[None], belief.deviations)

    @classmethod
    def of_new_run(cls, belief: ArmBelief, covariance: Matrix, roots: Matrix) -> Self:
        """Those of a new run of measurements with these roots (N, d, f); it has the `covariance` (f, f)."""
        return cls._by(belief, covariance, roots, belief.mean + belief.deviations)

    @classmethod
    def of_more(cls, belief: ArmBelief, covariance: Matrix, roots: Matrix) -> Self:
        """Those of measurements with these roots beside what the belief came of; they have the `covariance`
        (f, f) together."""
        drawn = belief.deviations @ np.linalg.inv(belief.covariance)
        return cls._by(belief, covariance, roots, drawn)

    @classmethod
    def _by(cls, belief: ArmBelief, covariance: Matrix, roots: Matrix, drawn: Matrix) -> Self:
        """`drawn` (D, f): arms times the information by which they are drawn to what is believed of them."""
        arms = belief.mean + belief.deviations
        rows = roots.reshape(-1, roots.shape[-1])
        noise = np.random.default_rng(_SEED + 1).normal(size=(len(arms), len(rows)))
        errors = (drawn - noise @ rows) @ covariance
        return cls(arms - errors, errors)


class TcpForecast:
    """The TCP's error over the region at x (p,), for parameters of this `status` (p,)."""

    def __init__(self, problem: Problem, x: Matrix, status: Sequence[Status]) -> None:
        self._problem, self._x = problem, x
        self._point = default_point(problem, status)[0]
        self._joints = region_postures(problem, _POSTURES)
        self._moving = moving_by_nominal(problem, self._point, self._joints)
        self._moving[0] = False  # a choice of frame

    def errors(
        self, estimates: EstimatesOfArms, determined: Mask
    ) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """Median and 95 % of the TCP's error, mm, with the offsets entered, and with the links too; None
        where it depends on an offset that is not `determined` (f,), the second also of an exact arm."""
        parameters = self._problem.parameters
        offsets = parameters.block("offset")
        free = parameters.free[offsets]
        entered = np.zeros(len(free), dtype=bool)
        entered[free] = determined[: int(free.sum())]
        if (self._moving & ~entered).any():
            return None, None
        by_noise = estimates.errors @ self._by_arm.T + self._of_link
        tcp = _length_quantiles(by_noise + estimates.estimates @ self._not_entered(entered).T)
        if not self._problem.geometry:
            return tcp, None
        return tcp, _length_quantiles(by_noise + estimates.estimates @ self._not_held.T)

    @cached_property
    def mean_square(self) -> Matrix:
        """(f, f) mm² of scaled free parameters: e' E e is the mean squared error of the TCP over the
        region."""
        return np.asarray(self._by_arm.T @ self._by_arm / len(self._joints))

    @property
    def unmeasured_square(self) -> float:
        """mm², the mean squared error of the TCP by the last link, where a free tool takes it up."""
        return float((self._by_link**2).sum() / len(self._joints))

    def places(self, joints: Matrix) -> Matrix:
        """(P, 3) mm the TCP at recorded `joints` (P, n)."""
        return tool_point(self._problem, self._x, self._point, joints)[0]

    @cached_property
    def _scaled(self) -> Matrix:
        """(3 P, a) mm the TCP by offsets and geometry, each by the std of its prior."""
        return self._rows(self._point, self._joints)

    @cached_property
    def _by_arm(self) -> Matrix:
        """(3 P, f) mm the TCP by the scaled free parameters."""
        return self._of_free(self._scaled)

    @cached_property
    def _by_link(self) -> Matrix:
        """(3 P, m) mm the TCP by the tolerances of what of the last link a free tool takes up."""
        return self._scaled[:, unmeasured_link(self._problem) > 0]

    @cached_property
    def _of_link(self) -> Matrix:
        """(D, 3 P) mm by which the TCPs of arms at random are off for that."""
        return arms_at_random(np.eye(self._by_link.shape[1])) @ self._by_link.T

    def _rows(self, points: Matrix, joints: Matrix) -> Matrix:
        """(3 P, a) mm points of the flange by the same."""
        parameters = self._problem.parameters
        _, jacobian = tool_point(self._problem, self._x, points, joints)
        return np.asarray((jacobian * parameters.prior_std[parameters.arm]).reshape(3 * len(joints), -1))

    def _of_free(self, scaled: Matrix) -> Matrix:
        """(3 P, f) of (3 P, a)."""
        parameters = self._problem.parameters
        arm = parameters.free[parameters.arm]
        rows = np.zeros((len(scaled), int(parameters.free.sum())))
        rows[:, : int(arm.sum())] = scaled[:, arm]
        return rows

    @cached_property
    def _fitted(self) -> Matrix:
        """(M, f) mm the points by which values to enter are fitted."""
        points, joints, roots = fitted_points(self._problem, self._point, _FITTED_AT)
        return self._of_free(self._rows(points, joints)) * np.repeat(roots, 3)[:, None]

    def _not_entered(self, entered: Mask) -> Matrix:
        """(3 P, f) mm by which the TCP is off for the parameters of an arm of which nominal geometry has the
        best values of the offsets `entered` (n,)."""
        parameters = self._problem.parameters
        free = parameters.free[parameters.block("offset")]
        at, out = np.flatnonzero(entered[free]), np.flatnonzero(~entered[free])
        fitted = self._fitted.copy()
        fitted[:, out] = 0.0  # neither the arm nor the controller has them
        columns = fitted[:, at]
        inverse = normal_inverse(columns)
        fit = inverse @ (columns.T @ fitted)
        fit[:, at] += np.eye(len(at)) - inverse @ (columns.T @ columns)  # what moves no point
        return np.asarray(self._by_arm - self._by_arm[:, at] @ fit)

    @cached_property
    def _not_held(self) -> Matrix:
        """(3 P, f) mm the same of what a robot file does not hold: gravity and harmonics."""
        items = [item for item in self._problem.parameters.items if not item.held]
        held = [item.group == "offset" or item.name.startswith("link") for item in items]
        return np.asarray(np.where(held, 0.0, self._by_arm))


def _length_quantiles(errors: Matrix) -> tuple[float, float]:
    """Median and 95 % of the lengths of errors (D, 3 P)."""
    lengths = np.linalg.norm(errors.reshape(len(errors), -1, 3), axis=2)
    median, p95 = np.quantile(lengths, [0.5, 0.95])
    return float(median), float(p95)
