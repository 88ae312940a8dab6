"""The heart: shots, unknowns and noise together, as misses, exact Jacobians and log-likelihood.

A parameter vector x (p,) is in internal units (rad, mm) and in the order of `Parameters`. The
scaled Jacobian is by z = (x - prior mean) / prior std, so that it changes neither with units nor
with the size of a column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .constraint import ShotFunctions, shot_functions
from .errors import BadInput
from .kernel import GridInput, constant, per_inner, per_outer, selected
from .noise import Noise
from .parameters import Parameters
from .robot import Matrix, Robot
from .run import Run, check_distances
from .tool import Tool

if TYPE_CHECKING:
    from .header import Header
    from .plan import Plan

Index = NDArray[np.int64]

_COMPILE_FROM = 50  # shots: for fewer, compiling takes longer than it saves in a fit


@dataclass(frozen=True)
class Distance:
    """A stated distance between two targets (by their index), mm."""

    first: int
    second: int
    mm: float
    sigma: float


class Whitened(NamedTuple):
    """Misses and distances in their own standard deviations at one x.

    `residual` (M,) and `jacobian` (M, p) by scaled parameters, the shots first (d rows each), then the
    distances; `miss` (N, d) mm; `factor` (N, d, d) the lower Cholesky factors of the S_i.
    """

    residual: Matrix
    jacobian: Matrix
    miss: Matrix
    factor: Matrix


@dataclass(frozen=True, eq=False)
class Problem:
    """N shots of one robot and tool at K targets. `joints` (N, n) rad or mm, `spots` (N, d) mm,
    `guessed` (K,) True where the header says where the target is thought to stand.
    """

    robot: Robot
    tool: Tool
    noise: Noise
    parameters: Parameters
    functions: ShotFunctions
    joints: Matrix
    spots: Matrix
    shot_numbers: tuple[int, ...]
    targets: tuple[str, ...]
    target_index: Index
    guessed: NDArray[np.bool_]
    distances: tuple[Distance, ...]

    @classmethod
    def build(
        cls,
        header: Header,
        robot: Robot,
        joints: Matrix,
        targets: Sequence[str],
        spots: Matrix | None = None,
        shot_numbers: Sequence[int] | None = None,
    ) -> Problem:
        """From a header and recorded (or planned) shots; `targets` names the target of each shot."""
        tool = Tool.from_header(header)
        names = tuple(dict.fromkeys(targets))
        return cls(
            robot=robot,
            tool=tool,
            noise=Noise.from_header(header, robot),
            parameters=Parameters.build(robot, tool, header, names),
            functions=shot_functions(robot, tool),
            joints=np.asarray(joints, dtype=float),
            spots=np.zeros((len(joints), tool.miss_size)) if spots is None else spots,
            shot_numbers=tuple(range(len(joints)) if shot_numbers is None else shot_numbers),
            targets=names,
            target_index=np.array([names.index(t) for t in targets], dtype=np.int64),
            guessed=np.array([t in header.targets and header.targets[t].guess_mm is not None for t in names]),
            distances=_distances(header, names),
        )

    @classmethod
    def from_run(cls, run: Run) -> Problem:
        spots = run.spots if run.header.tool.kind == "laser" else None
        numbers = [shot.shot for shot in run.shots]
        targets = [shot.target for shot in run.shots]
        try:
            return cls.build(run.header, run.robot, run.joints, targets, spots, numbers)
        except BadInput as error:
            raise error.at(run.path, run.header_line) from None

    @classmethod
    def from_plan(cls, plan: Plan) -> Problem:
        try:
            return cls.build(plan.header, plan.robot, plan.postures, plan.targets)
        except BadInput as error:
            raise error.at(plan.path, None) from None

    def moved(self, joints: Matrix, spots: Matrix | None = None) -> Problem:
        """The same problem with its shots at other joint positions (and spots)."""
        return replace(self, joints=joints, spots=self.spots if spots is None else spots)

    def select(self, rows: Index) -> Problem:
        """The same unknowns with some of the shots, by their index."""
        return replace(
            self,
            joints=self.joints[rows],
            spots=self.spots[rows],
            target_index=self.target_index[rows],
            shot_numbers=tuple(self.shot_numbers[i] for i in rows),
        )

    # Shapes

    @property
    def shots(self) -> int:
        return len(self.joints)

    @property
    def data_size(self) -> int:
        """Number of residuals: d for each shot, one for each distance."""
        return self.shots * self.tool.miss_size + len(self.distances)

    @cached_property
    def columns(self) -> Index:
        """(N, n + 3 + k): where the columns of each shot's own Jacobian stand among the parameters."""
        n, k = self.robot.n, len(self.tool.parameter_names)
        result = np.empty((self.shots, n + 3 + k), dtype=np.int64)
        result[:, :n] = np.arange(n)
        result[:, n : n + 3] = n + 3 * self.target_index[:, None] + np.arange(3)
        result[:, n + 3 :] = n + 3 * len(self.targets) + np.arange(k)
        return result

    def split(self, x: Matrix) -> tuple[Matrix, Matrix, Matrix]:
        """Offsets (..., n), targets (..., K, 3) and tool (..., k) of parameter vectors (..., p)."""
        n, end = self.robot.n, self.robot.n + 3 * len(self.targets)
        targets = x[..., n:end].reshape(*x.shape[:-1], len(self.targets), 3)
        return x[..., :n], targets, x[..., end:]

    # Misses and Jacobians at one x

    def linearise(
        self, x: Matrix, joints: Matrix | None = None, rows: Index | slice = slice(None)
    ) -> tuple[Matrix, Matrix]:
        """Misses (N, d) mm and each shot's own Jacobian (N, d, n + 3 + k) by delta, its target, tool.

        `joints` takes the place of the recorded ones, `rows` chooses some of the shots.
        """
        delta, targets, tool = self.split(x)
        joints = self.joints[rows] if joints is None else joints
        miss, jacobian = self.functions.kernel("linear", compile=self._many)(
            joints, self.spots[rows], delta, targets[self.target_index[rows]], tool
        )
        return miss, jacobian

    def factors(self, jacobian: Matrix) -> Matrix:
        """(N, d, d) lower Cholesky factors of S_i = J_i diag(joint variances) J_i' + spot variance."""
        by_joints = jacobian[:, :, : self.robot.n]
        variances = self.noise.variances
        covariance = (by_joints * variances[:-1]) @ by_joints.transpose(0, 2, 1)
        covariance += variances[-1] * np.eye(self.tool.miss_size)
        try:
            return np.asarray(np.linalg.cholesky(covariance), dtype=float)
        except np.linalg.LinAlgError as error:
            raise BadInput(
                "the stated noise leaves a direction of some miss without any noise",
                found=f"noise.spot_mm {self.noise.spot:g}",
                allowed="a spot noise above 0 for an arm that moves the miss in too few directions",
                remedy="state noise.spot_mm, the standard deviation of one spot reading in mm",
            ) from error

    def whiten(self, x: Matrix, factor: Matrix | None = None) -> Whitened:
        """Whitened residuals and their scaled Jacobian at x; `factor` keeps the weights of another x."""
        miss, own = self.linearise(x)
        factor = self.factors(own) if factor is None else factor
        d, p = self.tool.miss_size, len(self.parameters)
        scaled = own * self.parameters.prior_std[self.columns][:, None, :]
        stacked = np.linalg.solve(factor, np.concatenate([miss[:, :, None], scaled], axis=2))
        rows = self.shots * d
        jacobian = np.zeros((rows + len(self.distances), p))
        where = np.repeat(self.columns, d, axis=0)
        np.put_along_axis(jacobian[:rows], where, stacked[:, :, 1:].reshape(rows, -1), axis=1)
        distance, by_targets = self._distance_rows(x)
        jacobian[rows:] = by_targets * self.parameters.prior_std
        return Whitened(np.append(stacked[:, :, 0].reshape(-1), distance), jacobian, miss, factor)

    def _distance_rows(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """Whitened distance residuals (D,) and their Jacobian (D, p) by x."""
        residual, jacobian = (
            np.zeros(len(self.distances)),
            np.zeros((len(self.distances), len(self.parameters))),
        )
        _, targets, _ = self.split(x)
        n = self.robot.n
        for row, stated in enumerate(self.distances):
            between = targets[stated.second] - targets[stated.first]
            length = max(float(np.linalg.norm(between)), 1e-9)
            residual[row] = (length - stated.mm) / stated.sigma
            along = between / length / stated.sigma
            jacobian[row, n + 3 * stated.second : n + 3 * stated.second + 3] = along
            jacobian[row, n + 3 * stated.first : n + 3 * stated.first + 3] = -along
        return residual, jacobian

    def nearest_targets(self, delta: Matrix, tool: Matrix) -> Matrix:
        """(K, 3) mm: for each target the point nearest to all its beams (or the mean of the tips).

        Directions that the beams leave open (one beam, parallel beams) stay at the prior mean.
        """
        origin, direction = self.functions.kernel("beam")(self.joints, delta, tool)
        _, start, _ = self.split(self.parameters.prior_mean)
        across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        result = np.empty((len(self.targets), 3))
        for k in range(len(self.targets)):
            mine = self.target_index == k
            weight = across[mine].sum(axis=0) + 1e-9 * np.eye(3)
            pull = (across[mine] @ origin[mine][:, :, None]).sum(axis=0)[:, 0] + 1e-9 * start[k]
            result[k] = np.linalg.solve(weight, pull)
        return result

    def supposed(self) -> Matrix:
        """(p,) what is supposed before any shot: no offsets, the nominal tool, each target at its guess or,
        without one, at the point nearest to its beams."""
        x = self.parameters.prior_mean.copy()
        delta, targets, tool = self.split(x)
        nearest = self.nearest_targets(delta, tool)
        x[self.parameters.group("target")] = np.where(self.guessed[:, None], targets, nearest).reshape(-1)
        return x

    def beams(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """Origins (N, 3) mm and unit directions (N, 3) of the beams in the base frame (eq. 7)."""
        delta, _, tool = self.split(x)
        origin, direction = self.functions.kernel("beam")(self.joints, delta, tool)
        return origin, direction

    # The density

    def log_likelihood(self, x: Matrix) -> Matrix:
        """(W,) log-likelihood of parameter vectors (W, p), with the log det of their own covariance.

        With an estimated noise scale the common factor is integrated out (a Student-t in the misses).
        Values are up to a constant; where a number is not finite the result is -inf.
        """
        quad, logdet = self._shot_sums(x)
        # What overflows or is no number is told by -inf, not by numpy's warnings.
        with np.errstate(all="ignore"):
            if self.noise.estimated:
                quad = self.shots * self.tool.miss_size * np.log(quad)
            value = -(quad + logdet + self._distance_quad(x)) / 2
        return np.where(np.isfinite(value), value, -np.inf)

    def log_prior(self, x: Matrix) -> Matrix:
        """(W,) log of the normal priors of what is not held, up to a constant."""
        z = (x - self.parameters.prior_mean) / self.parameters.prior_std
        value = -(z[:, self.parameters.free] ** 2).sum(axis=1) / 2
        return np.where(np.isnan(value), -np.inf, value)

    def noise_weight(self, x: Matrix) -> float:
        """1 for known noise; where the scale is estimated, the mode of 1 / scale^2 at x (p,)."""
        if not self.noise.estimated:
            return 1.0
        quad, _ = self._shot_sums(x[None, :])
        return self.shots * self.tool.miss_size / float(quad[0])

    def gradient(self, x: Matrix) -> Matrix:
        """(p,) exact gradient of log-likelihood + log-prior by the scaled parameters; 0 where held."""
        delta, targets, tool = self.split(x)
        weight = np.array([self.noise_weight(x)])
        (own,) = self.functions.kernel("score", compile=self._many)(
            self.joints, self.spots, delta, targets[self.target_index], tool, self.noise.variances, weight
        )
        result = np.zeros(len(self.parameters))
        np.add.at(result, self.columns, own)
        residual, jacobian = self._distance_rows(x)
        result -= residual @ jacobian
        scale = self.parameters.prior_std
        result = result * scale - (x - self.parameters.prior_mean) / scale
        return np.where(self.parameters.free, result, 0.0)

    def _shot_sums(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """(W,) sums over the shots of m' S^-1 m and log det S."""
        delta, targets, tool = self.split(x)
        inner = self.shots
        inputs = [
            self._joint_input,
            self._spot_input,
            per_outer(delta, inner),
            selected(targets, self.target_index),
            per_outer(tool, inner),
            self._variance_input,
        ]
        quad, logdet = self.functions.kernel("terms", compile=True).sums(inputs, len(x), inner)
        return quad, logdet

    def _distance_quad(self, x: Matrix) -> Matrix:
        _, targets, _ = self.split(x)
        total = np.zeros(len(x))
        for stated in self.distances:
            length = np.linalg.norm(targets[:, stated.second] - targets[:, stated.first], axis=1)
            total += ((length - stated.mm) / stated.sigma) ** 2
        return total

    # What the kernels need, made when first needed

    @property
    def _many(self) -> bool:
        return self.shots > _COMPILE_FROM

    @cached_property
    def _joint_input(self) -> GridInput:
        return per_inner(self.joints, self.shots)

    @cached_property
    def _spot_input(self) -> GridInput:
        return per_inner(self.spots, self.shots)

    @cached_property
    def _variance_input(self) -> GridInput:
        return constant(self.noise.variances, self.shots)


def _distances(header: Header, targets: Sequence[str]) -> tuple[Distance, ...]:
    check_distances(header, targets, file=None, line=None)
    return tuple(
        Distance(
            targets.index(stated.between[0]), targets.index(stated.between[1]), stated.mm, stated.sigma_mm
        )
        for stated in header.distances
    )
