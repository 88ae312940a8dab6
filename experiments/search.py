"""Stage 1 of the servo: from an initial posture until the beam is on the PSD's face.

With a camera: the two LEDs in the picture say where the PSD's centre is; the wrist is turned until the beam
points there, by the image Jacobian. Where that ends beside the face, the spot itself is led there in pictures
with and without the laser. Without a camera, or where its pictures do not help, the beam goes in a spiral.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..model.robot import Matrix
from .camera import Camera, Image
from .markers import NoPair, Pair, blobs, is_black, marker_pair, spot_between
from .psd import Psd
from .readings import read_spot
from .refused import Reason, Refused
from .rigs.rig import Rig
from .steering import Belief, step

LIT = 0.02  # share of the laser's light by which the PSD knows that the beam is on it
_SAMPLES = 8
_LOOKS = 40
_DARK_IMAGES = 3
_LARGEST = np.radians(10.0)
_ON_CENTRE = 1.5  # px: nearer than this the pictures need not bring the beam
_AROUND = 8  # directions in which the markers are looked for
_SPIRAL_STEP = 0.7  # of the face's size
_WITH_PICTURES, _WITHOUT = 40.0, 130.0  # mm, radius of the spiral


class Search:
    """The search of one shot. `joints` (n,) is where the arm was sent last, `belief` knows the target better
    after pictures, `left` is why pictures could not help (None if they did)."""

    def __init__(self, rig: Rig, belief: Belief, psd: Psd, joints: Matrix, dark: Matrix) -> None:
        self._rig, self._psd, self._dark = rig, psd, dark
        self.belief, self.joints = belief, joints
        self.left: Refused | None = None
        self._axis: Matrix | None = None

    def run(self) -> None:
        """Bring the beam onto the face; Refused with the reason if it cannot be."""
        camera = self._rig.camera
        if camera is not None:
            try:
                self._by_markers(camera)
            except Refused as refused:
                self.left = refused
        self._rig.laser(True)
        if self._lit():
            return
        if camera is not None and self.left is None:
            try:
                if self._by_spot(camera):
                    return
            except Refused as refused:
                self.left = refused
        if not self._by_spiral():
            raise self.left or Refused(Reason.OFF_FACE, "the beam did not find the PSD's face")

    def frame(self) -> Matrix:
        """(3, 3) the PSD's axes in the base frame under the beam, turned about its normal as it was seen."""
        frame = self._psd.frame(self.belief.beam(self.joints)[1])
        if self._axis is None:
            return frame
        first, second = self._psd.markers[:, :2]
        stated, seen = second - first, (frame.T @ self._axis)[:2]
        turn = np.arctan2(seen[1], seen[0]) - np.arctan2(stated[1], stated[0])
        about = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        return np.asarray(frame @ about)

    # Pictures

    def _by_markers(self, camera: Camera) -> None:
        """Turn the wrist until the beam points at the middle of the LEDs."""
        around = self._look_around(camera)
        for _ in range(_LOOKS):
            found = self._markers(camera, self._picture())
            if isinstance(found, NoPair):
                following = next(around, None)
                if following is None:
                    raise Refused(Reason.OUT_OF_VIEW, found.reason)
                self._go(following)
                continue
            centre = self._centre(camera, found.pixels)
            self.belief = self.belief.with_target(self.belief.call("place", self.joints, centre)[0])
            error = self._pixel(camera, centre) - self._pixel(camera, self._beam_at(centre))
            if np.linalg.norm(error) <= _ON_CENTRE:
                return
            self._go(self._image_step(camera, centre, error))
        raise Refused(Reason.NOT_CONVERGING, f"the markers were not centred in {_LOOKS} pictures")

    def _by_spot(self, camera: Camera) -> bool:
        """Lead the spot onto the middle of the LEDs, in pictures with and without the laser; True if lit."""
        for _ in range(_LOOKS):
            self._rig.laser(False)
            dark = self._picture()
            self._rig.laser(True)
            found = self._markers(camera, dark)
            spots = spot_between(dark, self._picture())
            if isinstance(found, NoPair) or not spots:
                return False
            centre = self._centre(camera, found.pixels)
            beam = self._pixel(camera, self._beam_at(centre))
            # Of several lights the one where the beam should be: a reflection is elsewhere.
            spot = min(spots, key=lambda blob: float(np.hypot(blob.x - beam[0], blob.y - beam[1])))
            error = self._pixel(camera, centre) - np.array([spot.x, spot.y])
            self._go(self._image_step(camera, centre, error))
            if self._lit():
                return True
        return False

    def _picture(self) -> Image:
        for _ in range(_DARK_IMAGES):
            image = self._rig.image()
            if not is_black(image):
                return image
        raise Refused(Reason.CAMERA, "its pictures are black")

    def _markers(self, camera: Camera, picture: Image) -> Pair | NoPair:
        """The two LEDs. Where they are the only lights, they need not be as the PSD is thought to stand."""
        seen = blobs(picture)
        found = marker_pair(seen, self._expected(camera))
        if isinstance(found, NoPair) and len(seen) == len(self._psd.markers):
            return marker_pair(seen)
        return found

    def _marker_axis(self, camera: Camera) -> Matrix:
        """(3,) mm from the first marker to the second in the camera frame, as the PSD is thought to stand."""
        _, direction = self.belief.beam(self.joints)
        first, second = self._psd.markers @ self._psd.frame(direction).T
        return np.asarray(self.belief.turned(self.joints, second - first) @ camera.mount[:3, :3])

    def _expected(self, camera: Camera) -> Matrix | None:
        """(2, 2) px where the markers should be; None where that cannot be said."""
        centre = camera.seen(self.belief.call("seen", self.joints, self.belief.target)[0][None])[0]
        axis = self._marker_axis(camera)
        pixels = camera.project(np.array([centre - axis / 2, centre + axis / 2]))
        return pixels if np.isfinite(pixels).all() else None

    def _centre(self, camera: Camera, pixels: Matrix) -> Matrix:
        """(3,) mm the PSD's centre in the flange frame, by the pixels (2, 2) of the markers.

        Each marker lies on its ray, and both are where the PSD's axis has them about the centre: four linear
        equations for three unknowns. How that axis is turned about the line of sight is seen in the picture,
        and kept for `frame`.
        """
        rays, axis = camera.rays(pixels), self._marker_axis(camera)
        sight = rays.sum(axis=0) / np.linalg.norm(rays.sum(axis=0))
        along, apart = (axis @ sight) * sight, rays[1] - rays[0]
        if apart @ axis < 0:  # the second is where the first should be
            rays, apart = rays[::-1], -apart
        axis = along + np.linalg.norm(axis - along) * apart / np.linalg.norm(apart)
        across = [np.eye(3) - np.outer(ray, ray) for ray in rays]
        rows = np.concatenate(across)
        right = np.concatenate([across[0] @ axis / 2, -across[1] @ axis / 2])
        centre = np.linalg.lstsq(rows, right, rcond=None)[0]
        (from_base,) = self.belief.call("place", self.joints, np.zeros(3))
        self._axis = self.belief.call("place", self.joints, camera.mount[:3, :3] @ axis)[0] - from_base
        return np.asarray(camera.mount[:3, :3] @ centre + camera.mount[:3, 3])

    def _pixel(self, camera: Camera, point: Matrix) -> Matrix:
        """(2,) px of a point (3,) mm of the flange frame."""
        return np.asarray(camera.project(camera.seen(point[None]))[0])

    def _beam_at(self, centre: Matrix) -> Matrix:
        """(3,) mm, flange frame: the point of the beam that is nearest to `centre`."""
        origin, direction = self.belief.beam(self.joints)
        (base,) = self.belief.call("seen", self.joints, origin)
        along = self.belief.turned(self.joints, direction)
        return np.asarray(base + along * (along @ (centre - base)))

    def _image_step(self, camera: Camera, centre: Matrix, error: Matrix) -> Matrix:
        """(n,) the joints after a step against an error (2,) px of the centre's image."""
        target = self.belief.call("place", self.joints, centre)[0]
        _, by_joints = self.belief.call("sighted", self.joints, target)
        by_point = camera.project_jacobian(camera.seen(centre[None]))[0] @ camera.mount[:3, :3].T
        return step(self.belief, self.joints, by_point @ by_joints, error, _LARGEST)

    def _look_around(self, camera: Camera) -> Iterator[Matrix]:
        """Postures that look past the target on all sides, by half the picture's width, then by all of it."""
        start, belief = self.joints, self.belief
        origin, direction = belief.beam(start)
        far = float(np.linalg.norm(belief.target - origin))
        for share in (0.5, 1.0):
            radius = share * far * camera.height / camera.focal[1]
            for way in _ring(direction, radius, _AROUND):
                joints = belief.with_target(belief.target + way).onto_target(start)
                if joints is not None:
                    yield joints

    # The beam alone

    def _by_spiral(self) -> bool:
        """Move the beam in a spiral about the believed centre; True once the PSD is lit."""
        start, belief = self.joints, self.belief
        radius = _WITHOUT if self._rig.camera is None or self.left is not None else _WITH_PICTURES
        pitch = _SPIRAL_STEP * self._psd.size
        _, direction = belief.beam(start)
        for ring in range(round(radius / pitch) + 1):
            count = max(1, round(2 * np.pi * ring))
            for way in _ring(direction, ring * pitch, count):
                joints = belief.with_target(belief.target + way).onto_target(start)
                if joints is None:
                    continue
                self._go(joints)
                if self._lit():
                    return True
        return False

    def _lit(self) -> bool:
        return read_spot(self._rig, self._psd, self._dark, _SAMPLES).light >= LIT

    def _go(self, joints: Matrix) -> None:
        self._rig.move(joints)
        self.joints = joints


def _ring(direction: Matrix, radius: float, count: int) -> Iterator[Matrix]:
    """Points (3,) mm evenly on a ring across `direction`."""
    side = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, side)
    first /= np.linalg.norm(first)
    second = np.cross(direction, first)
    for k in range(count):
        angle = 2 * np.pi * k / count
        yield radius * (np.cos(angle) * first + np.sin(angle) * second)
