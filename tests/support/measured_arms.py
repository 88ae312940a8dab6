"""What instruments of every kind read of arms at random: a simulator of its own.

Plain numpy on the arms of `deviating_arms`, no code of the package. A cell is what a header states and what
is measured in turn, posture by posture; the world is drawn for each arm. Angles are rad, lengths mm.
"""

import copy
import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from deviating_arms import Arms, N, Sizes

from zerobeam.model.files.header import Header, header_content
from zerobeam.model.instruments.kind import Measurement

SIGMA_MM, SIGMA_DEG = 0.05, 0.01
TIP = [30.0, 0.0, 120.0]
KNOWN_FRAME = {"xyz_mm": [3000.0, 500.0, 800.0], "quat": [0.8, 0.0, 0.0, 0.6]}
STATED_FRAME = {**KNOWN_FRAME, "sigma_mm": 0.3, "sigma_deg": 0.02}
_LOWER, _UPPER = np.radians([[-60, -20, -40, -120, -90, -150], [60, 50, 30, 120, 90, 150]])
_GUESSES = {"R1": [50, 0, 30], "R2": [-50, 40, 30], "R3": [0, -60, 60]}
_HIT_MM = 1e-9

PLANES = {
    "top": {"kind": "plane", "normal": [0, 0, 1], "guess_mm": [900, 0, 300], "sigma_mm": 100},
    "side": {"kind": "plane", "normal": [1, 0, 0], "guess_mm": [1100, 0, 300], "sigma_mm": 100},
    "front": {"kind": "plane", "normal": [0, 1, 0], "guess_mm": [1000, -300, 300], "sigma_mm": 100},
}
BALL = {"ball": {"kind": "sphere", "diameter_mm": 40, "guess_mm": [900, 100, 400], "sigma_mm": 50}}
SOCKETS = {
    "s1": {"guess_mm": [900, 200, 100], "sigma_mm": 50},
    "s2": {"guess_mm": [700, -400, 50], "sigma_mm": 50},
}
SPOT = {"spot": {"guess_mm": [900, 0, 200], "sigma_mm": 50}}


def tracker(frame: Any = "free", sigma_mm: float | None = None) -> dict[str, Any]:
    """A tracker with three reflectors, known to `sigma_mm` or only guessed."""
    tolerance = {} if sigma_mm is None else {"sigma_mm": sigma_mm}
    reflectors = {name: {"guess_mm": guess, **tolerance} for name, guess in _GUESSES.items()}
    return {"kind": "tracker", "frame": frame, "sigma_mm": SIGMA_MM, "reflectors": reflectors}


def tip(kind: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "tip_mm": TIP, "sigma_mm": SIGMA_MM, **more}


POSE = {"kind": "pose", "frame": "free", "sigma_mm": SIGMA_MM, "sigma_deg": SIGMA_DEG, "mount": {}}
LASER = {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
BAR, DIAL = tip("ballbar", bias="free"), tip("dial", direction=[0, 0, 1])

Read = tuple[str, str, str | None]  # label of an instrument, variant, target


@dataclass(frozen=True)
class Cell:
    """What a header states of instruments and targets, and what is read at each posture in turn. With
    `square_deg` its three planes are the faces of a cube whose right angles are true to that."""

    instruments: dict[str, Any]
    targets: dict[str, Any]
    turns: tuple[tuple[Read, ...], ...]
    tool: dict[str, Any] | None = None
    square_deg: float | None = None

    @property
    def angles(self) -> list[dict[str, Any]]:
        """The right angles of a cube, as a header states them."""
        if self.square_deg is None:
            return []
        pairs = itertools.combinations(self.targets, 2)
        return [{"between": list(pair), "deg": 90, "sigma_deg": self.square_deg} for pair in pairs]

    def header(
        self, *, geometry: str | None, joint_deg: float, understated: float = 1.0, **more: Any
    ) -> Header:
        """With stds of readings that are `understated` so many times."""
        instruments = copy.deepcopy(self.instruments)
        for entry in instruments.values():
            for key in {"sigma_mm", "sigma_deg"} & entry.keys():
                entry[key] /= understated
        content = {
            "robot": "irb1600",
            "instruments": instruments,
            "targets": self.targets,
            "angles": self.angles,
            "noise": {"joint_deg": joint_deg} | ({"spot_mm": SIGMA_MM / understated} if self.tool else {}),
            **({"tool": self.tool} if self.tool else {}),
            **({"geometry": geometry} if geometry else {}),
            **more,
        }
        return Header.model_validate({key: value for key, value in content.items() if value})


def _reads(label: str, *names: str) -> tuple[Read, ...]:
    return tuple((label, name, None) for name in names)


def _touches(label: str, targets: dict[str, Any]) -> tuple[tuple[Read, ...], ...]:
    return tuple(((label, "", name),) for name in targets)


_TRACKED = (_reads("leica", "R1"), _reads("leica", "R1", "R2", "R3"))
CELLS = {
    "laser": Cell({}, SPOT, ((("tool", "", "spot"),),), LASER),
    "probe": Cell(
        {}, SPOT, ((("tool", "", "spot"),),), {"kind": "probe", "calibrated": True, "point_mm": TIP}
    ),
    "tracker": Cell({"leica": tracker()}, {}, _TRACKED),
    "tracker, frame known": Cell({"leica": tracker(KNOWN_FRAME, 0.05)}, {}, _TRACKED),
    "tracker, frame stated": Cell({"leica": tracker(STATED_FRAME)}, {}, _TRACKED),
    "pose": Cell({"tmac": POSE}, {}, (_reads("tmac", ""),)),
    "pose, frame stated": Cell({"tmac": {**POSE, "frame": STATED_FRAME}}, {}, (_reads("tmac", ""),)),
    "plane": Cell({"tip": tip("plane")}, PLANES, _touches("tip", PLANES)),
    "cube": Cell({"tip": tip("plane")}, PLANES, _touches("tip", PLANES), square_deg=0.003),
    "sphere": Cell({"tip": tip("sphere")}, BALL, _touches("tip", BALL)),
    "ballbar": Cell({"bar": BAR}, SOCKETS, _touches("bar", SOCKETS)),
    "dial": Cell({"dial": DIAL}, PLANES, _touches("dial", PLANES)),
    "laser + tracker": Cell(
        {"leica": tracker()}, SPOT, ((("tool", "", "spot"),), *_TRACKED), LASER
    ),
    "tracker + plane + ballbar": Cell(
        {"leica": tracker(), "tip": tip("plane"), "bar": BAR},
        {**PLANES, **SOCKETS},
        (*_TRACKED, *_touches("tip", PLANES), *_touches("bar", SOCKETS)),
    ),
}  # fmt: skip


def rotation_about(vector: np.ndarray) -> np.ndarray:
    """(3, 3) of a rotation vector (3,), by Rodrigues."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def _matrix(quat: list[float]) -> np.ndarray:
    w, v = quat[0], np.array(quat[1:])
    angle = 2 * np.arctan2(np.linalg.norm(v), w)
    return rotation_about(angle * v / (np.linalg.norm(v) or 1.0))


def _quat(turn: np.ndarray) -> list[float]:
    """[w, x, y, z] of a rotation (3, 3): the eigenvector to the largest eigenvalue (Bar-Itzhack 2000)."""
    t = turn
    k = np.array(
        [
            [t[0, 0] + t[1, 1] + t[2, 2], t[2, 1] - t[1, 2], t[0, 2] - t[2, 0], t[1, 0] - t[0, 1]],
            [0, t[0, 0] - t[1, 1] - t[2, 2], t[0, 1] + t[1, 0], t[0, 2] + t[2, 0]],
            [0, 0, t[1, 1] - t[0, 0] - t[2, 2], t[1, 2] + t[2, 1]],
            [0, 0, 0, t[2, 2] - t[0, 0] - t[1, 1]],
        ]
    )
    vector = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    return [float(value) for value in vector]


class World:
    """Where everything is, drawn about what a cell states; `off_mm` by how much R2 is off besides."""

    def __init__(self, cell: Cell, rng: np.random.Generator, *, exact: bool, off_mm: float = 0.0) -> None:
        self.rng = rng
        self.entries = dict(cell.instruments)
        if cell.tool:
            self.entries["tool"] = cell.tool
        self.frames: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.points: dict[tuple[str, str], np.ndarray] = {}
        self.mounts, self.bias, self.directions = {}, {}, {}
        for label, entry in self.entries.items():
            frame = entry.get("frame")
            if frame == "free":
                self.frames[label] = rotation_about(rng.normal(size=3)), 2000 * rng.normal(size=3)
            elif frame:
                turn, origin = _matrix(frame["quat"]), np.array(frame["xyz_mm"])
                if "sigma_mm" in frame:
                    turn = rotation_about(np.radians(frame["sigma_deg"]) * rng.normal(size=3)) @ turn
                    origin = origin + frame["sigma_mm"] * rng.normal(size=3)
                self.frames[label] = turn, origin
            for name, reflector in entry.get("reflectors", {}).items():
                point = np.array(reflector["guess_mm"], float)
                self.points[label, name] = point + reflector.get("sigma_mm", 20.0) * rng.normal(size=3)
                if name == "R2":
                    self.points[label, name][0] += off_mm
            if entry["kind"] == "pose":
                self.points[label, ""] = 60 * rng.normal(size=3)
                self.mounts[label] = rotation_about(rng.normal(size=3))
            if "tip_mm" in entry:
                drawn = 0.0 if exact else 0.1
                self.points[label, ""] = np.array(entry["tip_mm"]) + drawn * rng.normal(size=3)
            if "point_mm" in entry:
                shift, tilt = (0.0, 0.0) if exact else (0.1, np.radians(0.05))
                self.points[label, ""] = np.array(entry["point_mm"]) + shift * rng.normal(size=3)
                along = np.array(entry.get("direction", [0, 0, 0]), float)
                self.directions[label] = along + tilt * np.cross(along, rng.normal(size=3))
            if "bias" in entry:
                self.bias[label] = 30 * rng.normal()
            if "direction" in entry and label != "tool":
                self.directions[label] = np.array(entry["direction"], float)
        self.targets: dict[str, Any] = {}
        for name, target in cell.targets.items():
            at = np.array(target["guess_mm"], float) + 20 * rng.normal(size=3)
            if target.get("kind") == "plane":
                normal = np.array(target["normal"]) + 0.03 * rng.normal(size=3)
                self.targets[name] = at, normal / np.linalg.norm(normal)
            else:
                self.targets[name] = at, target.get("diameter_mm", 0.0) / 2
        if cell.square_deg is not None:
            normals = np.array([normal for _, normal in self.targets.values()])
            left, _, right = np.linalg.svd(normals)
            normals = left @ right + np.radians(cell.square_deg) / np.sqrt(2) * rng.normal(size=(3, 3))
            for (name, (at, _)), normal in zip(list(self.targets.items()), normals, strict=True):
                self.targets[name] = at, normal / np.linalg.norm(normal)

    def met(self, label: str) -> bool:
        return self.entries[label]["kind"] in ("laser", "probe", "plane", "sphere")

    def off(self, read: Read, flange: np.ndarray) -> np.ndarray:
        """(..., d) mm that the joints bring to the noise, of flange poses (..., 4, 4)."""
        label, _, target = read
        at, more = self.targets[target or ""]
        turn = flange[..., :3, :3]
        beside = flange[..., :3, 3] + turn @ self.points[label, ""] - at
        kind = self.entries[label]["kind"]
        if kind == "plane":
            return np.asarray((beside @ more)[..., None])
        if kind == "sphere":
            return np.asarray(np.linalg.norm(beside, axis=-1)[..., None] - more)
        in_flange = np.swapaxes(turn, -1, -2) @ beside[..., None]
        return self._across(in_flange[..., 0], self.directions[label])

    @staticmethod
    def _across(beside: np.ndarray, along: np.ndarray) -> np.ndarray:
        if not along.any():
            return beside
        along = along / np.linalg.norm(along)
        b1 = np.cross(along, [0.0, 0.0, 1.0])
        b1 /= np.linalg.norm(b1)
        return np.stack([beside @ b1, beside @ np.cross(along, b1)], axis=-1)

    def reading(self, read: Read, flange: np.ndarray) -> dict[str, tuple[float, ...]]:
        """With noise, at a flange pose (4, 4)."""
        label, variant, target = read
        entry, rng = self.entries[label], self.rng
        point = flange[:3, 3] + flange[:3, :3] @ self.points[label, variant]
        kind = entry["kind"]
        if kind in ("tracker", "pose"):
            turn, origin = self.frames[label]
            position = turn.T @ (point - origin) + SIGMA_MM * rng.normal(size=3)
            result = {"measured_mm": tuple(position.tolist())}
            if kind == "pose":
                noise = rotation_about(np.radians(SIGMA_DEG) * rng.normal(size=3))
                body = noise @ turn.T @ flange[:3, :3] @ self.mounts[label]
                result["measured_quat"] = tuple(_quat(body))
            return result
        if kind == "ballbar":
            length = float(np.linalg.norm(point - self.targets[target or ""][0])) + self.bias[label]
        elif kind == "dial":
            at, normal = self.targets[target or ""]
            along = flange[:3, :3] @ self.directions[label]
            length = float(normal @ (at - point) / (normal @ along))
        else:
            return {}
        return {"measured_mm": (length + SIGMA_MM * rng.normal(),)}

    def usable(self, read: Read, flange: np.ndarray) -> bool:
        """Whether a dial is within 60° of the normal, and a laser's target lies before it."""
        label, _, target = read
        along = flange[:3, :3] @ self.directions[label] if label in self.directions else np.zeros(3)
        if self.entries[label]["kind"] == "dial":
            return bool(abs(along @ self.targets[target or ""][1]) > 0.5)
        if self.entries[label]["kind"] == "laser":
            point = flange[:3, 3] + flange[:3, :3] @ self.points[label, ""]
            return bool(along @ (self.targets[target or ""][0] - point) > 100)
        return True


@dataclass(frozen=True, eq=False)
class Recorded:
    """Joints (S, n) rad and what was measured at each posture; true `offsets` (n,) rad."""

    joints: np.ndarray
    measured: list[list[Measurement]]
    offsets: np.ndarray


def recorded(
    cell: Cell,
    count: int,
    rng: np.random.Generator,
    *,
    exact: bool,
    joint_deg: float,
    off_mm: float = 0.0,
    **sizes_of_arm: float,
) -> Recorded:
    """`count` postures of an arm drawn at random, exact or typical but for `sizes_of_arm` (of `Sizes`)."""
    sizes = Sizes(joint_noise_deg=joint_deg, **sizes_of_arm)
    arm = Arms.at_random(1, rng, replace(sizes.times(0.0), lost_deg=0.0) if exact else sizes)
    first = (
        np.radians(rng.normal())
        * all(entry.get("frame") not in (None, "free") for entry in cell.instruments.values())
        * bool(cell.instruments)
    )
    offsets = arm.offsets.copy()
    offsets[:, 0] = first
    arm = replace(arm, offsets=offsets)
    world = World(cell, rng, exact=exact, off_mm=off_mm)
    joints: list[np.ndarray] = []
    measured: list[list[Measurement]] = []
    half = np.radians(arm.sizes.lost_deg) / 2
    while len(joints) < count:
        turn = cell.turns[len(joints) % len(cell.turns)]
        q = _met(arm, world, turn[0], rng) if world.met(turn[0][0]) else rng.uniform(_LOWER, _UPPER)
        if q is None:
            continue
        flange = _flange(arm, q[None])[0]
        if not all(world.usable(read, flange) for read in turn):
            continue
        noise = np.radians(joint_deg) * rng.normal(size=N) + half * rng.choice([-1.0, 1.0], size=N)
        joints.append(q + noise)
        measured.append([Measurement(*read, world.reading(read, flange)) for read in turn])
    return Recorded(np.array(joints), measured, arm.offsets[0])


def cube_run(path: Path, touches: int = 30) -> Path:
    """A run file of an exact arm that touched the faces of a cube."""
    cell = CELLS["cube"]
    arm = recorded(cell, touches, np.random.default_rng(5), exact=True, joint_deg=0.002)
    lines = [header_content(cell.header(geometry="exact", joint_deg=0.002), "zerobeam/run/1")]
    for joints, (item,) in zip(arm.joints, arm.measured, strict=True):
        lines.append({"shot": len(lines), "target": item.target, "joints_deg": np.degrees(joints).tolist()})
    path.write_text("\n".join(map(json.dumps, lines)) + "\n", encoding="utf-8")
    return path


def _flange(arm: Arms, q: np.ndarray) -> np.ndarray:
    """(S, 4, 4) at joints (S, n)."""
    bends = arm.gravity.any() or arm.harmonics.any()
    true = arm.bent(q[None]) if bends else q[None] + arm.offsets[:, None]
    return np.asarray(arm.frames(true)[-1][0])


def _met(arm: Arms, world: World, read: Read, rng: np.random.Generator) -> np.ndarray | None:
    """(n,) joints turned until what is met is met up to its noise; None where they do not get there."""
    q, step = rng.uniform(_LOWER, _UPPER), 1e-6
    wanted = None
    for _ in range(40):
        every = world.off(read, _flange(arm, np.vstack([q, q + step * np.eye(N)])))
        if wanted is None:
            wanted = SIGMA_MM * rng.normal(size=every.shape[-1])
        left = every[0] - wanted
        if np.linalg.norm(left) < _HIT_MM * 1e3:
            inside = (q > _LOWER - 0.5).all() and (q < _UPPER + 0.5).all()
            return q if inside else None
        turn = -np.linalg.pinv((every[1:] - every[0]).T / step, rcond=1e-6) @ left
        q = q + turn * min(1.0, 0.2 / float(np.abs(turn).max()))
    return None
