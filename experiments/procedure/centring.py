"""Stage 2 of the servo: from the PSD's face to its centre, by the PSD's own reading.

J = B' (I - d n' / (d'n)) (dp/dq + t dd/dq): how the spot moves on the PSD's plane by the joints, exact
from the model at what is believed of the arm; B are the PSD's axes. How the spot truly follows corrects it
(Broyden's update).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from ..sensors.psd import BRIGHTEST, LIT, Psd
from .readings import Spot, read_spot
from .rig import MeasurementRefused, RefusalReason, Rig
from .steering import Belief, come_to, step

ENOUGH_MM = 0.005  # far below what the joints' own noise makes of the beam
ACCEPTED_MM = 0.05  # where the arm allows no better
_SAMPLES = 20
_STEPS = 30
_PATIENCE = 4  # steps without getting nearer
_NEARER = 0.8  # of the way that was left, or less, is nearer
_LARGEST = np.radians(2.0)
_TELLING_MM = 0.5  # a step of this length shows whether the spot follows
_FOLLOWS = 0.4  # share of such a step that it does at least: a tetra-lateral PSD falls short at its edge
_CLEAR = 3.0  # stds of what the joints' noise makes of the spot
_STRIKES = 2  # times in a row that it does not: the light is not the beam's


@dataclass(frozen=True, eq=False)
class Centred:
    """`joints` (n,) where the arm was sent last, `off_mm` the distance of the spot from the centre after
    each step."""

    joints: Matrix
    off_mm: tuple[float, ...]


def centre(
    rig: Rig,
    belief: Belief,
    psd: Psd,
    joints: Matrix,
    dark: Matrix,
    frame: Matrix,
    report: Callable[[Matrix], None] = lambda at: None,
) -> Centred:
    """Move the spot to the centre from anywhere on the face; MeasurementRefused if that fails.

    The laser is on; `dark` (4,) are the currents without it, `frame` (3, 3) the PSD's axes in the base
    frame as believed. `report` is called with each position (2,) mm of the spot.
    """
    spot, follows = _on_face(rig, psd, dark), np.eye(2)
    off = [_length(spot.position)]
    report(spot.position)
    # The first position does not count, however near: it was not approached from below.
    nearest, waited = np.inf, 0
    sent_mm, moved_mm, idle = 0.0, 0.0, 0  # mm since the light was known to follow; short steps are added up
    while nearest > ENOUGH_MM and waited < _PATIENCE and len(off) <= _STEPS:
        _, by_joints = belief.spot(joints, frame)
        scatter = _length(by_joints * belief.problem.noise.joint)
        after = step(belief, joints, follows @ by_joints, spot.position, _LARGEST)
        come_to(rig, belief, after)
        sent, before, spot = by_joints @ (after - joints), spot, _on_face(rig, psd, dark)
        joints, moved = after, spot.position - before.position
        off.append(_length(spot.position))
        report(spot.position)
        sent_mm, moved_mm = sent_mm + _length(sent), moved_mm + _length(moved)
        if sent_mm >= _TELLING_MM:
            if moved_mm < _FOLLOWS * sent_mm:
                idle += 1
            else:
                sent_mm, moved_mm, idle = 0.0, 0.0, 0
        if idle == _STRIKES:
            raise MeasurementRefused(
                RefusalReason.NOT_FOLLOWING,
                f"sent by {sent_mm:.1f} mm, the light on the PSD moved by {moved_mm:.1f} mm: a reflection, or"
                " another light",
            )
        # A step that is long compared with the joints' noise, and followed, shows how the spot follows.
        if _length(sent) >= max(_TELLING_MM, _CLEAR * scatter) and idle == 0:
            follows = follows + np.outer(moved - follows @ sent, sent) / (sent @ sent)
        waited = 0 if off[-1] < _NEARER * nearest else waited + 1
        nearest = min(nearest, off[-1])
    # Nearer than the joints' noise alone makes it, the spot is as good as centred: its place is recorded.
    if off[-1] > max(ACCEPTED_MM, scatter):
        raise MeasurementRefused(
            RefusalReason.NOT_CONVERGING, f"the spot stays {off[-1]:.2f} mm off the centre"
        )
    return Centred(joints, tuple(off))


def _length(vector: Matrix) -> float:
    return float(np.linalg.norm(vector))


def _on_face(rig: Rig, psd: Psd, dark: Matrix) -> Spot:
    spot = read_spot(rig, psd, dark, _SAMPLES)
    if spot.light < LIT:
        raise MeasurementRefused(RefusalReason.OFF_FACE, "the beam has left the PSD's face")
    if spot.light > BRIGHTEST:
        raise MeasurementRefused(
            RefusalReason.TOO_BRIGHT,
            f"{spot.light:.1f} times the laser's light: there is a second light on the PSD",
        )
    return spot
