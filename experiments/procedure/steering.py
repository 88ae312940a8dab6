"""Bringing a beam to a PSD by the wrist: the search for its face, then the way to its centre; what is
believed of arm and target, and steps that stay within the limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...analysis.observability.aim import aim, servo_joints
from ...interruption import obey
from ...model.arrays import Matrix
from ...model.kinematics.pendant import beyond_limits
from ...model.likelihood.problem import Problem
from ..sensors.detectors import BRIGHTEST, LIT, Camera, Image, Psd
from ..sensors.markers import NoPair, Pair, blobs, is_black, marker_pair, spot_between
from .rig import MeasurementRefused, RefusalReason, Rig, Spot, read_spot

FROM_BELOW = 0.05  # deg (mm): more than the the backlash of sound gears
_DAMPING = 1e-6  # of the largest eigenvalue: keeps a step across a singular direction short


@dataclass(frozen=True, eq=False)
class Belief:
    """Believed parameters for one measurement: `problem` (of that one measurement), offsets,
    tool and the target at `x` (p,), internal units."""

    problem: Problem
    x: Matrix

    @property
    def delta(self) -> Matrix:
        return self.problem.split(self.x).arm

    @property
    def tool(self) -> Matrix:
        return self.problem.split(self.x).tool

    @property
    def target(self) -> Matrix:
        """(3,) mm, base frame."""
        return np.asarray(self.problem.split(self.x).targets[self.problem.target_index[0]])

    @property
    def wrist(self) -> Matrix:
        """(n,) weights of the joints that the servo turns."""
        return np.asarray(servo_joints(self.problem)[0])

    def with_target(self, target: Matrix) -> Belief:
        """A copy with the target at (3,) mm."""
        x = self.x.copy()
        x[self.problem.parameters.block("target", int(self.problem.target_index[0]))] = target
        return replace(self, x=x)

    def call(self, name: str, joints: Matrix, *inputs: Matrix) -> list[Matrix]:
        """A function of the measurement at `joints` (n,) and the believed offsets, without the axis of
        rows."""
        outputs = self.problem.functions.kernel(name)(joints, self.delta, *inputs)
        return [np.asarray(value[0]) for value in outputs]

    def beam(self, joints: Matrix) -> tuple[Matrix, Matrix]:
        """Origin (3,) mm and direction (3,) of the beam, base frame."""
        origin, direction = self.call("beam", joints, self.tool)
        return origin, direction

    def spot(self, joints: Matrix, frame: Matrix) -> tuple[Matrix, Matrix]:
        """(2,) mm where the beam meets the face of the axes `frame` (3, 3), and (2, n) mm/rad (mm) how that
        moves by the joints."""
        point, _, by_joints = self.call("hit", joints, self.tool, self.target, frame[:, 2])
        return frame[:, :2].T @ (point - self.target), frame[:, :2].T @ by_joints

    def flange(self, joints: Matrix) -> tuple[Matrix, Matrix]:
        """Rotation (3, 3) and place (3,) mm of the flange in the base frame."""
        (places,) = self.problem.functions.kernel("place")(joints, self.delta, np.eye(4, 3, -1))
        return np.asarray((places[1:] - places[0]).T), np.asarray(places[0])

    def turned(self, joints: Matrix, vectors: Matrix) -> Matrix:
        """(..., 3) the directions `vectors` (..., 3) of the base frame as seen from the flange."""
        return np.asarray(vectors @ self.flange(joints)[0])

    def onto_target(self, joints: Matrix) -> Matrix | None:
        """(n,) the joints with the wrist turned onto the target; None where the limits do not allow it."""
        aimed = aim(self.problem.moved(joints[None]), self.x, self.wrist)
        after, robot = aimed.problem.joints[0], self.problem.robot
        inside = not beyond_limits(robot, after, 0.0).any()
        return after if aimed.hit[0] and aimed.ahead[0] and inside else None


def come_to(rig: Rig, belief: Belief, joints: Matrix) -> None:
    """Drive there so that every joint comes from below.

    The backlash of the gears is then taken up on the same side in every measurement: a part of the offsets,
    not a scatter (unidirectional approach, as ISO 9283 has it for its poses).
    """
    robot = belief.problem.robot
    for there in (np.maximum(joints - FROM_BELOW / robot.display, robot.lower), joints):
        obey()
        rig.move(there)


def step(belief: Belief, joints: Matrix, jacobian: Matrix, error: Matrix, largest: float) -> Matrix:
    """(n,) the joints after a damped step that takes `error` (2,) away, with the smallest rotation of the
    wrist.

    `jacobian` (2, n) is that of the error by the joints; no joint turns by more than `largest` (rad; of a
    prismatic one as a share of a metre). A joint at its limit is left there and the others do its part;
    MeasurementRefused where they cannot.
    """
    robot, weights = belief.problem.robot, belief.wrist.copy()
    scale = np.where(robot.display > 1, 1.0, 1000.0)
    while np.count_nonzero(weights) >= len(error):
        weighted = jacobian * (weights * scale**2)
        gram = weighted @ jacobian.T
        damped = gram + _DAMPING * np.linalg.eigvalsh(gram)[-1] * np.eye(2)
        turn = -weighted.T @ np.linalg.solve(damped, error)
        turn *= min(1.0, largest / max(float(np.abs(turn / scale).max()), 1e-300))
        after = joints + turn
        outside = (weights > 0) & beyond_limits(robot, after, 0.0)
        if not outside.any():
            return np.asarray(after)
        weights[outside] = 0.0
    raise MeasurementRefused(RefusalReason.LIMIT, "the wrist would have to go beyond a joint's limit")


# Stage 2 of the servo: from the PSD's face to its centre, by the PSD's own reading.
#
# J = B' (I - d n' / (d'n)) (dp/dq + t dd/dq): how the spot moves on the PSD's plane by the joints, exact
# from the model at what is believed of the arm; B are the PSD's axes. How the spot truly follows corrects
# it (Broyden's update).

ENOUGH_MM = 0.005  # far below what the joints' own noise makes of the beam
ACCEPTED_MM = 0.05  # where the arm allows no better
_CENTRING_SAMPLES = 20
_STEPS = 30
_PATIENCE = 4  # steps without getting nearer
_NEARER = 0.8  # of the way that was left, or less, is nearer
_LARGEST_ON_FACE = np.radians(2.0)
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
        after = step(belief, joints, follows @ by_joints, spot.position, _LARGEST_ON_FACE)
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
    spot = read_spot(rig, psd, dark, _CENTRING_SAMPLES)
    if spot.light < LIT:
        raise MeasurementRefused(RefusalReason.OFF_FACE, "the beam has left the PSD's face")
    if spot.light > BRIGHTEST:
        raise MeasurementRefused(
            RefusalReason.TOO_BRIGHT,
            f"{spot.light:.1f} times the laser's light: there is a second light on the PSD",
        )
    return spot


# Stage 1 of the servo: from an initial posture until the beam is on the PSD's face.
#
# With a camera: the two LEDs in the picture say where the PSD's centre is; the wrist is turned until the
# beam points there, by the image Jacobian. Where that ends off the face, the spot itself is led there in
# pictures with and without the laser. Without a camera, or where its pictures do not help, the beam goes in
# a spiral.

_SEARCH_SAMPLES = 8
_LOOKS = 40
_DARK_IMAGES = 3
_LARGEST_IN_SEARCH = np.radians(10.0)
_ON_CENTRE = 1.5  # px: nearer than this the pictures need not bring the beam
_AROUND = 8  # directions in which the markers are looked for
_SPIRAL_STEP = 0.7  # of the face's size: no hole, however the face is turned about its normal
_FARTHEST = 130.0  # mm across the beam, radius of the spiral
_SLANT = 0.3  # cosine of the incidence up to which the spiral is drawn out


class Search:
    """The search of one measurement, to begin with the laser off. `joints` (n,) is where the arm was sent
    last, `belief` knows the target better after pictures, `left` is why pictures could not help (None if they
    did)."""

    def __init__(self, rig: Rig, belief: Belief, psd: Psd, joints: Matrix, dark: Matrix) -> None:
        self._rig, self._psd, self._dark = rig, psd, dark
        self.belief, self.joints = belief, joints
        self.left: MeasurementRefused | None = None

    def run(self) -> None:
        """Bring the beam onto the face; MeasurementRefused with the reason if it cannot be."""
        camera = self._rig.camera
        if camera is not None:
            try:
                self._by_markers(camera)
            except MeasurementRefused as refused:
                self.left = refused
        self._rig.laser(True)
        if self._lit():
            return
        if camera is not None and self.left is None:
            try:
                if self._by_spot(camera):
                    return
            except MeasurementRefused as refused:
                self.left = refused
        if not self._by_spiral():
            raise self.left or MeasurementRefused(
                RefusalReason.OFF_FACE, "the beam did not find the PSD's face"
            )

    def frame(self) -> Matrix:
        """(3, 3) the PSD's axes in the base frame under the beam, turned about its normal as it was seen."""
        return self._psd.frame(self.belief.beam(self.joints)[1])

    # Pictures

    def _by_markers(self, camera: Camera) -> None:
        """Turn the wrist until the beam points at the middle of the LEDs."""
        around = self._look_around(camera)
        for _ in range(_LOOKS):
            markers = self._markers(camera, self._picture())
            if isinstance(markers, NoPair):
                following = next(around, None)
                if following is None:
                    raise MeasurementRefused(RefusalReason.OUT_OF_VIEW, markers.reason)
                self._go(following)
                continue
            self._locate(camera, markers.pixels)
            centre, beam = self._pixels(camera, np.array([self.belief.target, self._beam_there()]))
            if np.linalg.norm(centre - beam) <= _ON_CENTRE:
                return
            self._go(self._image_step(camera, centre - beam))
        raise MeasurementRefused(
            RefusalReason.NOT_CONVERGING, f"the markers were not centred in {_LOOKS} pictures"
        )

    def _by_spot(self, camera: Camera) -> bool:
        """Lead the spot onto the middle of the LEDs, in pictures with and without the laser; True if lit.

        Of several lights the one that is where a light was before: as the arm turns, the beam's own stays in
        its place in the picture, and a reflection goes with the PSD.
        """
        before: Matrix | None = None
        for _ in range(_LOOKS):
            self._rig.laser(False)
            dark = self._picture()
            self._rig.laser(True)
            markers = self._markers(camera, dark)
            lights = np.array([[light.x, light.y] for light in spot_between(dark, self._picture())])
            if isinstance(markers, NoPair) or not len(lights):
                return False
            self._locate(camera, markers.pixels)
            centre, beam = self._pixels(camera, np.array([self.belief.target, self._beam_there()]))
            apart = np.linalg.norm(lights[:, None] - (beam[None] if before is None else before), axis=2)
            spot, before = lights[apart.min(axis=1).argmin()], lights
            self._go(self._image_step(camera, centre - spot))
            if self._lit():
                return True
        return False

    def _picture(self) -> Image:
        for _ in range(_DARK_IMAGES):
            image = self._rig.image()
            if not is_black(image):
                return image
        raise MeasurementRefused(RefusalReason.CAMERA, "its pictures are black")

    def _markers(self, camera: Camera, picture: Image) -> Pair | NoPair:
        """The two LEDs. Where they are the only lights, they need not match the believed pose of the PSD."""
        lights = blobs(picture)
        expected = self._pixels(camera, self.belief.target + self._leds())
        pair = marker_pair(lights, expected if np.isfinite(expected).all() else None)
        if isinstance(pair, NoPair) and len(lights) == len(self._psd.markers):
            return marker_pair(lights)
        return pair

    def _leds(self) -> Matrix:
        """(2, 3) mm from the PSD's centre to its markers in the base frame, by the believed pose."""
        return np.asarray(self._psd.markers @ self.frame().T)

    def _locate(self, camera: Camera, pixels: Matrix) -> None:
        """Believe the PSD's centre and its rotation about the normal by the pixels (2, 2) of its markers.

        Two rays, four equations for the four unknowns. First the turn t: the line a of the markers lies in
        the plane of both rays, whose normal is w, and turned about n it is cos t a + sin t n x a (+ what a
        has along n, which is nothing); of its two solutions the one that is the smaller rotation. Then the
        centre, which is linear.
        """
        rotation, position = self.belief.flange(self.joints)
        eye = position + rotation @ camera.mount[:3, 3]
        rays = camera.rays(pixels) @ (rotation @ camera.mount[:3, :3]).T
        leds, normal, across = self._leds(), self.frame()[:, 2], np.cross(rays[0], rays[1])
        line = leds[1] - leds[0]
        turn = np.arctan2(-across @ line, across @ np.cross(normal, line))
        turn = (turn + np.pi / 2) % np.pi - np.pi / 2
        self._psd = replace(self._psd, turn=self._psd.turn + float(turn))
        leds = self._leds()
        if (leds[1] - leds[0]) @ (rays[1] - rays[0]) < 0:  # the second is where the first should be
            rays = rays[::-1]
        beside = [np.eye(3) - np.outer(ray, ray) for ray in rays]
        right = [plane @ (eye - led) for plane, led in zip(beside, leds, strict=True)]
        centre = np.linalg.lstsq(np.concatenate(beside), np.concatenate(right), rcond=None)[0]
        self.belief = self.belief.with_target(centre)

    def _pixels(self, camera: Camera, points: Matrix) -> Matrix:
        """(N, 2) px of points (N, 3) mm of the base frame; NaN for one that has no image."""
        rotation, position = self.belief.flange(self.joints)
        return camera.project(camera.from_flange((points - position) @ rotation))

    def _beam_there(self) -> Matrix:
        """(3,) mm, base frame: the point of the beam that is nearest to the believed target."""
        origin, direction = self.belief.beam(self.joints)
        return np.asarray(origin + direction * (direction @ (self.belief.target - origin)))

    def _image_step(self, camera: Camera, error: Matrix) -> Matrix:
        """(n,) the joints after a step against an error (2,) px of the image of the believed target."""
        return step(self.belief, self.joints, self._image_jacobian(camera), error, _LARGEST_IN_SEARCH)

    def _image_jacobian(self, camera: Camera) -> Matrix:
        """(2, n) px/rad (mm): how the image of the believed target moves by the joints."""
        point, by_joints = self.belief.call("sighted", self.joints, self.belief.target)
        return np.asarray(
            camera.project_jacobian(camera.from_flange(point[None]))[0] @ camera.mount[:3, :3].T @ by_joints
        )

    def _look_around(self, camera: Camera) -> Iterator[Matrix]:
        """Postures that look past the target on all sides, by half a picture's height, then a whole one."""
        start, belief = self.joints, self.belief
        far = float(np.linalg.norm(belief.target - belief.beam(start)[0]))
        axes = belief.flange(start)[0] @ camera.mount[:3, :2]
        for share in (0.5, 1.0):
            for way in _ring(axes, share * far * camera.height / camera.focal[1], _AROUND):
                joints = belief.with_target(belief.target + way).onto_target(start)
                if joints is not None:
                    yield joints

    # The beam alone

    def _by_spiral(self) -> bool:
        """Move the beam in a spiral about the believed centre; True once the PSD is lit.

        The rings are in the plane of the face: across a beam that comes in at a slant the face is narrow.
        """
        belief, frame = self.belief, self.frame()
        direction = belief.beam(self.joints)[1]
        pitch = _SPIRAL_STEP * self._psd.size
        self._rig.laser(True)
        for ring in range(round(_FARTHEST / pitch / max(float(-direction @ frame[:, 2]), _SLANT)) + 1):
            for offset in _ring(np.eye(2), ring * pitch, max(1, round(2 * np.pi * ring))):
                if np.linalg.norm(np.cross(frame[:, :2] @ offset, direction)) > _FARTHEST:
                    continue
                spot, by_joints = belief.spot(self.joints, frame)
                try:
                    joints = step(belief, self.joints, by_joints, spot - offset, _LARGEST_IN_SEARCH)
                except MeasurementRefused:  # this side is beyond a joint's limit, the others need not be
                    continue
                self._go(joints)
                if self._lit():
                    return True
        return False

    def _lit(self) -> bool:
        return read_spot(self._rig, self._psd, self._dark, _SEARCH_SAMPLES).light >= LIT

    def _go(self, joints: Matrix) -> None:
        obey()
        self._rig.move(joints)
        self.joints = joints


def _ring(axes: Matrix, radius: float, count: int) -> Iterator[Matrix]:
    """Points (d,) mm evenly on a ring in the plane of two axes (d, 2)."""
    for angle in 2 * np.pi * np.arange(count) / count:
        yield radius * (axes @ [np.cos(angle), np.sin(angle)])
