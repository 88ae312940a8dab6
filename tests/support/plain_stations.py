"""What each kind of instrument reads a second time: plain numpy from the equations, at one flange pose."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from zerobeam.model.instruments.kind import Flange
from zerobeam.model.instruments.registry import STATIONS
from zerobeam.model.parsing.validation import validate

NORMAL = np.array([0.1, -0.2, 0.9])


@dataclass
class Target:
    guess_mm: tuple[float, float, float] | None = (800.0, 100.0, 300.0)
    sigma_mm: float = 20.0
    sigma_deg: float = 5.0
    normal: tuple[float, float, float] | None = tuple(NORMAL)
    diameter_mm: float | None = 30.0


STATED = {
    "tracker": {
        "sigma_mm": {"constant": 0.02, "per_m": 0.01},
        "reflectors": {"A": {"guess_mm": [10.0, 20, 30], "sigma_mm": 0.5}, "B": {}},
    },
    "pose": {"sigma_mm": 0.05, "sigma_deg": 0.02, "mount": {"guess_quat": [0.5, 0.5, -0.5, 0.5]}},
    "plane": {"tip_mm": [5.0, -3, 120], "sigma_mm": 0.01, "tip_diameter_mm": 6.0},
    "sphere": {"tip_mm": [5.0, -3, 120], "sigma_mm": 0.01, "tip_diameter_mm": 6.0},
    "ballbar": {"tip_mm": [5.0, -3, 120], "sigma_mm": 0.01, "bias": "free"},
    "dial": {"tip_mm": [5.0, -3, 120], "sigma_mm": 0.01, "direction": [0.1, 0.2, 2.0]},
}
KNOWN = {"xyz_mm": [2000.0, -500, 300], "quat": [0.6, 0, 0.8, 0]}
WITHIN = {**KNOWN, "sigma_mm": 2.0, "sigma_deg": 0.5}


def station(kind, *, exact=False, **other):
    """An instrument `S` of a kind as a header states it, with other keys."""
    content = {"kind": kind, **STATED[kind], **other}
    stated = validate(STATIONS[kind].Stated, content, file=None, line=lambda key: None)
    return STATIONS[kind].of("S", stated, exact=exact)


def random_rotation(rng):
    """(3, 3), its angle up to 180°."""
    return Rotation.random(random_state=rng).as_matrix()


def poses(rng, count):
    """(N, 4, 4) of a flange."""
    result = np.tile(np.eye(4), (count, 1, 1))
    result[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()
    result[:, :3, 3] = np.array([900, 0, 700]) + rng.uniform(-400, 400, (count, 3))
    return result


def frame(instrument, unknowns):
    known = Rotation.from_quat([*KNOWN["quat"][1:], KNOWN["quat"][0]])
    match instrument.frame.known:
        case "exact":
            return known.as_matrix(), np.array(KNOWN["xyz_mm"])
        case "stated":
            return (Rotation.from_rotvec(unknowns[-3:]) * known).as_matrix(), unknowns[-6:-3]
        case _:
            return Rotation.from_rotvec(unknowns[-3:]).as_matrix(), unknowns[-6:-3]


def across(n):
    """Two unit vectors across (3,): the z axis turned to n the shortest way, and x, y with it."""
    sign = -1.0 if n[2] < 0 else 1.0
    turn = Rotation.align_vectors([n], [[0, 0, sign]])[0].as_matrix()
    v = np.cross([0, 0, sign], n)
    half = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turn = np.eye(3) + half + half @ half / (1 + sign * n[2])
    return turn[:, 0], sign * turn[:, 1]


def plain_residual(instrument, pose, target, unknowns, reading, variant):
    """(d,) what is predicted less what was read."""
    turn, at = pose[:3, :3], pose[:3, 3]
    match instrument.name:
        case "tracker":
            i = 3 * list(instrument.variants).index(variant)
            frame_turn, origin = frame(instrument, unknowns)
            return frame_turn.T @ (turn @ unknowns[i : i + 3] + at - origin) - reading[:3]
        case "pose":
            frame_turn, origin = frame(instrument, unknowns)
            q = STATED["pose"]["mount"]["guess_quat"]
            mount = Rotation.from_rotvec(unknowns[3:6]) * Rotation.from_quat([*q[1:], q[0]])
            predicted = frame_turn.T @ turn @ mount.as_matrix()
            measured = Rotation.from_quat([*reading[4:7], reading[3]]).as_matrix()
            vector = Rotation.from_matrix(predicted @ measured.T).as_rotvec()
            return np.append(frame_turn.T @ (turn @ unknowns[:3] + at - origin) - reading[:3], vector)
    tip = turn @ (unknowns[:3] if instrument.tip_std else np.array([5.0, -3, 120])) + at
    if instrument.name in ("plane", "dial"):
        n0 = NORMAL / np.linalg.norm(NORMAL)
        b1, b2 = across(n0)
        n = n0 + np.tan(target[1]) * b1 + np.tan(target[2]) * b2
        n = n / np.linalg.norm(n)
        if instrument.name == "plane":
            return np.array([n @ tip - 3.0 - target[0]])
        u = turn @ np.array([0.1, 0.2, 2.0]) / np.linalg.norm([0.1, 0.2, 2.0])
        return np.array([(target[0] - n @ tip) / (n @ u) - reading[0]])
    length = np.linalg.norm(tip - target)
    if instrument.name == "sphere":
        return np.array([length - 3.0 - 15.0])
    return np.array([length + (unknowns[-1] if instrument.bias is None else instrument.bias) - reading[0]])


def functions(instrument, variant):
    """The residual with its Jacobian by flange (column by column, 12), target and unknowns; and the reading
    that leaves none."""
    flange, target = ca.SX.sym("flange", 3, 4), ca.SX.sym("target", 3)
    unknowns = ca.SX.sym("unknowns", len(instrument.unknowns))
    reading = ca.SX.sym("reading", instrument.reading_size)
    arguments = (Flange(flange[:, :3], flange[:, 3]), target, unknowns, reading, variant)
    residual = instrument.residual(*arguments)
    jacobians = [ca.jacobian(residual, each) for each in (ca.vec(flange), target, unknowns)]
    inputs = [flange, target, unknowns, reading]
    return (
        ca.Function("residual", inputs, [residual, *jacobians]),
        ca.Function("predicted", inputs, [instrument.predicted(*arguments)]),
    )


def random_unknowns(instrument, rng, *, free=True):
    """(k,) near their means where they are knowledge; frames, mounts and reflectors anywhere if `free`."""
    result = []
    for each in instrument.unknowns:
        if each.tolerated or not free:
            result.append(each.mean + each.std * rng.normal())
        else:
            result.append(each.mean + (rng.uniform(-300, 300) if each.unit == "mm" else 0.0))
    vectors = [i for i, each in enumerate(instrument.unknowns) if each.axis == "rx" and not each.tolerated]
    for i in vectors:
        result[i : i + 3] = Rotation.from_matrix(random_rotation(rng)).as_rotvec()
    return np.array(result)
