"""The heart: shots, unknowns and noise together, as residuals and exact Jacobians.

A parameter vector x (p,) is in internal units (rad, mm) and in the order of `Parameters`. The
scaled Jacobian is by z = (x - prior mean) / prior std, so that it changes neither with units nor
with the size of a column.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Index, Mask, Matrix
from ..errors import BadInput, located
from ..files.run import Run
from ..files.stated_workspace import CENTRAL_RANGES, StatedWorkspace
from ..instruments.kind import Instrument, Measurement
from ..instruments.together import Part, Together
from ..kinematics.robot import Robot
from .constraint import ShotFunctions, shot_functions
from .geometry import Geometry
from .noise import NoiseModel
from .parameters import Angle, Distance, Parameters, Tie, ties

if TYPE_CHECKING:
    from ..files.header import Header
    from ..files.plan import Plan


@dataclass(frozen=True)
class ParameterParts:
    """Parameter vectors (..., p) taken apart: `arm` (..., a) what forward kinematics takes (offsets and
    geometry), `targets` (..., K, 3), zeros of stations, `tool` (..., k) that of tool and frames."""

    arm: Matrix
    targets: Matrix
    tool: Matrix


class Whitened(NamedTuple):
    """Residuals and ties in their own standard deviations at one x, by the roots of the shots' weights.

    `residual` (M,) and `jacobian` (M, p) by scaled parameters, the shots first (d rows each), then the
    ties; `residual_mm` (N, d); `factor` (N, d, d) the lower Cholesky factors of the S_i.
    """

    residual: Matrix
    jacobian: Matrix
    residual_mm: Matrix
    factor: Matrix


@dataclass(frozen=True, eq=False)
class Problem:
    """N shots of one robot and tool at K targets, the stations last: instruments that have none.

    `joints` (N, n) rad or mm; `spots` (N, d) mm, what each residual is less; `readings` (N, w) as read; and
    `guessed` (K,) True where the header says where the target is; `weights` (N,) how often each shot counts
    (2: as if it were recorded twice; 1 / kappa: one of kappa that say the same). Of `planned` ones nothing
    was read yet. `in_turn`: their times say that they were recorded as they stand here, whatever their
    numbers. `workspace` is the region that the header states for the error of the TCP.
    """

    robot: Robot
    tool: Instrument
    noise: NoiseModel
    parameters: Parameters
    functions: ShotFunctions
    joints: Matrix
    spots: Matrix
    readings: Matrix
    shot_numbers: tuple[int, ...]
    targets: tuple[str, ...]
    target_index: Index
    guessed: NDArray[np.bool_]
    ties: tuple[Tie, ...]
    weights: Matrix
    planned: bool = False
    in_turn: bool = False
    workspace: StatedWorkspace = CENTRAL_RANGES

    def __repr__(self) -> str:
        count, free = self.shots, int(self.parameters.free.sum())
        noun = "measurement" if count == 1 else "measurements"
        return (
            f"<Problem: {count} {noun}, {free} of {len(self.parameters)} parameters free, {self.robot.name}>"
        )

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
        """From a header whose one tool meets a target at every shot, recorded or planned; `targets` names
        the target of each shot."""
        header.require_tool()
        tool = header.made(header.labels[0], robot.n)
        nothing = np.zeros((len(joints), tool.residual_size))
        spots, readings = nothing if spots is None else spots, np.zeros((len(joints), tool.reading_size))
        of_target = dict.fromkeys(targets, tool)
        return cls._of(header, robot, joints, tool, of_target, targets, spots, readings, shot_numbers)

    @classmethod
    def of_measured(
        cls,
        header: Header,
        robot: Robot,
        joints: Matrix,
        measured: Sequence[Sequence[Measurement]],
        shot_numbers: Sequence[int] | None = None,
        *,
        planned: bool = False,
    ) -> Problem:
        """From a header and (N,) what is measured at each of the recorded (or planned) `joints` (N, n)."""
        every = [item for some in measured for item in some]
        instruments = tuple(
            header.made(label, robot.n).with_variants(
                {item.variant for item in every if item.instrument == label}
            )
            for label in dict.fromkeys(item.instrument for item in every)
        )
        labels = [each.label for each in instruments]
        parts = dict.fromkeys(Part(labels.index(item.instrument), item.variant) for item in every)
        tool: Instrument = instruments[0]
        if len(instruments) > 1 or len(tool.variants) > 1:
            tool = Together("", instruments, tuple(parts))
        of_target: dict[str, Instrument] = {}
        for item in every:
            if item.target is not None:
                of_target.setdefault(item.target, instruments[labels.index(item.instrument)])
        belongs = list(map(_belongs_to, measured))
        spots, readings = _rows(header, tool, measured, belongs)
        problem = cls._of(header, robot, joints, tool, of_target, belongs, spots, readings, shot_numbers)
        return replace(problem, planned=planned)

    @classmethod
    def _of(
        cls,
        header: Header,
        robot: Robot,
        joints: Matrix,
        tool: Instrument,
        of_target: Mapping[str, Instrument],
        belongs: Sequence[str],
        spots: Matrix,
        readings: Matrix,
        shot_numbers: Sequence[int] | None,
    ) -> Problem:
        """Of shots that each belong to a target, measured by an instrument, or to a station."""
        noise = NoiseModel.from_header(header, robot, tool)
        geometry = Geometry.from_header(header, robot)
        index = {name: k for k, name in enumerate(dict.fromkeys([*of_target, *belongs]))}
        return cls(
            robot=robot,
            tool=tool,
            noise=noise,
            parameters=Parameters.build(robot, tool, noise, geometry, header, of_target),
            functions=shot_functions(robot, tool, noise.log_det, geometry, noise.of_factor),
            joints=np.asarray(joints, dtype=float),
            spots=spots,
            readings=readings,
            shot_numbers=tuple(range(len(joints)) if shot_numbers is None else shot_numbers),
            targets=tuple(index),
            target_index=np.array([index[name] for name in belongs], dtype=np.int64),
            guessed=np.array([t in header.targets and header.targets[t].guess_mm is not None for t in index]),
            ties=ties(header, tuple(index)),
            weights=np.ones(len(joints)),
            workspace=header.workspace,
        )

    @classmethod
    def from_run(cls, run: Run) -> Problem:
        with located(run.path, run.header_line):
            problem = cls._recorded(run)
            times = [shot.time_s for shot in run.shots]
            in_turn = all(a is not None and b is not None and a < b for a, b in pairwise(times))
            return replace(problem, in_turn=in_turn)._with_enough(run.header)

    @classmethod
    def _recorded(cls, run: Run) -> Problem:
        tools = len(run.header.labels) == 1 and run.header.only_tools
        if tools and all(shot.posture is None for shot in run.shots):  # there may be a million of them
            spots = run.spots if run.header.instrument.columns else None
            numbers, targets = [shot.shot for shot in run.shots], [shot.met_target for shot in run.shots]
            return cls.build(run.header, run.robot, run.joints, targets, spots, numbers)
        rows, measured = by_posture(run.measurements)
        numbers = [run.shots[i].shot for i in rows]
        return cls.of_measured(run.header, run.robot, run.joints[rows], measured, numbers)

    @classmethod
    def from_plan(cls, plan: Plan) -> Problem:
        with located(plan.path):
            rows, measured = by_posture(plan.measurements)
            problem = cls.of_measured(
                plan.header, plan.robot, plan.postures[rows], measured, rows, planned=True
            )
            if problem.tool.reading_size:
                problem._require_guesses()
                problem = problem.at_predicted(problem.nominal())
            return problem._with_enough(plan.header)

    def _require_guesses(self) -> None:
        """BadInput for a target of a plan of which the postures say nothing: it is read from anywhere."""
        for k, name in enumerate(self.targets[: len(self.targets) - self.stations]):
            if not self.guessed[k] and not self.met[self.target_index == k].any():
                raise BadInput(
                    "a plan needs to know about where its target is",
                    found=f"the target {name} without guess_mm",
                    remedy=f"state targets.{name}.guess_mm, as measured roughly in the base frame",
                )

    def _with_enough(self, header: Header) -> Problem:
        """The same; BadInput where the header insists on more parameters than there are numbers for."""
        numbers, others = self.data_size - len(self.tolerated), self.parameters.without_tolerance
        self.geometry.require_enough(header, numbers, self.shots, others)
        return self

    def moved(self, joints: Matrix, spots: Matrix | None = None) -> Problem:
        """The same problem with its shots at other joint positions (and spots)."""
        weights = self.weights if len(joints) == self.shots else np.ones(len(joints))
        return replace(self, joints=joints, spots=self.spots if spots is None else spots, weights=weights)

    def recorded_at(
        self,
        joints: Matrix,
        measured: Sequence[Sequence[Measurement]],
        shot_numbers: Sequence[int],
        header: Header,
    ) -> Problem:
        """The same unknowns with other recorded `joints` (M, n), and (M,) what was measured at each."""
        belongs = list(map(_belongs_to, measured))
        spots, readings = _rows(header, self.tool, measured, belongs)
        index = [self.targets.index(name) for name in belongs]
        return replace(
            self,
            joints=joints,
            spots=spots,
            readings=readings,
            target_index=np.array(index, dtype=np.int64),
            shot_numbers=tuple(shot_numbers),
            weights=np.ones(len(joints)),
            planned=False,
        )

    def select(self, rows: Index) -> Problem:
        """The same unknowns with some of the shots, by their index."""
        return replace(
            self,
            joints=self.joints[rows],
            spots=self.spots[rows],
            readings=self.readings[rows],
            target_index=self.target_index[rows],
            shot_numbers=tuple(self.shot_numbers[i] for i in rows),
            weights=self.weights[rows],
        )

    def weighted(self, weights: Matrix) -> Problem:
        """The same problem in which each shot counts `weights` (N,) times as often as it did."""
        return replace(self, weights=self.weights * weights)

    def without_targets(self, names: Collection[str]) -> Problem:
        """The same problem without some of its targets: their shots, coordinates and ties are gone."""
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
            ties=tuple(
                replace(tie, first=new_index[tie.first], second=new_index[tie.second])
                for tie in self.ties
                if tie.first in new_index and tie.second in new_index
            ),
        )

    def with_geometry(self, geometry: Geometry) -> Problem:
        """The same measurements of an arm whose `geometry` is uncertain, in place of the problem's own."""
        noise = self.noise
        return replace(
            self,
            parameters=self.parameters.with_geometry(geometry, self.robot, self.tool),
            functions=shot_functions(self.robot, self.tool, noise.log_det, geometry, noise.of_factor),
        )

    def freed(self, x: Matrix, *, keep_stated: bool) -> tuple[Problem, Matrix]:
        """The same measurements by a tool and frames that may be anything, but for what the header states if
        that is kept; and x (p,) with the values of what is unknown then."""
        tool, values = self.tool.freed()
        kept = {
            f"{unknown.of}.{unknown.axis}"
            for unknown in tool.unknowns
            if unknown.tolerated and not unknown.assumed
        }
        parameters = self.parameters.with_instrument(tool, keeping=kept if keep_stated else ())
        functions = self.functions
        if tool is not self.tool:
            noise = self.noise
            functions = shot_functions(self.robot, tool, noise.log_det, self.geometry, noise.of_factor)
        there = parameters.with_values(parameters.prior_mean, self.parameters, x)
        for name, value in values.items():
            there[parameters.index(name)] = value
        return replace(self, tool=tool, parameters=parameters, functions=functions), there

    def with_noise_of(self, x: Matrix) -> tuple[Problem, Matrix]:
        """The same problem with the noise as known: that of x (p,); and x without its noise factors."""
        if not self.noise.separate:
            return replace(self, noise=replace(self.noise, estimated=False)), x
        variances = self.variances(x)
        n = self.robot.n
        noise = NoiseModel(np.sqrt(variances[:n]), np.sqrt(variances[n:]), estimated=False)
        parameters = self.parameters.without("noise")
        functions = shot_functions(self.robot, self.tool, geometry=self.geometry)
        problem = replace(self, noise=noise, parameters=parameters, functions=functions)
        return problem, x[~self.parameters.group("noise")]

    @property
    def geometry(self) -> Geometry:
        """What of the arm's geometry is uncertain."""
        return self.functions.geometry

    @property
    def distances(self) -> tuple[Distance, ...]:
        """The ties between points."""
        return tuple(tie for tie in self.ties if isinstance(tie, Distance))

    @property
    def angles(self) -> tuple[Angle, ...]:
        """The ties between planes."""
        return tuple(tie for tie in self.ties if isinstance(tie, Angle))

    # Shapes

    @property
    def shots(self) -> int:
        return len(self.joints)

    @property
    def order(self) -> Index:
        """(N,) the measurements as time goes: where it is not known by their numbers."""
        return np.arange(self.shots) if self.in_turn else np.argsort(self.shot_numbers, kind="stable")

    @cached_property
    def active(self) -> Matrix:
        """(N, d) 1 for each component of a residual that was read, else 0."""
        return self._read(self.tool.layout.active)

    @cached_property
    def met(self) -> Matrix:
        """(N, d) 1 for each component that the joints are turned to bring to zero, else 0."""
        met = np.array([each.met for each in self.tool.each], dtype=float)
        return np.asarray(self.active * met[self.tool.layout.source])

    @cached_property
    def by_beam(self) -> NDArray[np.bool_]:
        """(N,) whether a beam reads there."""
        beams = np.array([each.beam for each in self.tool.each], dtype=float)
        return np.asarray((self.active * beams[self.tool.layout.source]).any(axis=1))

    @cached_property
    def sizes(self) -> Matrix:
        """(N,) how many components of each residual were read."""
        return np.asarray(self.active.sum(axis=1))

    @cached_property
    def _length_parts(self) -> tuple[Matrix, Matrix]:
        """(d,) 1 for each component of a residual that is a length, else 0; (N,) lengths that were read."""
        parts = self.tool.lengths
        of_length = np.zeros(self.tool.residual_size)
        of_length[[k for part in parts for k in part]] = 1.0
        return of_length, np.asarray(self.active[:, [part[0] for part in parts]].sum(axis=1))

    @property
    def length_components(self) -> Mask:
        """(N, d) True for each component of a residual that is a length and was read."""
        return np.asarray(self.active * self._length_parts[0] > 0)

    def length_squares(self, squares: Matrix) -> Matrix:
        """(N,) mm² the squared length of a residual, by `squares` (N, d) of its components: of several
        readings at one posture their mean, without what is an angle."""
        of_length, count = self._length_parts
        return np.asarray((squares * (self.active * of_length)).sum(axis=1) / count)

    def length_mm(self, residual: Matrix) -> Matrix:
        """(N,) the length of residuals (N, d), as `length_squares` takes it."""
        return np.asarray(np.sqrt(self.length_squares(residual**2)))

    def rms_mm(self, residual: Matrix) -> float:
        """Root mean square length of residuals (N, d)."""
        return float(np.sqrt(self.length_squares(residual**2).mean()))

    def rms_deg(self, residual: Matrix) -> float | None:
        """Root mean square angle of the rotations among residuals (N, d); None where no angle is read."""
        return self.angle_deg(residual**2)

    def angle_deg(self, squares: Matrix) -> float | None:
        """Degrees: the root mean square angle by `squares` (N, d) of components; None where none is read."""
        angles = self.active * (1 - self._length_parts[0])
        read = angles.any(axis=1)
        if not read.any():
            return None
        return float(np.degrees(np.sqrt((squares[read] * angles[read]).sum(axis=1).mean())))

    def read_components(self, row: int, residual: Matrix) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Of the residual (d,) of a measurement what was read of it: lengths, mm, and angles, deg."""
        read, of_length = self.active[row] > 0, self._length_parts[0] > 0
        angles = np.degrees(residual[read & ~of_length])
        return tuple(residual[read & of_length].tolist()), tuple(angles.tolist())

    @property
    def measured_size(self) -> int:
        """Number of residuals: those of each shot (as often as it counts), one for each tie."""
        return round(float(self.weights @ self.sizes)) + len(self.ties)

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
        real = len(self.targets) - self.stations
        targets = x[..., parameters.block("target")].reshape(*x.shape[:-1], real, 3)
        if self.stations:
            nothing = np.zeros((*x.shape[:-1], self.stations, 3))
            targets = np.concatenate([targets, nothing], axis=-2)
        return ParameterParts(x[..., parameters.arm], targets, x[..., parameters.instrument])

    @cached_property
    def stations(self) -> int:
        """How many of the targets are none."""
        return len(self.targets) - int(self.parameters.group("target").sum()) // 3

    def is_station(self, target: str) -> bool:
        """Whether it is no target, but an instrument that has none."""
        return target in self.targets[len(self.targets) - self.stations :]

    def variances(self, x: Matrix) -> Matrix:
        """(..., n + I) of joints and readings at parameter vectors (..., p), or (n + I,) as stated."""
        if not self.noise.separate:
            return self.noise.variances
        with np.errstate(over="ignore"):  # what overflows is -inf in the density
            factors = np.exp(2 * x[..., self.parameters.block("noise")])[..., list(self.noise.of_factor)]
        joints = np.repeat(factors[..., :1], self.robot.n, axis=-1)
        return np.concatenate([joints, factors[..., 1:]], axis=-1) * self.noise.variances

    def of_sources(self, variances: Matrix) -> Matrix:
        """(I, N, d) what each noise of the readings adds to the variance of a component, from `variances`
        (n + I,)."""
        return np.asarray(self._unit_variances * variances[self.robot.n :][:, None, None])

    @cached_property
    def _unit_variances(self) -> Matrix:
        """(I, N, d) the same of noises whose variance is 1."""
        layout, count = self.tool.layout, len(self.tool.noises)
        unit = self.active * self._read(layout.relative) ** 2
        by_source = np.equal(layout.noise, np.arange(count)[:, None])
        return np.asarray(by_source[:, None, :] * unit)

    def _read(self, columns: Index) -> Matrix:
        """(N, d) numbers of the readings by their `columns` (d,), 1 where that is -1."""
        padded = np.hstack([self.readings, np.ones((self.shots, 1))])
        return np.asarray(padded[:, columns])

    def covariances(self, by_joints: Matrix, variances: Matrix) -> Matrix:
        """(N, d, d) of the residuals, by their Jacobian (N, d, n) and `variances` (n + I,); 1 for each
        component that was not read."""
        result = (by_joints * variances[: self.robot.n]) @ by_joints.transpose(0, 2, 1)
        diagonal = self.of_sources(variances).sum(axis=0) + 1 - self.active
        d = diagonal.shape[1]
        result.reshape(len(result), d * d)[:, :: d + 1] += diagonal
        return np.asarray(result)

    def noise_information(self, x: Matrix, jacobian: Matrix, factor: Matrix) -> Matrix:
        """(g, g) the information of the residuals' scatter on the logarithms of the noise factors.

        Of a normal's covariance: tr(S^-1 dS_a S^-1 dS_b) / 2 (`jacobian` and `factor` as of `linearise`
        and `factors`).
        """
        variances = self.variances(x)
        by_joints = self.by_joints(jacobian)
        halves = []
        joint = (by_joints * variances[: self.robot.n]) @ by_joints.transpose(0, 2, 1)
        unit = np.eye(self.tool.residual_size)
        parts = (joint, *(each[:, :, None] * unit for each in self.of_sources(variances)))
        of_factor = self.noise.of_factor
        for k in range(len(self.noise.factors)):
            part = sum(each for each, of in zip(parts, of_factor, strict=True) if of == k)
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
        if self.tool.target_is == "nothing":
            own_target = own_target[:, :0]
        residual, jacobian = self.functions.kernel("linear")(
            joints, self.data[rows], parts.arm, own_target, parts.tool
        )
        d = self.tool.residual_size
        return residual.reshape(len(joints), d), jacobian.reshape(len(joints), d, jacobian.shape[-1])

    @cached_property
    def data(self) -> Matrix:
        """(N, d + w) spots and readings, as the functions of a shot take them."""
        return np.hstack([self.spots, self.readings]) if self.tool.reading_size else self.spots

    def factors(self, x: Matrix, jacobian: Matrix) -> Matrix:
        """(N, d, d) lower Cholesky factors of S_i = J_i diag(joint variances) J_i' + spot variance."""
        by_joints = self.by_joints(jacobian)
        covariance = self.covariances(by_joints, self.variances(x))
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
        jacobian = np.zeros((rows + len(self.ties), p))
        where = np.repeat(self.columns, d, axis=0)
        np.put_along_axis(jacobian[:rows], where, stacked[:, :, 1:].reshape(rows, where.shape[1]), axis=1)
        tied, by_targets = self.tie_rows(x[None])
        jacobian[rows:] = by_targets[0] * self.parameters.prior_std
        return Whitened(np.append(stacked[:, :, 0].reshape(-1), tied[0]), jacobian, residual, factor)

    def tie_rows(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """Whitened residuals of ties (W, T) at parameter vectors (W, p), their Jacobian (W, T, p) by x."""
        residual = np.zeros((len(x), len(self.ties)))
        jacobian = np.zeros((*residual.shape, len(self.parameters)))
        targets, block = self.split(x).targets, self.parameters.block
        for row, tie in enumerate(self.ties):
            residual[:, row], by_first, by_second = tie.missed(targets[:, tie.first], targets[:, tie.second])
            jacobian[:, row, block("target", tie.first)] = by_first
            jacobian[:, row, block("target", tie.second)] = by_second
        return residual, jacobian

    def roots(self, whitened: Whitened) -> Matrix:
        """(N, d, f) each shot's whitened Jacobian by the free parameters: its information is their square."""
        d = self.tool.residual_size
        jacobian = whitened.jacobian[: self.shots * d, self.parameters.free]
        return np.asarray(jacobian.reshape(self.shots, d, -1))

    def started(self, x: Matrix, joints: Matrix | None = None) -> Matrix:
        """(W, p) x with what is only guessed solved for, of each row with its offsets: frames and tools, and
        each target that is not held. `joints` (W, N, n) as recorded, the problem's own by default."""
        x, parameters = x.copy(), self.parameters
        if self.recorded:
            self._start_instruments(x, self.joints[None] if joints is None else joints)
        targets = parameters.group("target") & parameters.free
        x[:, targets] = self.nearest_targets(x, joints)[:, targets[parameters.block("target")]]
        return x

    def _start_instruments(self, x: Matrix, joints: Matrix) -> None:
        variants = self.tool.variants[:1] * self.shots
        for row, point in enumerate(x):
            parts, poses = self.split(point), self.poses(point, joints[row % len(joints)])
            started = self.tool.start_unknowns(poses, self.readings, parts.tool, variants)
            free = self.parameters.free[self.parameters.instrument]
            x[row, self.parameters.instrument] = np.where(free, started, parts.tool)

    def poses(self, x: Matrix, joints: Matrix | None = None) -> Matrix:
        """(N, 4, 4) the flange in the base frame at x (p,); `joints` (N, n), the problem's own by default."""
        joints = self.joints if joints is None else joints
        (upper,) = self.functions.kernel("flange")(joints, self.split(x).arm)
        result = np.tile(np.eye(4), (len(joints), 1, 1))
        result[:, :3] = upper
        return result

    def nearest_targets(self, x: Matrix, joints: Matrix | None = None) -> Matrix:
        """(W, 3 K) coordinates of each target from its own measurements alone, at x (W, p): the point nearest
        to all beams, the mean of the tips, or as the instrument knows.

        Directions that the beams leave open (one beam, parallel beams) stay at the prior mean. `joints`
        (W, N, n) as recorded, the problem's own by default.
        """
        joints = self.joints[None] if joints is None else joints
        parts, real = self.split(x), len(self.targets) - self.stations
        result = self._nearest_to_rays(parts, joints)
        for k in range(real if self.tool.reading_size else 0):
            mine = self.target_index == k
            if not mine.any() or (self.planned and not self.met[mine].any()):
                continue
            for row, point in enumerate(x):
                poses = self.poses(point, joints[row % len(joints)][mine])
                known = self.tool.start_target(poses, self.readings[mine], parts.tool[row])
                if known is not None:
                    result[row, k] = known
        return result.reshape(len(x), 3 * real)

    def _nearest_to_rays(self, parts: ParameterParts, joints: Matrix) -> Matrix:
        """(W, K, 3) of each target the point nearest to its beams, at recorded `joints` (W or 1, N, n)."""
        start = self.split(self.parameters.prior_mean).targets
        rows, shots = len(parts.arm), self.shots
        of_each = (parts.arm, parts.tool)
        if rows == 1:
            arm, tool = (part[0] for part in of_each)
        else:
            arm, tool = (np.repeat(part, shots, axis=0) for part in of_each)
            joints = np.broadcast_to(joints, (rows, shots, self.robot.n))
        beams = self.functions.kernel("beam")(joints.reshape(rows * shots, -1), arm, tool)
        origin, direction = (part.reshape(rows, shots, 3) for part in beams)
        across = np.eye(3) - direction[..., :, None] * direction[..., None, :]
        result = np.empty((len(parts.arm), len(self.targets) - self.stations, 3))
        for k in range(result.shape[1]):
            mine = self.target_index == k
            weight = across[:, mine].sum(axis=1) + 1e-9 * np.eye(3)
            pull = (across[:, mine] @ origin[:, mine][..., None]).sum(axis=1) + 1e-9 * start[k][:, None]
            result[:, k] = np.linalg.solve(weight, pull)[..., 0]
        return result

    @property
    def recorded(self) -> bool:
        """Whether instruments have read what a start can be found from; a plan's have not."""
        return bool(self.tool.reading_size) and not self.planned

    def nominal(self) -> Matrix:
        """(p,) the nominal parameters, before any shot: no offsets, the nominal tool, each target at its
        guess or, without one, as its measurements say; so too a frame that is free (of a plan: about where
        its instrument stands)."""
        x = self.parameters.prior_mean[None].copy()
        x[0, self.parameters.block("frame")] = self.tool.stands_at
        if self.recorded:
            self._start_instruments(x, self.joints[None])
        block, real = self.parameters.block("target"), len(self.targets) - self.stations
        guessed = np.repeat(self.guessed[:real], 3)
        if not guessed.all():
            x[0, block] = np.where(guessed, x[0, block], self.nearest_targets(x)[0])
        return np.asarray(x[0])

    def at_predicted(self, x: Matrix) -> Problem:
        """The same shots with the readings that leave no residual at x, and no spots; `x` as for
        `linearise`."""
        nothing = np.zeros_like(self.spots)
        if not self.tool.reading_size:
            return replace(self, spots=nothing)
        parts = self.split(x)
        every = np.arange(self.shots)
        targets = parts.targets[self.target_index] if x.ndim == 1 else parts.targets[every, self.target_index]
        (readings,) = self.functions.kernel("predicted")(
            self.joints, parts.arm, targets, parts.tool, self.readings
        )
        return replace(self, spots=nothing, readings=readings.reshape(self.readings.shape))

    def beams(self, x: Matrix) -> tuple[Matrix, Matrix]:
        """Origins (N, 3) mm and unit directions (N, 3) of the beams in the base frame (eq. 7); `x` as for
        `linearise`."""
        parts = self.split(x)
        origin, direction = self.functions.kernel("beam")(self.joints, parts.arm, parts.tool)
        return origin, direction


def _belongs_to(some: Sequence[Measurement]) -> str:
    """A shot belongs to its target; what has none, to the first instrument that reads there."""
    return next((item.target for item in some if item.target), some[0].instrument)


def _rows(
    header: Header, tool: Instrument, measured: Sequence[Sequence[Measurement]], belongs: Sequence[str]
) -> tuple[Matrix, Matrix]:
    """Spots (N, d) and readings (N, w) of what is measured at each posture."""
    rows = [tool.row(some, header.targets.get(name)) for some, name in zip(measured, belongs, strict=True)]
    spots = np.array([shift for _, shift in rows]).reshape(len(rows), tool.residual_size)
    return spots, np.array([reading for reading, _ in rows]).reshape(len(rows), tool.reading_size)


def by_posture(measurements: Sequence[Measurement]) -> tuple[list[int], list[list[Measurement]]]:
    """The first measurement of each posture, by its index, and (N,) what is measured at each."""
    rows: dict[int, list[int]] = {}
    for i, item in enumerate(measurements):
        rows.setdefault(item.posture, []).append(i)
    return [some[0] for some in rows.values()], [[measurements[i] for i in some] for some in rows.values()]
