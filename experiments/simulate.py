"""Simulated measurements: an arm with true offsets, servoed until the true beam hits, read with noise; and
the rehearsal of what is no beam."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..analysis.observability.aim import aim, servo_joints
from ..analysis.observability.predictions import GUESSED
from ..analysis.solution import Solution
from ..model.arrays import Matrix
from ..model.errors import RigFault
from ..model.files.plan import Means, Plan
from ..model.files.shot import Shot, shot_model
from ..model.instruments.kind import Instrument
from ..model.likelihood.problem import Problem
from .procedure.events import Listener
from .procedure.session import Ports, Reading

_DIGITS = {"mm": 6}  # of a reading; those without a unit, as a quaternion, have more
_MORE_DIGITS = 12


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth of a simulation: the true parameters x (p,), internal units, of a `plan`'s problem."""

    plan: Plan
    problem: Problem
    x: Matrix

    @classmethod
    def drawn(cls, plan: Plan, rng: np.random.Generator, offset_deg: float = 1.0) -> Truth:
        """Offsets of about `offset_deg` (mm for prismatic joints), the targets at their nominal positions, an
        uncalibrated tool and uncertain geometry off by random errors of the header's sigma and tolerances, a
        free frame where its instrument may stand. Held ones stay held."""
        problem = Problem.from_plan(plan)
        parameters = problem.parameters
        x = problem.nominal()
        drawn = rng.normal(size=len(x))
        offsets, others = parameters.group("offset"), parameters.group("tool") | parameters.group("geometry")
        x = x + np.where(offsets, drawn * offset_deg / parameters.display, 0.0)
        most = np.array([GUESSED.get(item.unit, np.inf) for item in parameters.items])
        x = x + np.where(others, drawn * np.minimum(parameters.prior_std, most), 0.0)
        x[parameters.block("frame")] = problem.tool.placed(rng)
        return cls(plan, problem, np.where(parameters.free, x, parameters.prior_mean))

    @classmethod
    def with_values(cls, plan: Plan, values: dict[str, float]) -> Truth:
        """As `drawn` without any error, with the named parameters at the stated values (deg, mm)."""
        problem = Problem.from_plan(plan)
        for name in values:
            problem.parameters.index(name)  # ValueError where there is none
        return cls(plan, problem, problem.nominal()).knowing(values)

    def knowing(self, values: Mapping[str, float]) -> Truth:
        """A copy with these values (deg, mm) by name; others than the problem's are passed over."""
        x, parameters = self.x.copy(), self.problem.parameters
        for i, item in enumerate(parameters.items):
            if item.name in values:
                x[i] = values[item.name] / item.display
        return replace(self, x=x)

    def values(self) -> dict[str, float]:
        """The true offsets, geometry and tool by name, deg and mm."""
        items = self.problem.parameters.items
        return {
            item.name: round(float(value) * item.display, 9)
            for item, value in zip(items, self.x, strict=True)
            if item.group != "target"
        }

    def provenance(self) -> dict[str, float]:
        """`values` by name with the unit, for the run's header."""
        units = {item.name: item.unit for item in self.problem.parameters.items}
        return {f"true {name} ({units[name]})": value for name, value in self.values().items()}


def simulated_shots(truth: Truth, rng: np.random.Generator) -> Iterator[Shot]:
    """The plan's measurements as the simulated cell records them, posture by posture.

    What is met is brought onto its target: a beam by the wrist, a probe by all joints. Then the joints are
    read with the stated joint noise and the instruments with theirs. Raises RigFault for a posture from which
    the target cannot be met.
    """
    problem, plan = truth.problem, truth.plan
    n, display = problem.robot.n, problem.robot.display
    recorded = _recorded(problem.tool)
    touches = rng.normal(size=(problem.shots, int((~recorded).sum())))
    aimed = aim(_touching(problem, touches), truth.x, servo_joints(problem))
    stds = np.sqrt(aimed.problem.of_sources(problem.noise.variances).sum(axis=0))
    rows: dict[int, list[int]] = {}
    for row, measurement in enumerate(plan.measurements):
        rows.setdefault(measurement.posture, []).append(row)
    model = shot_model(plan.header)
    for i, same in enumerate(rows.values()):
        if not aimed.ahead[i]:
            raise RigFault(
                f"posture {same[0]}: the target is behind the laser. Correct the posture or tool.direction."
            )
        if not aimed.hit[i]:
            meeting = next(each for each in problem.tool.each if each.met)
            raise RigFault(
                f"posture {same[0]}: the {'wrist' if meeting.beam else 'arm'} cannot bring the"
                f" {meeting.name} onto the target, which is {aimed.off_mm[i]:.0f} mm off. Choose one that"
                " points nearer to it."
            )
        joints = aimed.problem.joints[i] + rng.normal(size=n) * problem.noise.joint
        shift = np.zeros(problem.tool.residual_size)
        shift[recorded] = rng.normal(size=int(recorded.sum())) * stds[i, recorded]
        readings = {
            (part.instrument.label, part.variant): part.instrument.recorded(part.reading, shift[part.rows])
            for part in problem.tool.read_at(aimed.problem.readings[i])
        }
        for row in same:
            item = plan.measurements[row]
            content = {
                "shot": row,
                "target": item.target,
                "joints_deg": tuple(round(float(v), 9) for v in joints * display),
                **Means.of(plan.shots[row])._asdict(),
                **_rounded(readings[item.instrument, item.variant]),
            }
            yield model.model_validate(content)


def _recorded(tool: Instrument) -> NDArray[np.bool_]:
    """(d,) the components of a residual of which the noise is in what is read, not in where the arm is."""
    return np.array([bool(each.columns) for each in tool.each])[tool.layout.source]


def _touching(problem: Problem, unit: Matrix) -> Problem:
    """The same where what is met and not read is not met quite: a ball in its socket, a touch. `unit` (N, t)
    are random numbers of std 1 for its t components."""
    touching = ~_recorded(problem.tool)
    stds = np.sqrt(problem.of_sources(problem.noise.variances).sum(axis=0))
    spots = np.zeros((problem.shots, len(touching)))
    spots[:, touching] = unit * stds[:, touching]
    return problem.moved(problem.joints, spots)


def _rounded(readings: Mapping[str, tuple[float, ...]]) -> dict[str, float | tuple[float, ...]]:
    """Readings by column as they are recorded, a single number as such."""
    every = {
        column: tuple(round(value, _DIGITS.get(column[-2:], _MORE_DIGITS)) for value in values)
        for column, values in readings.items()
    }
    return {column: values[0] if len(values) == 1 else values for column, values in every.items()}


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of W simulated runs of one plan: `joints` (W, N, n), `spots` (W, N, d), `readings` (W, N, w)
    before their noise, which is in `spots`; `met` (W,) where every measurement could be brought onto its
    target."""

    joints: Matrix
    spots: Matrix
    readings: Matrix
    met: NDArray[np.bool_]


def simulated_readings(problem: Problem, truths: Matrix, rng: np.random.Generator) -> Readings:
    """As `simulated_shots`, for many arms with the true parameters `truths` (W, p), side by side."""
    count, shots, recorded = len(truths), problem.shots, _recorded(problem.tool)
    unit = rng.normal(size=(count * shots, len(recorded)))
    every = replace(
        problem,
        joints=np.tile(problem.joints, (count, 1)),
        spots=np.zeros_like(unit),
        readings=np.tile(problem.readings, (count, 1)),
        target_index=np.tile(problem.target_index, count),
        shot_numbers=tuple(range(count * shots)),
        weights=np.tile(problem.weights, count),
    )
    aimed = aim(_touching(every, unit[:, ~recorded]), np.repeat(truths, shots, axis=0), servo_joints(every))
    joints = aimed.problem.joints + rng.normal(size=(count * shots, problem.robot.n)) * problem.noise.joint
    stds = np.sqrt(aimed.problem.of_sources(problem.noise.variances).sum(axis=0))
    spots = unit * stds * recorded
    met = np.asarray((aimed.hit & aimed.ahead).reshape(count, shots).all(axis=1))
    return Readings(
        joints.reshape(count, shots, -1),
        spots.reshape(count, shots, -1),
        aimed.problem.readings.reshape(count, shots, -1),
        met,
    )


_STATES = 5  # times at most what is known so far is found out


class Rehearsal(Ports):
    """The ports and the order of the measurements of a simulated arm, with noise by `rng`."""

    def __init__(self, truth: Truth, rng: np.random.Generator, told: Listener) -> None:
        self.plan, self.problem, self.listener = truth.plan, truth.problem, told
        # What each measurement adds is told of a tool; a fit of many other readings takes too long for that.
        self.every = 1 if self.plan.header.only_tools else -(-len(self.plan.postures) // _STATES)
        self._shots = simulated_shots(truth, rng)

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The next that is not recorded."""
        done = {shot.shot for shot in recorded}
        for shot in self._shots:
            if shot.shot not in done:
                self._shot = shot
                return shot.shot
        return None

    def joints(self) -> Matrix:
        return np.array(self._shot.joints_deg)

    def reading(self, number: int) -> Reading:
        return self._shot.readings

    def stop(self) -> None:
        """Nothing moves."""
