"""An instrument that measures position and orientation of what is mounted on the flange: six numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from ..arrays import Matrix
from ..parsing.reading import shown
from ..parsing.validation import FileModel, Positive, Vector, refusal
from .frames import (
    FREE_MM,
    FREE_RAD,
    FramedStation,
    Quaternion,
    StatedStand,
    StationFrame,
    matrix_of,
    nearest_rotation,
    quaternion,
    quaternion_of,
    rotation,
    rotation_of_quaternion,
    rotation_vector,
    spread,
    turned,
    unit_quaternion,
    vector_of,
    vector_unknowns,
)
from .kind import (
    Assumption,
    Flange,
    Misread,
    Point,
    ProposedHeader,
    ReadingNoise,
    ResidualLayout,
    TargetEntry,
    Unknown,
    Words,
    station_at,
)

_ROUNDS = 50
_OPEN = 1e-3  # of the largest: what the measurements determine so little is left at the guess


class StatedMount(FileModel):
    """Where the measured body is on the flange; what has no sigma is only a guess."""

    guess_mm: Vector = Field(
        default=(0.0, 0.0, 0.0), description="its origin in the flange frame, millimetres"
    )
    sigma_mm: Positive | None = Field(
        default=None, description="standard deviation of that, each direction, millimetres"
    )
    guess_quat: Quaternion = Field(
        default=(1.0, 0.0, 0.0, 0.0), description="its orientation in the flange frame: [w, x, y, z]"
    )
    sigma_deg: Positive | None = Field(
        default=None, description="standard deviation of a rotation of it about each axis, degrees"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        for sigma, guess in (("sigma_mm", "guess_mm"), ("sigma_deg", "guess_quat")):
            if getattr(self, sigma) is not None and guess not in self.model_fields_set:
                raise refusal(
                    f"{sigma} of a mount is stated without {guess}",
                    key=(sigma,),
                    found=f"{sigma}: {shown(getattr(self, sigma))}",
                    remedy=f"add {guess}, or remove {sigma}",
                )
        return self


class StatedPose(StatedStand):
    """An instrument that measures poses, and where on the flange the measured body is."""

    kind: Literal["pose"] = Field(description="this kind of instrument")
    sigma_mm: Positive = Field(description="standard deviation of a coordinate, millimetres")
    sigma_deg: Positive = Field(description="standard deviation of a rotation about each axis, degrees")
    mount: StatedMount = Field(default=StatedMount(), description="the measured body on the flange")


@dataclass(frozen=True, eq=False)
class PoseStation(FramedStation):
    """Its residual is position (mm) and rotation vector (rad) from what was read to what is predicted, both
    in the instrument's frame: predicted = exp(vector) · measured.

    `mount_point` (3,) mm and `mount_rotation` (3, 3) as stated; the mount's rotation vector turns the latter
    about the axes of the flange. Stds (rad and mm) and whether they are knowledge. A reading is the measured
    position (3,), the quaternion (4,) and the relative stds (6,).
    """

    name = "pose"
    also_called = ("6d", "6dof", "t-mac", "tmac", "marker", "camera", "hand-eye", "mocap")
    columns: ClassVar[dict[str, int]] = {"measured_mm": 3, "measured_quat": 4}
    entered: ClassVar[dict[str, str]] = {
        "measured_mm": "position x, y, z (mm)",
        "measured_quat": "quaternion w, x, y, z",
    }
    headed: ClassVar[dict[str, tuple[str, ...]]] = {
        "measured_mm": ("x (mm)", "y (mm)", "z (mm)"),
        "measured_quat": ("quat. w", "quat. x", "quat. y", "quat. z"),
    }
    residual_size = 6
    reading_size = 13
    Stated: ClassVar[type[FileModel]] = StatedPose
    title = "Pose camera"
    minutes = 0.2
    mark = "pose"
    words = Words(
        is_="an instrument that measures position and orientation of a body on the flange",
        part="measured body",
        motion="rotation of the mount",
        unit="deg",
        reading="pose",
        method="an instrument in the cell that measures poses of a body on the flange",
        posture="the line of sight to the body",
        to_do="Go to the posture, and let the arm settle. Measure position and orientation of the body, and"
        " write down the joints.",
        fields=(),
        traced=(
            ("Instrument, maker and serial number", ("instrument", "instrument serial")),
            ("Instrument, calibration certificate", ("instrument certificate",)),
        ),
    )

    sigma_mm: float
    sigma_rad: float
    mount_point: Matrix
    mount_rotation: Matrix
    mount_std: tuple[float, float]
    tolerated: tuple[bool, bool]

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        camera = {
            "kind": "pose",
            "sigma_mm": 0.1,
            "sigma_deg": 0.03,
            "guess_mm": station_at(reach),
            "mount": {},
        }
        return ProposedHeader({"instruments": {"camera": camera}}, 6)

    @classmethod
    def of(cls, label: str, header: StatedPose, *, exact: bool) -> Self:
        mount = header.mount
        angle = FREE_RAD if mount.sigma_deg is None else float(np.radians(mount.sigma_deg))
        return cls(
            label=label,
            frame=StationFrame.of(header.frame),
            stand=None if header.guess_mm is None else np.array(header.guess_mm, dtype=float),
            sigma_mm=header.sigma_mm,
            sigma_rad=float(np.radians(header.sigma_deg)),
            mount_point=np.array(mount.guess_mm, dtype=float),
            mount_rotation=rotation_of_quaternion(unit_quaternion(mount.guess_quat)),
            mount_std=(mount.sigma_mm or FREE_MM, angle),
            tolerated=(mount.sigma_mm is not None, mount.sigma_deg is not None),
        )

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        of, (length, angle) = f"{self.label}.mount", self.mount_std
        shifts = vector_unknowns(of, self.mount_point, length, tolerated=self.tolerated[0])
        turns = (
            Unknown(axis, "deg", 0.0, angle, of, tolerated=self.tolerated[1]) for axis in ("rx", "ry", "rz")
        )
        return (*shifts, *turns, *self.frame_unknowns)

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        """Besides the frame the mount as far as its sigmas are stated: without one it is free."""
        key, (length, angle) = f"instruments.{self.label}.mount.sigma", self.mount_std
        of = f"{self.label}.mount"
        shift = Assumption(self.label, of, self.name, "mount", length, "mm", stated=True, key=f"{key}_mm")
        rotation = shift._replace(std=float(np.degrees(angle)), unit="deg", key=f"{key}_deg")
        parts = zip((shift, rotation), self.tolerated, strict=True)
        return (*super().taken_as_known, *(part for part, by_header in parts if by_header))

    @property
    def turns(self) -> bool:
        return not self.tolerated[1]

    @property
    def known_to(self) -> float:
        return float(np.degrees(self.mount_std[1]))

    @property
    def key(self) -> bytes:
        return f"{self.name} {self.sigma_mm} ".encode() + self.mount_rotation.tobytes() + self.frame_key

    @property
    def std(self) -> float:
        return self.sigma_mm

    @property
    def noises(self) -> tuple[ReadingNoise, ...]:
        """Of positions and of rotations: how many mm go with a degree is only stated."""
        position = ReadingNoise(self.label, self.label, self.sigma_mm)
        return position, ReadingNoise(self.label, f"{self.label}.rotation", self.sigma_rad, "deg")

    @cached_property
    def layout(self) -> ResidualLayout:
        return super().layout._replace(noise=np.repeat([0, 1], 3))

    @property
    def point(self) -> Matrix:
        return self.mount_point

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        position = measured.get("measured_mm", (0.0, 0.0, 0.0))
        turn = unit_quaternion(measured.get("measured_quat", (1.0, 0.0, 0.0, 0.0)))
        length = 1.0 if sigma is None else sigma / self.sigma_mm
        return np.array([*position, *turn, *[length] * 3, *[1.0] * 3])

    def recorded(self, reading: Matrix, shift: Matrix) -> dict[str, tuple[float, ...]]:
        turn = rotation(shift[3:]) @ rotation_of_quaternion(reading[3:7])
        return {
            "measured_mm": tuple((reading[:3] + shift[:3]).tolist()),
            "measured_quat": tuple(quaternion(turn).tolist()),
        }

    def misread(self, readings: Matrix) -> Iterator[Misread]:
        """A mirror turns the axis of a rotation about, but for its part along the mirrored axis. Other
        programs write w last, or the inverse."""
        metres = readings.copy()
        metres[:, :3] *= 1000
        yield Misread(self.label, "metres", metres)
        for axis in self.mirrored_axes(free=not any(self.tolerated)):
            which, mirrored = axis - 1 if axis else 2, readings.copy()
            mirrored[:, which] *= -1
            mirrored[:, [4 + k for k in range(3) if k != which]] *= -1
            yield Misread(self.label, "mirrored", mirrored, axis)
        for wrong in ("quaternion", "inverse", "inverse_pose"):
            yield Misread(self.label, wrong, put_right(readings, wrong))

    def _measured(self, flange: Flange, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Position (3, 1) mm and rotation (3, 3) of the body, in the instrument's frame."""
        turn, origin = self.frame_at(unknowns)
        mount = turned(unknowns[3:6]) @ ca.SX(self.mount_rotation)
        return turn.T @ (flange.in_base(unknowns[:3]) - origin), turn.T @ flange.rotation @ mount

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        position, turn = self._measured(flange, unknowns)
        return ca.vertcat(position - reading[:3], vector_of(turn @ matrix_of(reading[3:7]).T))

    def predicted(
        self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str
    ) -> ca.SX:
        position, turn = self._measured(flange, unknowns)
        return ca.vertcat(position, quaternion_of(turn), reading[7:])

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        return unknowns[:3], ca.SX.zeros(3)

    def start_unknowns(
        self, poses: Matrix, readings: Matrix, unknowns: Matrix, variants: Sequence[str]
    ) -> Matrix:
        """The hand-eye equation flange · mount = frame · measured in closed form: rotations, then lengths by
        linear least squares. Of what the measurements leave open the start is as near as can be to the guess.
        """
        at, result = spread(len(poses)), np.array(unknowns, dtype=float)
        if not len(at) or (not self.frame.free and all(self.tolerated)):
            return result
        flange, measured = poses[at, :3, :3], np.array([rotation_of_quaternion(r[3:7]) for r in readings[at]])
        mount, frame = self._rotations(flange, measured, rotation(result[3:6]) @ self.mount_rotation)
        if self.frame.free and not self.tolerated[1] and (axis := _one_axis(flange)) is not None:
            turn = self._about(axis, flange, poses[at, :3, 3], readings[at, :3] @ frame.T)
            mount, frame = rotation(turn * axis) @ mount, rotation(turn * flange[0] @ axis) @ frame
        if not self.tolerated[1]:
            result[3:6] = rotation_vector(mount @ self.mount_rotation.T)
        if self.frame.free:
            result[9:12] = rotation_vector(frame @ self.frame.rotation.T)
        # R x - f = F m - t, of which x and f are solved for where they are free; x about its guess.
        right = readings[at, :3] @ frame.T - poses[at, :3, 3] - flange @ result[:3]
        columns = []
        if not self.tolerated[0]:
            columns.append(flange.reshape(-1, 3))
        if self.frame.free:
            columns.append(np.tile(-np.eye(3), (len(at), 1)))
        else:
            right += self.frame.origin
        if columns:
            solution = np.linalg.lstsq(np.hstack(columns), right.ravel(), rcond=_OPEN)[0]
            if self.frame.free:
                result[6:9] = solution[-3:]
            if not self.tolerated[0]:
                result[:3] += solution[:3]
        return result

    def _about(self, axis: Matrix, flange: Matrix, origins: Matrix, measured: Matrix) -> float:
        """By how much, rad, mount and frame are turned together about an axis (3,) that is the same in flange
        and base of all poses: the rotations leave it open, the positions of the body determine it.

        `measured` (N, 3) mm are in the axes of the base frame as far as is known.
        """
        in_base = flange[0] @ axis
        along = np.outer(measured @ in_base, in_base)
        across = measured - along
        # sine · (axis x across) + cosine · across + along + f = flange x + origin, which is linear.
        size = max(float(np.abs(across).max()), 1e-9)
        columns = np.hstack(
            [
                np.cross(in_base, across).reshape(-1, 1) / size,
                across.reshape(-1, 1) / size,
                *([] if self.tolerated[0] else [-flange.reshape(-1, 3)]),
                np.tile(np.eye(3), (len(flange), 1)),
            ]
        )
        right = origins - along + (flange @ self.mount_point if self.tolerated[0] else 0.0)
        sine, cosine = np.linalg.lstsq(columns, right.ravel(), rcond=_OPEN)[0][:2]
        return float(np.arctan2(sine, cosine))

    def _rotations(self, flange: Matrix, measured: Matrix, mount: Matrix) -> tuple[Matrix, Matrix]:
        """Rotations (3, 3) of mount and frame from those of flange and measured body (N, 3, 3); what is known
        stays as it is.

        Where both are free: by the singular vectors of sum(measured ⊗ flange) (Shah 2013). Where several of
        these fit as well, since all poses are turned about one axis or hardly at all, by the axes of the
        rotations from the first pose to the others (Park and Martin 1994), which leave what is open of the
        mount at its guess.
        """

        def frame_of(mount: Matrix) -> Matrix:
            return nearest_rotation(np.einsum("nij,jk,nlk->il", flange, mount, measured))

        def mount_of(frame: Matrix) -> Matrix:
            return nearest_rotation(np.einsum("nji,jk,nkl->il", flange, frame, measured))

        if not self.frame.free:
            known = self.frame.rotation
            return (mount if self.tolerated[1] else mount_of(known)), known
        if self.tolerated[1]:
            return mount, frame_of(mount)
        # vec of rows: frame = flange · mount · measured', so (flange ⊗ measured) mount = frame.
        _, singular, right = np.linalg.svd(np.einsum("nij,nkl->ikjl", flange, measured).reshape(9, 9))
        if singular[1] > (1 - _OPEN) * singular[0]:
            axes = _sine_axes(flange).T @ _sine_axes(measured)
            mount = nearest_rotation(axes + _OPEN * np.abs(axes).max() * mount)
        else:
            shah = right[0].reshape(3, 3)
            mount = nearest_rotation(shah * np.sign(np.linalg.det(shah) or 1.0))
        for _ in range(_ROUNDS):
            before, frame = mount, frame_of(mount)
            mount = mount_of(frame)
            if np.abs(mount - before).max() < 1e-12:
                break
        return mount, frame


OtherPose = Literal["quaternion", "inverse", "inverse_pose"]


def put_right(readings: Matrix, wrong: OtherPose) -> Matrix:
    """Readings (N, 7 or more) of position and quaternion, recorded as another program writes them: its
    `quaternion` has w last, its rotation is the `inverse`, or its whole pose is (`inverse_pose`)."""
    right = readings.copy()
    if wrong == "quaternion":
        right[:, 3:7] = np.roll(readings[:, 3:7], 1, axis=1)
        return right
    right[:, 4:7] *= -1
    if wrong == "inverse_pose":
        turns = np.array([rotation_of_quaternion(q) for q in right[:, 3:7]]).reshape(-1, 3, 3)
        right[:, :3] = -np.einsum("nij,nj->ni", turns, readings[:, :3])
    return right


def _one_axis(flange: Matrix) -> Matrix | None:
    """(3,) in the flange frame, of rotations (N, 3, 3) that are all about one axis; None of others."""
    left, singular, _ = np.linalg.svd(_sine_axes(flange).T, full_matrices=False)
    return left[:, 0] if singular[0] > 0 and singular[1] < _OPEN * singular[0] else None


def _sine_axes(turns: Matrix) -> Matrix:
    """(N, 3) of the rotations from the first of `turns` (N, 3, 3) to each: the axis times twice the sine."""
    by = turns[0].T @ turns
    return np.stack([by[:, 2, 1] - by[:, 1, 2], by[:, 0, 2] - by[:, 2, 0], by[:, 1, 0] - by[:, 0, 1]], axis=1)
