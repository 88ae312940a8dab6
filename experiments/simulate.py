"""Simulated measurements: an arm with true offsets, servoed until the true beam hits, read with noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..analysis.observability.aim import aim, servo_joints
from ..model.arrays import Matrix
from ..model.errors import RigFault
from ..model.files.plan import Plan
from ..model.files.shot import Shot
from ..model.likelihood.problem import Problem


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth of a simulation: the true parameters x (p,), internal units, of a plan's problem."""

    problem: Problem
    x: Matrix

    @classmethod
    def drawn(cls, plan: Plan, rng: np.random.Generator, offset_deg: float = 1.0) -> Truth:
        """Offsets of about `offset_deg` (mm for prismatic joints), the targets at their nominal positions, an
        uncalibrated tool and uncertain geometry off by random errors of the header's sigma and tolerances.
        Held ones stay held."""
        problem = Problem.from_plan(plan)
        parameters = problem.parameters
        x = problem.nominal()
        drawn = rng.normal(size=len(x))
        offsets, others = parameters.group("offset"), parameters.group("tool") | parameters.group("geometry")
        x = x + np.where(offsets, drawn * offset_deg / parameters.display, 0.0)
        x = x + np.where(others, drawn * parameters.prior_std, 0.0)
        return cls(problem, np.where(parameters.free, x, parameters.prior_mean))

    @classmethod
    def with_values(cls, plan: Plan, values: dict[str, float]) -> Truth:
        """As `drawn` without any error, with the named parameters at the stated values (deg, mm)."""
        problem = Problem.from_plan(plan)
        for name in values:
            problem.parameters.index(name)  # ValueError where there is none
        return cls(problem, problem.nominal()).knowing(values)

    def knowing(self, values: Mapping[str, float]) -> Truth:
        """A copy with these values (deg, mm) by name; others than the problem's are passed over."""
        x, parameters = self.x.copy(), self.problem.parameters
        for i, item in enumerate(parameters.items):
            if item.name in values:
                x[i] = values[item.name] / item.display
        return Truth(self.problem, x)

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
    """The plan's measurements as the simulated cell records them, one by one.

    Each posture's wrist is turned until the true beam is on the true target (a probe is led into its
    socket by all joints); then the joints are read with the stated joint noise and the spot with the
    stated spot noise. Raises RigFault for a posture from which the target cannot be met.
    """
    problem = truth.problem
    n, display, tool = problem.robot.n, problem.robot.display, problem.tool
    if not tool.columns:
        # There is nothing to read: a probe's ball does not sit quite at the socket's centre.
        problem = problem.moved(problem.joints, rng.normal(size=(problem.shots, 3)) * problem.noise.spot)
    aimed = aim(problem, truth.x, servo_joints(problem))
    for i in range(problem.shots):
        if not aimed.ahead[i]:
            raise RigFault(
                f"posture {i}: the target is behind the laser. Correct the posture or tool.direction."
            )
        if not aimed.hit[i]:
            raise RigFault(
                f"posture {i}: the {'wrist' if tool.beam else 'arm'} cannot bring the {tool.name} onto"
                f" the target, which is {aimed.off_mm[i]:.0f} mm off. Choose one that points nearer to it."
            )
        joints = aimed.problem.joints[i] + rng.normal(size=n) * problem.noise.joint
        spot = rng.normal(size=2) * problem.noise.spot
        yield Shot(
            shot=i,
            target=problem.targets[problem.target_index[i]],
            joints_deg=tuple(round(float(v), 9) for v in joints * display),
            spot_mm=(round(float(spot[0]), 6), round(float(spot[1]), 6)) if tool.columns else None,
        )


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of W simulated runs of one plan: `joints` (W, N, n), `spots` (W, N, d); `met` (W,) where
    every measurement could be brought onto its target."""

    joints: Matrix
    spots: Matrix
    met: NDArray[np.bool_]


def simulated_readings(problem: Problem, truths: Matrix, rng: np.random.Generator) -> Readings:
    """As `simulated_shots`, for many arms with the true parameters `truths` (W, p), side by side."""
    count, shots, d = len(truths), problem.shots, problem.tool.residual_size
    spots = rng.normal(size=(count, shots, d)) * problem.noise.spot
    all_shots = replace(
        problem,
        joints=np.tile(problem.joints, (count, 1)),
        # A laser's beam is led to the centre and the spot is read; a probe's ball sits where it sits.
        spots=np.zeros((count * shots, d)) if problem.tool.columns else spots.reshape(-1, d),
        readings=np.tile(problem.readings, (count, 1)),
        target_index=np.tile(problem.target_index, count),
        shot_numbers=tuple(range(count * shots)),
        weights=np.tile(problem.weights, count),
    )
    aimed = aim(all_shots, np.repeat(truths, shots, axis=0), servo_joints(problem))
    joints = aimed.problem.joints + rng.normal(size=(count * shots, problem.robot.n)) * problem.noise.joint
    met = np.asarray((aimed.hit & aimed.ahead).reshape(count, shots).all(axis=1))
    if not problem.tool.columns:
        spots = np.zeros_like(spots)
    return Readings(joints.reshape(count, shots, -1), spots, met)
