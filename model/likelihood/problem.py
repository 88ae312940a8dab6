"""The heart: shots, unknowns and noise together, as residuals and exact Jacobians.

A parameter vector x (p,) is in internal units (rad, mm) and in the order of `Parameters`. The
scaled Jacobian is by z = (x - prior mean) / prior std, so that it changes neither with units nor
with the size of a column.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Index, Matrix
from ..errors import BadInput, located
from ..files.run import Run
from ..files.shot import check_distances
from ..instruments.kind import Instrument
from ..kinematics.robot import Robot
from .constraint import ShotFunctions, shot_functions
from .geometry import Geometry
from .noise import NoiseModel
from .parameters import Parameters

if TYPE_CHECKING:
    from ..files.header import Header
    from ..files.plan import Plan


@dataclass(frozen=True)
class Distance:
    """A stated distance between two targets (by their index), mm."""

    first: int
    second: int
    mm: float
    sigma: float


def distances(header: Header, targets: Sequence[str]) -> tuple[Distance, ...]:
    """Those of a header between the `targets` of some measurements; BadInput for one to another target."""
    check_distances(header, targets, file=None, line=None)
    return tuple(
        Distance(
            targets.index(distance.between[0]),
            targets.index(distance.between[1]),
            distance.mm,
            distance.sigma_mm,
        )
        for distance in header.distances
    )


@dataclass(frozen=True)
class ParameterParts:
    """Parameter vectors (..., p) taken apart: `arm` (..., a) what forward kinematics takes (offsets and
    geometry), `targets` (..., K, 3) mm, `tool` (..., k)."""

    arm: Matrix
    targets: Matrix
    tool: Matrix


class Whitened(NamedTuple):
    """Residuals and distances in their own standard deviations at one x, by the roots of the shots' weights.

    `residual` (M,) and `jacobian` (M, p) by scaled parameters, the shots first (d rows each), then the
    distances; `residual_mm` (N, d); `factor` (N, d, d) the lower Cholesky factors of the S_i.
    """

    residual: Matrix
    jacobian: Matrix
    residual_mm: Matrix
    factor: Matrix


@dataclass(frozen=True, eq=False)
class Problem:
    """N shots of one robot and tool at K targets. `joints` (N, n) rad or mm, `spots` (N, d) mm,
    `guessed` (K,) True where the header says where the target is; `weights` (N,) how often each shot counts
    (2: as if it were recorded twice; 1 / kappa: one of kappa that say the same).
    """

    robot: Robot
    tool: Instrument
    noise: NoiseModel
    parameters: Parameters
    functions: ShotFunctions
    joints: Matrix
    spots: Matrix
    shot_numbers: tuple[int, ...]
    targets: tuple[str, ...]
    target_index: Index
    guessed: NDArray[np.bool_]
    distances: tuple[Distance, ...]
    weights: Matrix

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
        tool, noise = instrument(header, robot), NoiseModel.from_header(header, robot)
        geometry = Geometry.from_header(header, robot)
        names = tuple(dict.fromkeys(targets))
        return cls(
            robot=robot,
            tool=tool,
            noise=noise,
            parameters=Parameters.build(robot, tool, noise, geometry, header, names),
            functions=shot_functions(robot, tool, "relative" if noise.separate else "none", geometry),
            joints=np.asarray(joints, dtype=float),
            spots=np.zeros((len(joints), tool.residual_size)) if spots is None else spots,
            shot_numbers=tuple(range(len(joints)) if shot_numbers is None else shot_numbers),
            targets=names,
            target_index=np.array([names.index(t) for t in targets], dtype=np.int64),
            guessed=np.array([t in header.targets and header.targets[t].guess_mm is not None for t in names]),
            distances=distances(header, names),
            weights=np.ones(len(joints)),
        )

    @classmethod
    def from_run(cls, run: Run) -> Problem:
        spots = run.spots if run.header.tool_kind.columns else None
        numbers = [shot.shot for shot in run.shots]
        targets = [shot.met_target for shot in run.shots]
        with located(run.path, run.header_line):
            problem = cls.build(run.header, run.robot, run.joints, targets, spots, numbers)
            return problem._with_enough(run.header)

    @classmethod
    def from_plan(cls, plan: Plan) -> Problem:
        with located(plan.path):
            problem = cls.build(plan.header, plan.robot, plan.postures, plan.called)
            return problem._with_enough(plan.header)

    def _with_enough(self, header: Header) -> Problem:
        """The same; BadInput where the header insists on more parameters than there are numbers for."""
        numbers, others = self.data_size - len(self.tolerated), self.parameters.without_tolerance
        self.geometry.require_enough(header, numbers, self.shots, others)
        return self

    def moved(self, joints: Matrix, spots: Matrix | None = None) -> Problem:
        """The same problem with its shots at other joint positions (and spots)."""
        weights = self.weights if len(joints) == self.shots else np.ones(len(joints))
        return replace(self, joints=joints, spots=self.spots if spots is None else spots, weights=weights)

    def select(self, rows: Index) -> Problem:
        """The same unknowns with some of the shots, by their index."""
        return replace(
            self,
            joints=self.joints[rows],
            spots=self.spots[rows],
            target_index=self.target_index[rows],
            shot_numbers=tuple(self.shot_numbers[i] for i in rows),
            weights=self.weights[rows],
        )

    def weighted(self, weights: Matrix) -> Problem:
        """The same problem in which each shot counts `weights` (N,) times as often as it did."""
        return replace(self, weights=self.weights * weights)

    def without_targets(self, names: Collection[str]) -> Problem:
        """The same problem without some of its targets: their shots, coordinates and distances are gone."""
        kept = [k for k, name in enumerate(self.targets) if name not in names]
        new_index = {k: i for i, k in enumerate(kept)}
        rest = self.select(np.flatnonzero(np.isin(self.target_index, kept)))
        return replace(
            rest,
            parameters=Parameters(
                tuple(
                    item for item in self.parameters.items if item.group != "target" or item.of not in names
                )
            ),
            targets=tuple(self.targets[k] for k in kept),
            target_index=np.array([new_index[k] for k in rest.target_index.tolist()], dtype=np.int64),
            guessed=self.guessed[kept],
            distances=tuple(
                replace(d, first=new_index[d.first], second=new_index[d.second])
                for d in self.distances
                if d.first in new_index and d.second in new_index
            ),
        )

    def with_geometry(self, geometry: Geometry) -> Problem:
        """The same measurements of an arm whose `geometry` is uncertain, in place of the problem's own."""
        kind: Literal["none", "relative"] = "relative" if self.noise.separate else "none"
        return replace(
            self,
            parameters=self.parameters.with_geometry(geometry, self.robot, self.tool),
            functions=shot_functions(self.robot, self.tool, kind, geometry),
        )

    def with_noise_of(self, x: Matrix) -> tuple[Problem, Matrix]:
        """The same problem with the noise as known: that of x (p,); and x without its noise factors."""
        if not self.noise.separate:
            return replace(self, noise=replace(self.noise, estimated=False)), x
        variances = self.variances(x)
        noise = NoiseModel(np.sqrt(variances[:-1]), float(np.sqrt(variances[-1])), estimated=False)
        parameters = self.parameters.without("noise")
        functions = shot_functions(self.robot, self.tool, geometry=self.geometry)
        problem = replace(self, noise=noise, parameters=parameters, functions=functions)
        return problem, x[~self.parameters.group("noise")]

    @property
    def geometry(self) -> Geometry:
        """What of the arm's geometry is uncertain."""
        return self.functions.geometry

    # Shapes

    @property
    def shots(self) -> int:
        return len(self.joints)

    @property
    def measured_size(self) -> int:
        """Number of residuals: d for each shot (as often as it counts), one for each distance."""
        return round(float(self.weights.sum()) * self.tool.residual_size) + len(self.distances)

    @property
    def data_size(self) -> int:
        """The same, and one for each parameter of geometry or tool of which the tolerance is knowledge like a
        measurement."""
        return self.measured_size + len(self.tolerated)

    @cached_property
    def tolerated(self) -> Index:
        """Places among the parameters of those that are estimated within a stated tolerance: of the geometry,
        of a calibrated tool."""
        return np.flatnonzero(self.parameters.tolerated)

    @property
    def noise_estimable(self) -> bool:
        """Whether the noise is known, or there are more numbers than unknowns to estimate it from.

        Where the geometry can bring all residuals to 0, their scale has no estimate, whatever the tolerances.
        """
        free = int(self.parameters.free.sum())
        if not self.noise.estimated or self.data_size <= free or self.measured_size > free:
            return self.noise.known or self.data_size > free
        jacobian = self.whiten(self.parameters.prior_mean).jacobian[:, self.parameters.free]
        return int(np.linalg.matrix_rank(jacobian)) < self.measured_size

    @cached_property
    def columns(self) -> Index:
        """(N, c): the places of the c columns of each shot's own Jacobian among the parameters."""
        by_target = [self.parameters.of_shot(k, noise=False) for k in range(len(self.targets))]
        return np.asarray(np.stack(by_target)[self.target_index])

    def split(self, x: Matrix) -> ParameterParts:
        """The parts of parameter vectors (..., p)."""
        parameters = self.parameters
        targets = x[..., parameters.block("target")].reshape(*x.shape[:-1], len(self.targets), 3)
        return ParameterParts(x[..., parameters.arm], targets, x[..., parameters.block("tool")])

    def variances(self, x: Matrix) -> Matrix:
        """(..., n + 1) of joints and spot at parameter vectors (..., p), or (n + 1,) as stated."""
        if not self.noise.separate:
            return self.noise.variances
        with np.errstate(over="ignore"):  # what overflows is -inf in the density
            factors = np.exp(2 * x[..., self.parameters.block("noise")])
        joints = np.repeat(factors[..., :1], self.robot.n, axis=-1)
        return np.concatenate([joints, factors[..., 1:]], axis=-1) * self.noise.variances

    def noise_information(self, x: Matrix, jacobian: Matrix, factor: Matrix) -> Matrix:
        """(2, 2) the information of the residuals' scatter on the logarithms of the two noise factors at x.

        Of a normal's covariance: tr(S^-1 dS_a S^-1 dS_b) / 2 (`jacobian` and `factor` as of `linearise`
        and `factors`).
        """
        variances = self.variances(x)
        by_joints = self.by_joints(jacobian)
        halves = []
        joint = (by_joints * variances[:-1]) @ by_joints.transpose(0, 2, 1)
        spot = np.broadcast_to(variances[-1] * np.eye(self.tool.residual_size), joint.shape)
        for part in (joint, spot):
            half = np.linalg.solve(factor, 2 * part)
            halves.append(np.linalg.solve(factor, half.transpose(0, 2, 1)))
        return np.array([[np.einsum("i,iab,iab->", self.weights, a, b) / 2 for b in halves] for a in halves])

    # Residuals and Jacobians at one x

    def by_joints(self, jacobian: Matrix) -> Matrix:
        """(N, d, n) the columns by the joint positions of the shots' own Jacobians (N, d, c).

        Positions and offsets enter as their sums alone: they are the columns by the offsets. (Where gravity
        and harmonics count, their slopes by the positions, some 1e-3 of it, are left out.)
        """
        return jacobian[:, :, self.parameters.in_shot("offset")]

    def linearise(
        self, x: Matrix, joints: Matrix | None = None, rows: Index | slice = slice(None)
    ) -> tuple[Matrix, Matrix]:
        """Residuals (N, d) mm and each shot's own Jacobian (N, d, c) by what it depends on (`columns`).

        `x` is (p,), or (shots, p) with parameters of its own for every shot of the problem. `joints` takes
        the place of the recorded ones, `rows` chooses some of the shots.
        """
        parts = self.split(x if x.ndim == 1 else x[rows])
        joints = self.joints[rows] if joints is None else joints
        if x.ndim == 1:
            own_target = parts.targets[self.target_index[rows]]
        else:
            own_target = parts.targets[np.arange(len(parts.targets)), self.target_index[rows]]
        residual, jacobian = self.functions.kernel("linear")(
            joints, self.spots[rows], parts.arm, own_target, parts.tool
        )
        return residual, jacobian

    def factors(self, x: Matrix, jacobian: Matrix) -> Matrix:
        """(N, d, d) lower Cholesky factors of S_i = J_i diag(joint variances) J_i' + spot variance."""
        by_joints = self.by_joints(jacobian)
        variances = self.variances(x)
        covariance = (by_joints * variances[:-1]) @ by_joints.transpose(0, 2, 1)
        covariance += variances[-1] * np.eye(self.tool.residual_size)
        try:
            return np.asarray(np.linalg.cholesky(covariance), dtype=float)
        except np.linalg.LinAlgError as error:
            raise BadInput(
                "the stated noise leaves a direction of some residual without any noise",
                found=f"noise.spot_mm {self.noise.spot:g}",
                allowed="a spot noise above 0 for an arm that moves the residual in too few directions",
                remedy="state noise.spot_mm, the standard deviation of one spot reading in mm",
            ) from error

    def whiten(self, x: Matrix, factor: Matrix | None = None) -> Whitened:
        """Whitened residuals and their scaled Jacobian at x; `factor` keeps the weights of another x."""
        residual, shot_jacobians = self.linearise(x)
        factor = self.factors(x, shot_jacobians) if factor is None else factor
        d, p = self.tool.residual_size, len(self.parameters)
        scaled = shot_jacobians * self.parameters.prior_std[self.columns][:, None, :]
        stacked = np.linalg.solve(factor, np.concatenate([residual[:, :, None], scaled], axis=2))
        stacked *= np.sqrt(self.weights)[:, None, None]
        rows = self.shots * d
        jacobian = np.zeros((rows + len(self.distances), p))
        where = np.repeat(self.columns, d, axis=0)
        np.put_along_axis(jacobian[:rows], where, stacked[:, :, 1:].reshape(rows, where.shape[1]), axis=1)
        distance, by_targets = self.distance_rows(x[None])
        jacobian[rows:] = by_targets[0] * self.parameters.prior_std
        return Whitened(np.append(stacked[:, :, 0].reshape(-1), distance[0]), jacobian, residual, factor)

    def distance_rows(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """Whitened distance residuals (W, D) of parameter vectors (W, p), their Jacobian (W, D, p) by x."""
        residual = np.zeros((len(x), len(self.distances)))
        jacobian = np.zeros((*residual.shape, len(self.parameters)))
        targets, block = self.split(x).targets, self.parameters.block
        for row, distance in enumerate(self.distances):
            between = targets[:, distance.second] - targets[:, distance.first]
            length = np.maximum(np.linalg.norm(between, axis=1), 1e-9)
            residual[:, row] = (length - distance.mm) / distance.sigma
            along = between / length[:, None] / distance.sigma
            jacobian[:, row, block("target", distance.second)] = along
            jacobian[:, row, block("target", distance.first)] = -along
        return residual, jacobian

    def roots(self, whitened: Whitened) -> Matrix:
        """(N, d, f) each shot's whitened Jacobian by the free parameters: its information is their square."""
        d = self.tool.residual_size
        jacobian = whitened.jacobian[: self.shots * d, self.parameters.free]
        return np.asarray(jacobian.reshape(self.shots, d, -1))

    def nearest_targets(self, arm: Matrix, tool: Matrix, joints: Matrix | None = None) -> Matrix:
        """(W, K, 3) mm: for each target the point nearest to all its beams (or the mean of the tips).

        `arm` (W, a), `tool` (W, k) and the recorded `joints` (W, N, n), the problem's own by default.
        Directions that the beams leave open (one beam, parallel beams) stay at the prior mean.
        """
        origin, direction = self._beams(arm, tool, self.joints[None] if joints is None else joints)
        start = self.split(self.parameters.prior_mean).targets
        across = np.eye(3) - direction[..., :, None] * direction[..., None, :]
        result = np.empty((len(arm), len(self.targets), 3))
        for k in range(len(self.targets)):
            mine = self.target_index == k
            weight = across[:, mine].sum(axis=1) + 1e-9 * np.eye(3)
            pull = (across[:, mine] @ origin[:, mine][..., None]).sum(axis=1) + 1e-9 * start[k][:, None]
            result[:, k] = np.linalg.solve(weight, pull)[..., 0]
        return result

    def nominal(self) -> Matrix:
        """(p,) the nominal parameters, before any shot: no offsets, the nominal tool, each target at its
        guess or, without one, at the point nearest to its beams."""
        x = self.parameters.prior_mean.copy()
        parts = self.split(x)
        nearest = self.nearest_targets(parts.arm[None], parts.tool[None])[0]
        targets = np.where(self.guessed[:, None], parts.targets, nearest)
        x[self.parameters.block("target")] = targets.reshape(-1)
        return x

    def beams(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """Origins (N, 3) mm and unit directions (N, 3) of the beams in the base frame (eq. 7); `x` as for
        `linearise`."""
        parts = self.split(x)
        origin, direction = self.functions.kernel("beam")(self.joints, parts.arm, parts.tool)
        return origin, direction

    def _beams(self, arm: Matrix, tool: Matrix, joints: Matrix) -> tuple[Matrix, Matrix]:
        """(W, N, 3) each, of arms (W, a), tools (W, k) and recorded joints (W or 1, N, n)."""
        rows, shots = len(arm), self.shots
        origin, direction = self.functions.kernel("beam")(
            np.broadcast_to(joints, (rows, shots, self.robot.n)).reshape(rows * shots, -1),
            np.repeat(arm, shots, axis=0),
            np.repeat(tool, shots, axis=0),
        )
        return origin.reshape(rows, shots, 3), direction.reshape(rows, shots, 3)


def instrument(header: Header, robot: Robot) -> Instrument:
    """That on the flange, as a header states it.

    The sigma of a tool that is not calibrated is knowledge, as that of a calibrated one is, where it is
    stated and the last joint's offset, which the tool would take up, is to be estimated by it.
    """
    estimated = header.held is not None and f"delta{robot.n}" not in header.held
    known = estimated and "sigma" in header.stated_tool.model_fields_set
    return header.tool_kind.of("tool", header.stated_tool, exact=header.arm is None, sigma_known=known)


def rms_length(residual: Matrix) -> float:
    """Root mean square length of residuals (N, d), mm."""
    return float(np.sqrt((residual**2).sum(axis=1).mean()))
