"""Random arms that any kind of instrument measures, or two of them, and what is null of their Jacobians.

The judge has the arm of `exact_judge` and a model of each kind by itself: what it reads as a formula of the
flange, differentiated by central differences in eighty digits. What is met is met to as many.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import mpmath
import numpy as np
from exact_judge import (
    EYE,
    Chain,
    Exact,
    beam_axes,
    cross,
    dh_row,
    exact,
    joints_of,
    robot_of,
    unit,
    values_near_by,
)
from hypothesis import strategies as st
from mpmath import mpf

from zerobeam.analysis.observability.aim import aim
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import Header
from zerobeam.model.instruments.kind import Measurement
from zerobeam.model.kinematics.dh import DHRow
from zerobeam.model.likelihood.problem import Problem

_DIGITS = 80
_STEP = mpf(10) ** -24  # rad, m: differences are right to 48 digits
_MET = mpf(10) ** -60  # m, m²
_TRIES = 30
TIP, BALL_MM, BALL_TIP_MM = [25.0, -10.0, 90.0], 40.0, 6.0
FRAME = {"xyz_mm": [1500.0, -700.0, 400.0], "quat": [0.8, 0.0, 0.36, 0.48]}

Read = tuple[str, str, str | None]  # label of an instrument, variant, target


@dataclass(frozen=True)
class Mix:
    """What Hypothesis chooses; the numbers come from the seed. The first `constant` joints never move."""

    seed: int
    joints: int
    kinds: tuple[str, ...]
    constant: int = 0
    shots: int = 12
    freed: bool = False
    uncertain: bool = False
    prismatic: bool = False


@dataclass(frozen=True, eq=False)
class KindsCell:
    """An arm by its rows, its `problem` with shots that hit at x (p,), what is read in each, and which joints
    move (n,)."""

    rows: tuple[DHRow, ...]
    kinds: str
    header: Header
    problem: Problem
    x: Matrix
    reads: tuple[tuple[Read, ...], ...]
    moving: Matrix


def _tip(kind: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "tip_mm": TIP, "sigma_mm": 0.02, **more}


def _tracker(frame: Any, **known: Any) -> dict[str, Any]:
    reflectors = {"R1": {"guess_mm": [40, 10, 60], **known}, "R2": {"guess_mm": [-30, 50, 20], **known}}
    return {"kind": "tracker", "frame": frame, "sigma_mm": 0.03, "reflectors": reflectors}


def _pose(frame: Any, **mount: Any) -> dict[str, Any]:
    return {"kind": "pose", "frame": frame, "sigma_mm": 0.03, "sigma_deg": 0.01, "mount": mount}


_KNOWN_MOUNT = {"guess_mm": [10, 20, 30], "sigma_mm": 0.1, "guess_quat": [0.6, 0.8, 0, 0], "sigma_deg": 0.05}
_BEAM = {"kind": "laser", "calibrated": True, "point_mm": TIP, "direction": [0.6, 0, 0.8]}
INSTRUMENTS: dict[str, dict[str, Any]] = {
    "tracker": _tracker("free"),
    "tracker, reflectors known": _tracker("free", sigma_mm=0.1),
    "tracker, all known": _tracker(FRAME, sigma_mm=0.1),
    "pose": _pose("free"),
    "pose, frame known": _pose(FRAME),
    "pose, mount known": _pose("free", **_KNOWN_MOUNT),
    "laser": _BEAM,
    "laser, free": {**_BEAM, "calibrated": False},
    "probe": {"kind": "probe", "calibrated": True, "point_mm": TIP},
    "plane": _tip("plane", tip_diameter_mm=BALL_TIP_MM),
    "sphere": _tip("sphere", tip_diameter_mm=BALL_TIP_MM),
    "ballbar": _tip("ballbar"),
    "ballbar, zero free": _tip("ballbar", bias="free"),
    "dial": _tip("dial", direction=[0, 0.6, 0.8]),
}
_COUNT = {"plane": 3, "sphere": 1, "ballbar": 2, "dial": 2, "laser": 1, "probe": 1}  # of targets
_MET_KINDS = ("plane", "sphere", "laser", "probe")
NAMES = tuple(INSTRUMENTS)
_TOOLS = {"laser", "laser, free", "probe"}  # of which a flange carries one

MIXES = st.builds(
    Mix,
    seed=st.integers(0, 10**6),
    joints=st.integers(3, 7),
    kinds=st.one_of(
        st.sampled_from(NAMES).map(lambda one: (one,)),
        st.sampled_from([pair for pair in itertools.combinations(NAMES, 2) if not set(pair) <= _TOOLS]),
    ),
    constant=st.integers(0, 2),
    shots=st.sampled_from([4, 8, 14]),
    freed=st.booleans(),
    uncertain=st.booleans(),
    prismatic=st.booleans(),
)


def random_mix(mix: Mix) -> KindsCell | None:
    """None where this arm cannot be measured in so many ways."""
    rng = np.random.default_rng(mix.seed)
    rows = tuple(dh_row(rng) for _ in range(mix.joints))
    kinds = "".join("p" if mix.prismatic and rng.random() < 0.3 else "r" for _ in rows)
    robot = robot_of(rows, kinds)
    lower, upper = 0.6 * robot.lower, 0.6 * robot.upper
    first = rng.uniform(lower, upper)
    flange = robot.fk(first, unit="rad")
    tip = flange[:3, 3] + flange[:3, :3] @ TIP
    targets: dict[str, Any] = {}
    turns: list[tuple[Read, ...]] = []
    for kind in mix.kinds:
        entry = INSTRUMENTS[kind]
        for i in range(_COUNT.get(entry["kind"], 0)):
            name, way = f"{entry['kind']}{i}", rng.normal(size=3)
            way /= np.linalg.norm(way)
            beam = flange[:3, :3] @ entry["direction"] if entry["kind"] == "laser" else 0 * way
            targets[name] = _target(entry["kind"], tip + 600 * beam, way.round(3))
            turns.append(((kind, "", name),))
        turns += [((kind, reflector, None),) for reflector in entry.get("reflectors", {})]
        if entry["kind"] == "pose":
            turns.append(((kind, "", None),))
    header = _header(mix, targets, robot_slides="p" in kinds)
    moving = np.ones(mix.joints)
    moving[: mix.constant] = 0.0
    joints, reads = [], []
    for k, read in enumerate(turns):
        count = len(range(k, mix.shots, len(turns)))
        start = rng.uniform(lower, upper, (_TRIES * max(count, 1), mix.joints))
        start[:, : mix.constant] = first[: mix.constant]
        start[0] = first
        measured = [[_planned(one) for one in read]] * len(start)
        tried = _problem(header, robot, start, measured)
        met = aim(tried, tried.nominal(), moving)
        good = np.flatnonzero(met.hit & _usable(header, robot, met.problem.joints, read))
        if len(good) < count:
            return None
        joints += list(met.problem.joints[good[len(good) - count :]])
        reads += [read] * count
    stacked = np.array(joints)
    if (np.ptp(stacked, axis=0) * robot.display)[mix.constant :].min(initial=1.0) < 1.0:
        return None
    problem = _problem(header, robot, stacked, [[_planned(one) for one in read] for read in reads])
    return KindsCell(rows, kinds, header, problem, _somewhere(problem, rng), tuple(reads), moving)


def _target(kind: str, tip: Matrix, way: Matrix) -> dict[str, Any]:
    if kind in ("plane", "dial"):
        return {"kind": "plane", "normal": way.tolist(), "guess_mm": tip.tolist()}
    if kind == "sphere":
        centre = tip + way / np.linalg.norm(way) * (BALL_MM + BALL_TIP_MM) / 2
        return {"kind": "sphere", "diameter_mm": BALL_MM, "guess_mm": centre.tolist()}
    return {"guess_mm": (tip if kind in ("laser", "probe") else tip + 500 * way).tolist()}


def _header(mix: Mix, targets: dict[str, Any], *, robot_slides: bool) -> Header:
    content: dict[str, Any] = {
        "robot": "random",
        "instruments": {kind: INSTRUMENTS[kind] for kind in mix.kinds},
        "noise": {"joint_deg": 0.003, "spot_mm": 0.05, **({"joint_mm": 0.02} if robot_slides else {})},
        "geometry": {"gravity": True, "harmonics": False} if mix.uncertain else "exact",
    }
    if targets:
        content["targets"] = targets
    if mix.freed:
        content["held"] = []
    return Header.model_validate(content)


def _planned(read: Read) -> Measurement:
    return Measurement(*read, {})


def _problem(header: Header, robot: Any, joints: Matrix, measured: Any) -> Problem:
    measured = [[item._replace(posture=i) for item in some] for i, some in enumerate(measured)]
    problem = Problem.of_measured(header, robot, joints, measured, planned=True)
    return problem.at_predicted(problem.nominal())


def _usable(header: Header, robot: Any, joints: Matrix, read: tuple[Read, ...]) -> Matrix:
    """(N,) whether a dial is within 60° of the normal of its plane."""
    result = np.ones(len(joints), dtype=bool)
    for label, _, target in read:
        entry = header.instruments[label]
        if entry.kind == "dial" and target is not None:
            normal = np.array(header.targets[target].normal)
            for i, q in enumerate(joints):
                along = robot.fk(q, unit="rad")[:3, :3] @ np.array(entry.direction)
                result[i] &= abs(normal @ along) > 0.5 * np.linalg.norm(normal) * np.linalg.norm(along)
    return result


def _somewhere(problem: Problem, rng: np.random.Generator) -> Matrix:
    """(p,) with frames and mounts of which nothing is known anywhere."""
    x = problem.nominal()
    for i, item in enumerate(problem.parameters.items):
        if item.group == "frame" or (item.of.endswith(".mount") and not item.tolerated):
            x[i] = rng.normal() * (0.7 if item.unit == "deg" else 400.0)
    return x


# The judge


class KindsJudge:
    """What each measurement of a cell reads, in eighty digits."""

    def __init__(self, cell: KindsCell) -> None:
        self.cell, self.chain = cell, Chain(cell.rows, cell.kinds, cell.problem.geometry)
        self.names = cell.problem.parameters.names
        self.metres = [
            mpf(1) if item.unit == "deg" else mpf(1) / 1000 for item in cell.problem.parameters.items
        ]

    def jacobian(self, x: Matrix, joints: Matrix) -> Exact | None:
        """(rows, p) by all parameters at x (p,), rad and m, with what is met turned to be met from `joints`
        (N, n); None where it cannot be."""
        with mpmath.workdps(_DIGITS):
            at = {name: value * m for name, value, m in zip(self.names, exact(x), self.metres, strict=True)}
            stacked = []
            for q, reads in zip(joints, self.cell.reads, strict=True):
                turned = self._met(at, joints_of(self.cell, q), reads)  # type: ignore[arg-type]
                if turned is None:
                    return None
                stacked.append(self._by_parameters(at, turned, reads))
            return np.vstack(stacked)

    def _flange(self, at: dict[str, mpf], q: Exact) -> tuple[Exact, Exact]:
        n = len(q)
        theta = q + np.array([at[f"delta{i + 1}"] for i in range(n)])
        links = {(of, axis): at[f"{of}.{axis}"] for of, axis in self.chain.names}
        rates = self.chain.bending(q) if links else {}
        for (of, axis), value in links.items():
            if of.startswith("joint"):
                theta[int(of[5:]) - 1] += value * rates[of, axis]
        rotation, place, *_ = self.chain.chain(theta, links)
        return rotation, place

    def _read(self, at: dict[str, mpf], flange: tuple[Exact, Exact], reads: tuple[Read, ...]) -> Exact:
        return np.concatenate([self._one(at, flange, read) for read in reads])

    def _one(self, at: dict[str, mpf], flange: tuple[Exact, Exact], read: Read) -> Exact:
        label, variant, target = read
        rotation, place = flange
        entry = self.cell.header.instruments[label]

        def vector(of: str, axes: str = "xyz", stated: Any = None) -> Exact:
            if f"{of}.{axes[0]}" not in at:
                return exact(stated) / 1000
            return np.array([at[f"{of}.{axis}"] for axis in axes])

        if entry.kind in ("tracker", "pose"):
            point = vector(f"{label}.{variant}" if entry.kind == "tracker" else f"{label}.mount")
            frame, origin = self._frame(at, label, entry)
            position = frame.T @ (place + rotation @ point - origin)
            if entry.kind == "tracker":
                return np.asarray(position)
            mount = [at[f"{label}.mount.r{axis}"] for axis in "xyz"]
            body = frame.T @ rotation @ rotated(np.array(mount)) @ quaternion(entry.mount.guess_quat)
            return np.concatenate([position, body.ravel()])
        if entry.kind in ("laser", "probe"):
            return self._beside(at, flange, entry, target)
        tip = place + rotation @ vector(f"{label}.tip", stated=entry.tip_mm)
        if entry.kind in ("plane", "dial"):
            normal, d = self._plane(at, target)
            if entry.kind == "plane":
                return np.array([normal @ tip - mpf(entry.tip_diameter_mm) / 2000 - d])
            return np.array([(d - normal @ tip) / (normal @ (rotation @ unit(exact(entry.direction))))])
        centre = np.array([at[f"{target}.{axis}"] for axis in "xyz"])
        apart = (tip - centre) @ (tip - centre)
        if entry.kind == "sphere":
            diameter = self.cell.header.targets[target or ""].diameter_mm
            return np.array([apart - (mpf(diameter) / 2000 + mpf(entry.tip_diameter_mm) / 2000) ** 2])
        return np.array([mpmath.sqrt(apart) + at.get(f"{label}.bias", mpf(0))])

    def _beside(self, at: dict[str, mpf], flange: tuple[Exact, Exact], entry: Any, target: Any) -> Exact:
        """Of a probe where the target is from its tip; of a beam how far it passes."""
        (rotation, place), point = flange, exact(entry.point_mm) / 1000
        centre = np.array([at[f"{target}.{axis}"] for axis in "xyz"])
        if entry.kind == "probe":
            shift = np.array(
                [at.get(f"tool.{axis}", value) for axis, value in zip("xyz", point, strict=True)]
            )
            return np.asarray(centre - place - rotation @ shift)
        way = unit(exact(entry.direction))
        b1, b2 = beam_axes(way)
        t1, t2, s1, s2 = (at.get(f"tool.{name}", mpf(0)) for name in ("tilt1", "tilt2", "shift1", "shift2"))
        way = way + mpmath.tan(t1) * b1 + mpmath.tan(t2) * b2
        beam, origin = unit(rotation @ way), place + rotation @ (point + s1 * b1 + s2 * b2)
        passed = cross(beam, centre - origin)
        first = unit(cross(beam, EYE[int(np.argmin(np.abs(beam.astype(float))))]))
        return np.array([first @ passed, cross(beam, first) @ passed])

    def _frame(self, at: dict[str, mpf], label: str, entry: Any) -> tuple[Exact, Exact]:
        if entry.frame != "free":
            return quaternion(entry.frame.quat), exact(entry.frame.xyz_mm) / 1000
        axes = np.array([at[f"{label}.r{axis}"] for axis in "xyz"])
        return rotated(axes), np.array([at[f"{label}.{axis}"] for axis in "xyz"])

    def _plane(self, at: dict[str, mpf], target: str | None) -> tuple[Exact, mpf]:
        nominal = unit(exact(self.cell.header.targets[target or ""].normal))
        b1, b2 = beside(nominal)
        tilts = [mpmath.tan(at[f"{target}.tilt{i}"]) for i in (1, 2)]
        return unit(nominal + tilts[0] * b1 + tilts[1] * b2), at[f"{target}.d"]

    def _met(self, at: dict[str, mpf], q: Exact, reads: tuple[Read, ...]) -> Exact | None:
        """Joints (n,) turned by Newton's least steps until what is met is met."""
        met = tuple(read for read in reads if self.cell.header.instruments[read[0]].kind in _MET_KINDS)
        if not met:
            return q
        moving = np.flatnonzero(self.cell.moving)
        for _ in range(12):
            off = self._read(at, self._flange(at, q), met)
            if max(abs(value) for value in off) < _MET:
                return q
            slope = np.array([self._slope(partial(self._off, at, q, met, k)) for k in moving]).T
            square = slope @ slope.T
            if any(square[i, i] == 0 for i in range(len(square))):
                return None
            try:
                step = mpmath.lu_solve(mpmath.matrix(square), mpmath.matrix(off))
            except ZeroDivisionError:
                return None
            q = q.copy()
            q[moving] -= slope.T @ np.array(list(step))
        return None

    def _off(self, at: dict[str, mpf], q: Exact, reads: tuple[Read, ...], k: int, t: mpf) -> Exact:
        turned = q.copy()
        turned[k] += t
        return self._read(at, self._flange(at, turned), reads)

    @staticmethod
    def _slope(of: Callable[[mpf], Exact]) -> Exact:
        return np.asarray((of(_STEP) - of(-_STEP)) / (2 * _STEP))

    def _by_parameters(self, at: dict[str, mpf], q: Exact, reads: tuple[Read, ...]) -> Exact:
        flange, columns = self._flange(at, q), []
        for item in self.cell.problem.parameters.items:

            def moved(t: mpf, item: Any = item) -> Exact:
                there = {**at, item.name: at[item.name] + t}
                bends = item.group in ("offset", "geometry")
                return self._read(there, self._flange(there, q) if bends else flange, reads)

            columns.append(self._slope(moved))
        return np.array(columns).T


def rotated(vector: Exact) -> Exact:
    """(3, 3) of a rotation vector (3,), by the Cayley form of half its angle."""
    angle = mpmath.sqrt(vector @ vector)
    if angle == 0:
        return EYE
    x, y, z = vector / angle * mpmath.tan(angle / 2)
    k = np.array([[mpf(0), -z, y], [z, mpf(0), -x], [-y, x, mpf(0)]])
    square = 1 + x * x + y * y + z * z
    return np.asarray(EYE + 2 * (k + k @ k) / square)


def quaternion(wxyz: Any) -> Exact:
    w, *v = unit(exact(wxyz))
    axis = np.array(v)
    columns = [2 * (axis @ e) * axis + (w * w - axis @ axis) * e + 2 * w * cross(axis, e) for e in EYE]
    return np.array(columns).T


def beside(n: Exact) -> tuple[Exact, Exact]:
    """b1, b2 across a unit vector n: those of the z axis, turned by the shortest way to n (to -n, and back,
    below the horizon)."""
    sign = 1 if n[2] >= 0 else -1
    up = sign * n
    axis = cross(EYE[2], up)
    turn_to = [e + cross(axis, e) + cross(axis, cross(axis, e)) / (1 + up[2]) for e in EYE[:2]]
    return turn_to[0], sign * turn_to[1]


def at_point(cell: KindsCell, seed: int | None) -> Exact | None:
    """The Jacobian at random values near x (at x without a seed), the shots turned to be met there."""
    problem = cell.problem
    x = cell.x + values_near_by(problem, seed) - problem.nominal()
    near = aim(problem, x, cell.moving)
    return KindsJudge(cell).jacobian(x, near.problem.joints) if near.hit.all() else None
