"""Stage 1 of the servo: from an initial posture until the beam is on the PSD's face.

With a camera: the two LEDs in the picture say where the PSD's centre is; the wrist is turned until the beam
points there, by the image Jacobian. Where that ends off the face, the spot itself is led there in pictures
with and without the laser. Without a camera, or where its pictures do not help, the beam goes in a spiral.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...interruption import obey
from ...model.arrays import Matrix
from ..sensors.camera import Camera, Image
from ..sensors.markers import NoPair, Pair, blobs, is_black, marker_pair, spot_between
from ..sensors.psd import LIT, Psd
from .readings import read_spot
from .rig import MeasurementRefused, RefusalReason, Rig
from .steering import Belief, step

_SAMPLES = 8
_LOOKS = 40
_DARK_IMAGES = 3
_LARGEST = np.radians(10.0)
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
        return step(self.belief, self.joints, self._image_jacobian(camera), error, _LARGEST)

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
                    joints = step(belief, self.joints, by_joints, spot - offset, _LARGEST)
                except MeasurementRefused:  # this side is beyond a joint's limit, the others need not be
                    continue
                self._go(joints)
                if self._lit():
                    return True
        return False

    def _lit(self) -> bool:
        return read_spot(self._rig, self._psd, self._dark, _SAMPLES).light >= LIT

    def _go(self, joints: Matrix) -> None:
        obey()
        self._rig.move(joints)
        self.joints = joints


def _ring(axes: Matrix, radius: float, count: int) -> Iterator[Matrix]:
    """Points (d,) mm evenly on a ring in the plane of two axes (d, 2)."""
    for angle in 2 * np.pi * np.arange(count) / count:
        yield radius * (axes @ [np.cos(angle), np.sin(angle)])
