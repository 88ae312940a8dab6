"""The residuals, as symbolic functions of one shot.

One shot has the inputs

    q      (n,)   recorded joint positions, rad or mm
    data   (d + w,) what the residual is less (of a laser the spot, mm), then what was read (w = 0 of a laser
                  or probe)
    arm    (a,)   joint offsets delta (n,), then the geometry parameters if there are any
    target (3,)   target in the base frame, mm
    tool   (k,)   the free parameters of tool and frame (k = 0 if they are exact)

and the residual m (d,), kept in the flange frame: there the rotation of base and target about joint 1
cancels exactly, whatever the residual. Since q and delta enter only as q + delta, the Jacobian
by delta is the Jacobian by q as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Literal

import casadi as ca
import numpy as np

from ..instruments.flange_tool import FlangeTool
from ..instruments.kind import Flange, Instrument
from ..kernel import Kernel
from ..kinematics.robot import Robot, Turn
from .geometry import NOMINAL, Geometry


class Posture:
    """Recorded positions `q` (n,), `arm` (a,) joint offsets and geometry parameters, and what follows: the
    `robot` with its links moved, `recorded` as of `Geometry`, and the true joint positions `theta` (n,)."""

    def __init__(self, robot: Robot, geometry: Geometry, arm: ca.SX | None = None) -> None:
        n = robot.n
        self.q = ca.SX.sym("q", n)
        self.arm = ca.SX.sym("arm", n + len(geometry.names)) if arm is None else arm
        self.robot = geometry.moved(robot, self.arm[n:])
        self.recorded = geometry.recorded_symbols(robot, self.q)
        self.theta = self.q + geometry.bent(robot, self.arm, self.recorded)

    @cached_property
    def flange(self) -> Flange:
        return Flange(*self.robot.flange_pose(self.theta))

    def beam(self, tool: Instrument, unknown: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Origin and direction (3, 1) of a beam in the base frame; what is no beam has the direction 0."""
        point, direction = tool.ray(unknown)
        return self.flange.in_base(point), self.flange.rotation @ direction

    def inputs(self, **others: ca.SX) -> dict[str, ca.SX]:
        """Of a function of the posture and of `others`."""
        return {"q": self.q, "arm": self.arm, **others}


# What does not change from shot to shot of one walker.
_HOISTED = ("arm", "tool", "variances", "stated")


@dataclass(frozen=True, eq=False)
class ShotFunctions:
    """Named CasADi functions of one shot, built when first asked for; every derivative is exact.

    linear    (q, data, arm, target, tool) -> m (d,), jacobian (d, a + 3 + k) by arm, target, tool
    terms     (turns, data, weight, arm, target, tool, variances, stated) -> quad, logdet: weight times
              m' S^-1 m, and the log det of `log_det`
    slopes    the same -> quad, logdet, their gradients (f,), the lower triangle of the information on the
              logarithms of the noise factors of joints and readings, root_weight, and root (d, a + 3 + k),
              the whitened Jacobian: its kernel has weight root' root, the lower triangle row by row, in place
              of the last two. f = a + 3 + k, and g for the noise factors where `log_det` is "relative"
    seen      (q, arm, target) -> y (3,), the target seen from the flange
    sighted   the same -> y (3,), jacobian (3, n) by the joints
    place     (q, arm, y) -> target (3,): the way back
    placed    the same -> target (3,), jacobian (3, a + 3) by arm, y
    beam      (q, arm, tool) -> origin (3,), direction (3,): the beam in the base frame (eq. 7);
              for a probe the direction is zero and the origin is its tip
    hit       (q, arm, tool, centre, normal) -> point (3,), length, jacobian (3, n) by the joints: where
              the beam meets the plane through `centre` across `normal`, and how far from its origin
    flange    (q, arm) -> flange (3, 4): rotation and translation of the flange in the base frame
    predicted (q, arm, target, tool, reading) -> predicted (w,), the reading that leaves no residual
    skeleton  (q, arm) -> points (3, n + 2): base, joint origins and flange in the base frame
    axes      (q, arm) -> axes (3, n): unit joint axes in the base frame
    midpoint  of two shots of a beam: see `_midpoint`

    `turns` (2n or 3n,) are the recorded positions as `Geometry.recorded`, `variances` (n + I,) those of the
    joints and of the I noises of the instruments, `stated` (n + I,) what the header says of them.

    `of_factor` (1 + I,) says which of the g noise factors is that of the joints and of each noise of the
    readings; None: each has its own.

    `log_det` says which determinant goes with the residuals. The recorded joints are the data; the residual
    is made of them with the parameters, and log det S alone would change with what the residual is measured
    in (mm, or the angle seen from the laser), favouring parameters that make the beams short. What does not
    change is log det S "relative" to the S of the stated noise: it is needed where the noise is free, and 0
    where it is known ("none"). "whole" is log det S itself, for comparison (docs/mathematics.md).
    """

    robot: Robot
    tool: Instrument
    log_det: Literal["none", "relative", "whole"] = "none"
    geometry: Geometry = NOMINAL
    of_factor: tuple[int, ...] | None = None
    _functions: dict[str, ca.Function] = field(default_factory=dict, repr=False)
    _kernels: dict[tuple[str, bool | None], Kernel] = field(default_factory=dict, repr=False)

    def __reduce__(self) -> tuple[object, ...]:
        # In another process they are made anew, or those that are there are taken.
        return shot_functions, (self.robot, self.tool, self.log_det, self.geometry, self.of_factor)

    @cached_property
    def posture(self) -> Posture:
        """The symbols that the functions of a posture share: to build them takes longer than the rest."""
        return Posture(self.robot, self.geometry)

    @cached_property
    def weighted(self) -> _Shot:
        """Those of the terms of the log-likelihood."""
        return _Shot(self)

    def function(self, name: str) -> ca.Function:
        """The function of that name."""
        if name not in self._functions:
            self._functions[name] = _BUILT_BY[name](self)
        return self._functions[name]

    def kernel(self, name: str, *, compile: bool | None = None) -> Kernel:
        """The same as a fast callable, made once; `compile` as for a `Kernel`."""
        other = None if compile is False else self._kernels.get((name, None if compile else True))
        if other is not None and other.compiled:
            return other
        if (name, compile) not in self._kernels:
            hoisted = _HOISTED if name in ("terms", "slopes") else ()
            self._kernels[name, compile] = Kernel(
                self.function(name), compile=compile, hoisted=hoisted, gram=name == "slopes"
            )
        return self._kernels[name, compile]


_made: dict[bytes, ShotFunctions] = {}
_MOST_MADE = 32


def shot_functions(
    robot: Robot,
    tool: Instrument,
    log_det: Literal["none", "relative", "whole"] = "none",
    geometry: Geometry = NOMINAL,
    of_factor: tuple[int, ...] | None = None,
) -> ShotFunctions:
    """Those of this arm and tool, made once for all that are the same: to build and compile them takes longer
    than most of what is asked of them."""
    numbers = [part for joint in robot.joints for part in (joint.fixed, joint.axis)] + [robot.flange]
    kinds = [joint.kind for joint in robot.joints] + [log_det]
    key = " ".join(kinds).encode() + b"".join(np.asarray(part, dtype=float).tobytes() for part in numbers)
    key += tool.key + geometry.key
    if log_det == "relative":
        of_factor = tuple(range(1 + len(tool.noises))) if of_factor is None else of_factor
        key += bytes(of_factor)
    if key not in _made:
        if len(_made) == _MOST_MADE:
            _made.pop(next(iter(_made)))
        _made[key] = ShotFunctions(robot, tool, log_det, geometry, of_factor)
    made = _made[key]
    if made.geometry is not geometry:
        # The functions are the same whatever the tolerances, but these are asked of their geometry.
        return ShotFunctions(
            robot, tool, log_det, geometry, of_factor, _functions=made._functions, _kernels=made._kernels
        )
    return made


def residual(
    robot: Robot, turns: Sequence[Turn], tool: Instrument, target: ca.SX, unknown: ca.SX, reading: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """What is predicted of a `reading` (w,), less the reading (d,), and its Jacobians by the joints (d, n)
    and by the target (d, 3)."""
    if isinstance(tool, FlangeTool):  # sees its target in the flange frame: that takes half the operations
        target_in_flange, stations = robot.in_flange(turns, target)
        at = ca.SX.sym("target_in_flange", 3)
        predicted = tool.beside(at, unknown)
        across = ca.jacobian(predicted, at).T
        predicted, across = ca.substitute([predicted, across], [at], [target_in_flange])
        return (predicted, *robot.in_flange_jacobian(turns, stations, across))
    rotation, translation, columns = robot.flange_motion(turns)
    flange, turn = Flange(ca.SX.sym("rotation", 3, 3), ca.SX.sym("translation", 3)), ca.SX.sym("turn", 3)
    (variant,) = tool.variants
    left = tool.residual(flange, target, unknown, reading, variant)
    turned = ca.substitute(left, flange.rotation, flange.rotation + ca.skew(turn) @ flange.rotation)
    by_turn = ca.substitute(ca.jacobian(turned, turn), turn, ca.SX.zeros(3))
    by_motion = ca.horzcat(ca.jacobian(left, flange.translation), by_turn)
    parts = [left, by_motion, ca.jacobian(left, target)]
    symbols = [flange.rotation, flange.translation]
    # Where all axes are parallel some of their entries are no numbers, but empty.
    motion = [ca.densify(rotation), ca.densify(translation)]
    left, by_motion, by_target = ca.substitute(parts, symbols, motion)
    return left, by_motion @ columns, by_target


class _Shot:
    """The symbols of one shot, its residual and the residual's Jacobian (section 1 of the conventions);
    with its noise the covariance of the residual, and the two terms of the log-likelihood."""

    def __init__(self, functions: ShotFunctions) -> None:
        tool, geometry, n = functions.tool, functions.geometry, functions.robot.n
        self.recorded = ca.SX.sym("turns", geometry.recorded_size(functions.robot))
        d = tool.residual_size
        self.data = ca.SX.sym("data", d + tool.reading_size)
        spot, self.reading = self.data[:d], self.data[d:]
        self.target = ca.SX.sym("target", 0 if tool.target_is == "nothing" else 3)
        self.arm = ca.SX.sym("arm", n + len(geometry.names))
        self.unknown = ca.SX.sym("tool", len(tool.unknowns))
        robot = geometry.moved(functions.robot, self.arm[n:])
        offsets = geometry.bent(functions.robot, self.arm, self.recorded)
        turns = functions.robot.turns_with_offsets(self.recorded, offsets)
        left, self.by_joints, by_target = residual(
            robot, turns, tool, self.target, self.unknown, self.reading
        )
        self.residual = left - spot
        by_geometry = ca.jacobian(self.residual, self.arm)[:, n:]
        by_tool = ca.jacobian(self.residual, self.unknown)
        self.jacobian = ca.horzcat(self.by_joints, by_geometry, by_target, by_tool)
        self._weigh(functions)

    def _weigh(self, functions: ShotFunctions) -> None:
        n, layout = functions.robot.n, functions.tool.layout
        sources = n + len(functions.tool.noises)
        self.weight = ca.SX.sym("weight")
        self.variances, self.stated_variances = (ca.SX.sym(name, sources) for name in ("variances", "stated"))
        relative = [self.reading[at] ** 2 if at >= 0 else ca.SX(1) for at in layout.relative.tolist()]
        active = [self.reading[at] if at >= 0 else ca.SX(1) for at in layout.active.tolist()]
        # What was not read has a residual of 0 and the variance 1.
        self._without = ca.diag(ca.vertcat(*(1 - each for each in active)))
        self._unit = [
            ca.vertcat(
                *(
                    a * r if source == k else 0
                    for a, r, source in zip(active, relative, layout.noise.tolist(), strict=True)
                )
            )
            for k in range(sources - n)
        ]
        self.by_noise = self._covariances(self.variances)
        self.factor = _cholesky(sum(self.by_noise, self._without))
        self.quad = self.weight * ca.sumsqr(_forward(self.factor, self.residual))
        self.logdet = ca.SX(0)
        if functions.log_det != "none":
            self.logdet = self.weight * _log_det(self.factor)
        if functions.log_det == "relative":
            stated_factor = _cholesky(sum(self._covariances(self.stated_variances), self._without))
            self.logdet -= self.weight * _log_det(stated_factor)

    def _covariances(self, variances: ca.SX) -> list[ca.SX]:
        """What the joints' noise and that of each instrument add to the covariance of the residual."""
        n = self.by_joints.size2()
        by_joints = self.by_joints @ ca.diag(variances[:n]) @ self.by_joints.T
        return [by_joints, *(ca.diag(variances[n + k] * unit) for k, unit in enumerate(self._unit))]

    @property
    def inputs(self) -> dict[str, ca.SX]:
        return {
            "turns": self.recorded,
            "data": self.data,
            "weight": self.weight,
            "arm": self.arm,
            "target": self.target,
            "tool": self.unknown,
            "variances": self.variances,
            "stated": self.stated_variances,
        }


def _function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """With names for inputs and outputs; outputs are dense, and what they share is computed once."""
    values = ca.cse([ca.densify(value) for value in outputs.values()])
    return ca.Function(name, list(inputs.values()), values, list(inputs), list(outputs))


def _linear(functions: ShotFunctions) -> ca.Function:
    posture, shot = functions.posture, functions.weighted
    others = {"data": shot.data, "arm": shot.arm, "target": shot.target, "tool": shot.unknown}
    at_turns = ca.Function("shot", [shot.recorded, *others.values()], [shot.residual, shot.jacobian])
    residual, jacobian = at_turns(posture.recorded, *others.values())
    return _function("linear", {"q": posture.q, **others}, {"m": residual, "jacobian": jacobian})


def _terms(functions: ShotFunctions) -> ca.Function:
    shot = functions.weighted
    return _function("terms", shot.inputs, {"quad": shot.quad, "logdet": shot.logdet})


def _slopes(functions: ShotFunctions) -> ca.Function:
    shot, n = functions.weighted, functions.robot.n
    gradients = [
        ca.gradient(value, ca.vertcat(shot.arm, shot.target, shot.unknown))
        for value in (shot.quad, shot.logdet)
    ]
    of_factor = range(len(shot.by_noise)) if functions.of_factor is None else functions.of_factor
    count = max(of_factor) + 1
    noise_information = ca.SX(count * (count + 1) // 2, 1)
    if functions.log_det == "relative":
        # By the logarithm of a factor f of the std: d/d ln f = 2 sum of variance d/d variance; the
        # information of a normal's covariance is tr(S^-1 dS S^-1 dS) / 2 (its share in x is left out).
        for k, value in enumerate((shot.quad, shot.logdet)):
            by_variances = 2 * shot.variances * ca.gradient(value, shot.variances)
            by_noise = [ca.sum1(by_variances[:n]), *ca.vertsplit(by_variances[n:])]
            gradients[k] = ca.vertcat(gradients[k], *_of_factors(by_noise, of_factor))
        parts = _of_factors(shot.by_noise, of_factor)
        halves = [_forward(shot.factor, _forward(shot.factor, 2 * part).T) for part in parts]
        pairs = [(halves[i], halves[j]) for i in range(count) for j in range(i + 1)]
        noise_information = ca.vertcat(*(shot.weight * ca.trace(a @ b.T) / 2 for a, b in pairs))
    outputs = {
        "quad": shot.quad,
        "logdet": shot.logdet,
        "quad_gradient": gradients[0],
        "logdet_gradient": gradients[1],
        "noise_information": noise_information,
        "root_weight": shot.weight,
        "root": _forward(shot.factor, shot.jacobian),
    }
    return _function("slopes", shot.inputs, outputs)


def _of_factors(by_noise: Sequence[ca.SX], of_factor: Sequence[int]) -> list[ca.SX]:
    """The sums of those that have one factor."""
    every = [
        [each for each, of in zip(by_noise, of_factor, strict=True) if of == k]
        for k in range(max(of_factor) + 1)
    ]
    return [sum(some[1:], some[0]) for some in every]


def _of_posture(functions: ShotFunctions, name: str) -> ca.Function:
    """A function of the posture, and of symbols that it takes besides."""
    posture, tool = functions.posture, functions.tool
    target, y, centre, normal = (ca.SX.sym(symbol, 3) for symbol in ("target", "y", "centre", "normal"))
    unknown, reading = ca.SX.sym("tool", len(tool.unknowns)), ca.SX.sym("reading", tool.reading_size)
    others: dict[str, ca.SX] = {}
    match name:
        case "seen" | "sighted":
            others, outputs = {"target": target}, {"y": posture.flange.in_flange(target)}
            if name == "sighted":
                outputs["jacobian"] = ca.jacobian(outputs["y"], posture.q)
        case "place" | "placed":
            others, outputs = {"y": y}, {"target": posture.flange.in_base(y)}
            if name == "placed":
                outputs["jacobian"] = ca.jacobian(outputs["target"], ca.vertcat(posture.arm, y))
        case "beam":
            origin, direction = posture.beam(tool, unknown)
            others, outputs = {"tool": unknown}, {"origin": origin, "direction": direction}
        case "hit":
            origin, direction = posture.beam(tool, unknown)
            length = ca.dot(normal, centre - origin) / ca.dot(normal, direction)
            hit = origin + length * direction
            others = {"tool": unknown, "centre": centre, "normal": normal}
            outputs = {"point": hit, "length": length, "jacobian": ca.jacobian(hit, posture.q)}
        case "predicted":
            others = {"target": target, "tool": unknown, "reading": reading}
            outputs = {name: tool.predicted(posture.flange, target, unknown, reading, tool.variants[0])}
        case "flange":
            outputs = {name: ca.horzcat(posture.flange.rotation, posture.flange.translation)}
        case "skeleton":
            outputs = {"points": posture.robot.skeleton(posture.theta)}
        case _:
            outputs = {"axes": posture.robot.axes(posture.theta)}
    return _function(name, posture.inputs(**others), outputs)


def _midpoint(functions: ShotFunctions) -> ca.Function:
    """(q1, q2, arm, tool) -> midpoint (3,), jacobian (3, a + k) by arm, tool, and (3, n) by q1 and by q2.

    The middle of the shortest segment between two beams (section 2.2 of the paper). It is not
    defined for parallel beams: callers leave those pairs out.
    """
    one = functions.posture
    other = Posture(functions.robot, functions.geometry, one.arm)
    unknown = ca.SX.sym("tool", len(functions.tool.unknowns))
    (o1, u1), (o2, u2) = (posture.beam(functions.tool, unknown) for posture in (one, other))
    between, cosine = o2 - o1, ca.dot(u1, u2)
    sine_squared = ca.sumsqr(ca.cross(u1, u2))
    along1 = (ca.dot(between, u1) - cosine * ca.dot(between, u2)) / sine_squared
    along2 = (cosine * ca.dot(between, u1) - ca.dot(between, u2)) / sine_squared
    middle = (o1 + along1 * u1 + o2 + along2 * u2) / 2
    by = ca.jacobian(middle, ca.vertcat(one.arm, unknown, one.q, other.q))
    ends = np.cumsum([0, one.arm.numel() + unknown.numel(), one.q.numel(), other.q.numel()]).tolist()
    jacobian, by_q1, by_q2 = ca.horzsplit(by, ends)
    outputs = {"midpoint": middle, "jacobian": jacobian, "by_q1": by_q1, "by_q2": by_q2}
    return _function("midpoint", {"q1": one.q, "q2": other.q, "arm": one.arm, "tool": unknown}, outputs)


_BUILT_BY: dict[str, Callable[[ShotFunctions], ca.Function]] = {
    "linear": _linear,
    "terms": _terms,
    "slopes": _slopes,
    "midpoint": _midpoint,
}
_OF_POSTURE = ("seen", "sighted", "place", "placed", "beam", "hit", "predicted", "flange", "skeleton", "axes")
_BUILT_BY |= {name: partial(_of_posture, name=name) for name in _OF_POSTURE}


def _cholesky(covariance: ca.SX) -> ca.SX:
    """(d, d) lower factor, written out."""
    d = covariance.size1()
    factor = ca.SX.zeros(d, d)
    for i in range(d):
        for j in range(i + 1):
            value = covariance[i, j] - sum((factor[i, k] * factor[j, k] for k in range(j)), ca.SX(0))
            factor[i, j] = ca.sqrt(value) if i == j else value / factor[j, j]
    return factor


def _log_det(factor: ca.SX) -> ca.SX:
    diagonal = ca.SX(1)
    for i in range(factor.size1()):
        diagonal = diagonal * factor[i, i]
    return 2 * ca.log(diagonal)


def _forward(factor: ca.SX, right: ca.SX) -> ca.SX:
    """L^-1 B of a lower factor (d, d) and B (d, m), by forward substitution."""
    rows: list[ca.SX] = []
    for i in range(factor.size1()):
        inner = sum((factor[i, k] * rows[k] for k in range(i)), ca.SX(0))
        rows.append((right[i, :] - inner) / factor[i, i])
    return ca.vertcat(*rows)
