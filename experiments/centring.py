"""Stage 2 of the servo: from the PSD's face to its centre, by the PSD's own reading.

J = B' (I - d n' / (d'n)) (dp/dq + t dd/dq): how the spot moves on the PSD's plane by the joints, exact
from the model at what is believed of the arm; B are the PSD's axes. How the spot truly follows corrects it
(Broyden's update).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..model.robot import Matrix
from .psd import Psd
from .readings import Spot, read_spot
from .refused import Reason, Refused
from .rigs.rig import Rig
from .search import LIT
from .steering import Belief, come_to, step

ENOUGH_MM = 0.005  # far below what the joints' own noise makes of the beam
ACCEPTED_MM = (
    0.05  # where the arm's resolution or its play allow no better; the reading is recorded in any case
)
WEAKEST, BRIGHTEST = 0.5, 1.5  # share of the laser's light that a beam on the centre may have
_SAMPLES = 20
_STEPS = 30
_PATIENCE = 4  # steps without getting nearer
_LARGEST = np.radians(2.0)
_TELLING_MM = 0.5  # steps of this length tell whether the spot follows
_ASTRAY = 0.6  # share of such a step by which it may differ
_NEAR_MM = 1.0  # from here on the arm comes to every stand from the same side
_STRIKES = 2  # such steps in a row: the light is not the beam's


@dataclass(frozen=True, eq=False)
class Centred:
    """`joints` (n,) where the arm was sent, `off_mm` how far off the spot was before each step and at last."""

    joints: Matrix
    off_mm: tuple[float, ...]


def centre(
    rig: Rig,
    belief: Belief,
    psd: Psd,
    joints: Matrix,
    dark: Matrix,
    frame: Matrix,
    told: Callable[[float], None] = lambda off: None,
) -> Centred:
    """Lead the spot to the centre from wherever it is on the face; Refused with the reason if it cannot be.

    The laser is on; `dark` (4,) are the currents without it, `frame` (3, 3) the PSD's axes in the base
    frame as believed. `told` hears how far off the spot is.
    """
    spot = _on_face(rig, psd, dark)
    off = [_length(spot.position)]
    told(off[0])
    nearest, at_nearest, waited, astray = off[0], joints, 0, 0
    follows = np.eye(2)
    while nearest > ENOUGH_MM and waited < _PATIENCE and len(off) <= _STEPS:
        by_joints = frame[:, :2].T @ belief.call("hit", joints, belief.tool, belief.target, frame[:, 2])[2]
        after = step(belief, joints, follows @ by_joints, spot.position, _LARGEST)
        sent = by_joints @ (after - joints)
        if off[-1] > _NEAR_MM:
            rig.move(after)
        else:
            come_to(rig, belief, after)
        joints, before, spot = after, spot, _on_face(rig, psd, dark)
        moved = spot.position - before.position
        if _length(sent) >= _TELLING_MM:
            missing = moved - follows @ sent
            astray = astray + 1 if _length(missing) > _ASTRAY * _length(sent) else 0
            if astray == _STRIKES:
                raise Refused(
                    Reason.NOT_FOLLOWING,
                    f"sent by {_length(sent):.1f} mm, the light on the PSD moved by {_length(moved):.1f} mm:"
                    " a reflection, or another light",
                )
            follows = follows + np.outer(missing, sent) / (sent @ sent)
        off.append(_length(spot.position))
        told(off[-1])
        waited = 0 if off[-1] < 0.8 * nearest else waited + 1
        if off[-1] < nearest:
            nearest, at_nearest = off[-1], joints
    if nearest > ACCEPTED_MM:
        raise Refused(Reason.NOT_CONVERGING, f"the spot came no nearer to the centre than {nearest:.2f} mm")
    if at_nearest is not joints:
        come_to(rig, belief, at_nearest)
    return Centred(at_nearest, tuple(off))


def _length(vector: Matrix) -> float:
    return float(np.linalg.norm(vector))


def _on_face(rig: Rig, psd: Psd, dark: Matrix) -> Spot:
    spot = read_spot(rig, psd, dark, _SAMPLES)
    if spot.light < LIT:
        raise Refused(Reason.OFF_FACE, "the beam has left the PSD's face")
    if spot.light > BRIGHTEST:
        raise Refused(
            Reason.TOO_BRIGHT, f"{spot.light:.1f} times the laser's light: there is a second light on the PSD"
        )
    return spot
