"""Tools on the flange that see their target in the flange frame: a laser, whose beam must pass the centre of
a position-sensitive detector; a probe, whose tip must meet a ball in a socket."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np

from ..arrays import Matrix
from ..errors import BadInput
from .kind import TIP, Assumption, Flange, Instrument, Point, ProposedHeader, Unknown, Words, target_at

_SIGMA: dict[str, Literal["tilt_deg", "shift_mm"]] = {"deg": "tilt_deg", "mm": "shift_mm"}


@dataclass(frozen=True, eq=False)
class FlangeTool(Instrument):
    """A tool on the flange, which is met by its target: its residual is where the target is, seen from it.

    In the flange frame, `tip` (3,) mm of a probe, or a point on the beam; `direction` (3,) unit, or None.
    `tilt_std` (rad) and `shift_std` (mm) are the prior stds of how far it is from that; of a calibrated one
    only if it is `tolerated`: else it is exact, and has no unknowns. `sigma_known` where the stds of one that
    is not calibrated are knowledge. `stated` has those of the header.

    Of the kind: `free_sigma` the tilt (degrees, of a beam) and shift (mm) of one that is not calibrated.
    """

    target_is = "point"
    met = True
    free_sigma: ClassVar[tuple[float, float]]

    is_calibrated: bool
    tip: Matrix
    direction: Matrix | None
    tilt_std: float
    shift_std: float
    tolerated: bool = False
    sigma_known: bool = False
    stated: frozenset[Literal["tilt_deg", "shift_mm"]] = frozenset()

    @classmethod
    def of(cls, label: str, entry: Any, *, exact: bool, sigma_known: bool = False) -> Self:
        direction = None if entry.direction is None else np.array(entry.direction, dtype=float)
        return cls(
            label=label,
            is_calibrated=entry.calibrated,
            tip=np.array(entry.point_mm, dtype=float),
            direction=None if direction is None else direction / np.linalg.norm(direction),
            tilt_std=float(np.radians(entry.sigma.tilt_deg)),
            shift_std=entry.sigma.shift_mm,
            tolerated=not exact or "sigma" in entry.model_fields_set,
            sigma_known=sigma_known,
            stated=frozenset(entry.sigma.model_fields_set if "sigma" in entry.model_fields_set else ()),
        )

    @property
    def point(self) -> Matrix:
        return self.tip

    @property
    def calibrated(self) -> bool:
        return self.is_calibrated

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        if self.is_calibrated and not self.tolerated:
            return ()
        known = self.is_calibrated or self.sigma_known
        return tuple(
            unknown._replace(tolerated=known, assumed=known and _SIGMA[unknown.unit] not in self.stated)
            for unknown in self._free()
        )

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        if not (self.is_calibrated or self.sigma_known):
            return ()
        stds = {"deg": float(np.degrees(self.tilt_std)), "mm": self.shift_std}
        return tuple(
            Assumption(
                label=self.label,
                of="tool",
                kind=self.name,
                part="mounting" if self.beam else "tip",
                std=None if self.exact else stds[unit],
                unit=unit,
                stated=_SIGMA[unit] in self.stated,
                key=f"{'' if self.label == 'tool' else 'instruments.'}{self.label}.sigma.{_SIGMA[unit]}",
            )
            for unit in dict.fromkeys(unknown.unit for unknown in self._free())
        )

    def freed(self) -> tuple[Self, Mapping[str, float]]:
        """Of one that is exact all unknowns."""
        return (replace(self, tolerated=True) if self.exact else self), {}

    @abstractmethod
    def _free(self) -> Iterator[Unknown]: ...

    @property
    def key(self) -> bytes:
        numbers = self.point if self.direction is None else np.concatenate([self.point, self.direction])
        return f"{self.name} {self.exact} ".encode() + np.asarray(numbers, dtype=float).tobytes()

    def shift(self, measured: Mapping[str, Sequence[float]]) -> Matrix:
        for column in self.columns:
            if column in measured:
                return np.array(measured[column], dtype=float)
        return np.zeros(self.residual_size)

    def recorded(self, reading: Matrix, shift: Matrix) -> dict[str, tuple[float, ...]]:
        return {column: tuple(shift.tolist()) for column in self.columns}

    @abstractmethod
    def beside(self, target: ca.SX, unknowns: ca.SX) -> ca.SX:
        """(d, 1) the residual of a `target` (3, 1) mm in the flange frame; `unknowns` (k, 1), or empty if it
        is exact."""

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return self.beside(flange.in_flange(target), unknowns)


def flange_tool(instrument: Instrument) -> FlangeTool:
    """The same; BadInput where it is none, for what only a laser or a probe can do."""
    flange_tool_kind(type(instrument))
    assert isinstance(instrument, FlangeTool)
    return instrument


def flange_tool_kind(kind: type[Instrument]) -> type[FlangeTool]:
    """The same; BadInput where it is none."""
    if issubclass(kind, FlangeTool):
        return kind
    raise BadInput(
        "this needs a tool on the flange that meets its target",
        found=f"kind: {kind.name}",
        allowed=" or ".join(tool.name for tool in FlangeTool.__subclasses__()),
    )


# The two axes across each nominal beam axis, in the order of tilt1, tilt2 and shift1, shift2.
_ACROSS = {0: (1, 2), 1: (2, 0), 2: (0, 1)}


@dataclass(frozen=True, eq=False)
class LaserBeam(FlangeTool):
    """Its reading is where the target is across the beam, along b1 and b2 (`beam_frame`)."""

    name = "laser"
    also_called = ("beam", "pointer", "psd", "light")
    columns: ClassVar[dict[str, int]] = {"spot_mm": 2}
    residual_size = 2
    target = "psd"
    free_sigma = (3.0, 10.0)
    beam = True
    title = "Laser and PSD"
    minutes = 2.0
    mark = "psd"
    words = Words(
        is_="a beam that must pass the target",
        part="beam",
        motion="tilt of the laser",
        unit="deg",
        reading="spot",
        method="a laser on the flange and a position-sensitive detector in the cell",
        posture="its beam to the target",
        to_do="Go to the posture slowly; look at cables, stops and people. Jog the wrist in small steps until"
        " the PSD reads zero in both directions. Look at its sum signal: too little light is no reading."
        " Write down the joints as the controller shows them, to its last digit, and go on.",
        fields=("PSD x, y (mm), sum signal",),
        traced=(
            ("PSD, maker and serial number", ("psd", "psd serial", "psd serial number")),
            ("PSD, calibration certificate", ("psd certificate",)),
            ("Laser, maker and serial number", ("laser", "laser serial", "laser serial number")),
            ("Laser, calibration certificate", ("laser certificate",)),
        ),
        act="bring the beam onto the target with the last joints",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        tool = {
            "kind": "laser",
            "calibrated": False,
            "point_mm": [0.0, 0.0, 65.0],
            "direction": [1.0, 0.0, 0.0],
        }
        return ProposedHeader({"tool": tool, "targets": {"psd": target_at(target)}}, 2)

    def _free(self) -> Iterator[Unknown]:
        for axis in ("tilt1", "tilt2"):
            yield Unknown(axis, "deg", 0.0, self.tilt_std)
        for axis in ("shift1", "shift2"):
            yield Unknown(axis, "mm", 0.0, self.shift_std)

    @property
    def turns(self) -> bool:
        return not self.calibrated

    @property
    def known_to(self) -> float:
        return float(np.degrees(self.tilt_std))

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        point, direction, _ = self.beam_frame(unknowns)
        return point, direction

    def beside(self, target: ca.SX, unknowns: ca.SX) -> ca.SX:
        point, _, across = self.beam_frame(unknowns)
        return across.T @ (target - point)

    def beam_frame(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Point p (3, 1) mm, unit direction u (3, 1) and basis B (3, 2) across it, in the flange frame.

        `unknowns` is tilt1, tilt2 (rad), shift1, shift2 (mm), or empty if exact. The tilts and shifts
        act on the two coordinate axes across the nominal beam axis: unlike the paper's {m, n, y0, z0} they
        stay regular when the beam is along x.
        """
        assert self.direction is not None
        nominal_b1, nominal_b2 = self._across(ca.SX(self.direction))
        point, direction = ca.SX(self.point), ca.SX(self.direction)
        if not self.exact:
            tilt1, tilt2, shift1, shift2 = ca.vertsplit(unknowns)
            direction = direction + ca.tan(tilt1) * nominal_b1 + ca.tan(tilt2) * nominal_b2
            direction = direction / ca.sqrt(ca.sumsqr(direction))
            point = point + shift1 * nominal_b1 + shift2 * nominal_b2
        return point, direction, ca.horzcat(*self._across(direction))

    def nominal_beam(self) -> tuple[Matrix, Matrix, Matrix]:
        """Point (3,) mm, unit direction (3,) and basis (3, 2) of the beam as stated, in the flange frame."""
        return self._stated_beam

    @cached_property
    def _stated_beam(self) -> tuple[Matrix, Matrix, Matrix]:
        exact = replace(self, is_calibrated=True, tolerated=False)
        point, direction, across = exact.beam_frame(ca.SX())
        return ca.DM(point).full()[:, 0], ca.DM(direction).full()[:, 0], ca.DM(across).full()

    def _across(self, direction: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Orthonormal b1, b2 across `direction`: the two other axes of the nominal beam axis, made square."""
        assert self.direction is not None
        axis = int(np.argmax(np.abs(self.direction)))
        e1, e2 = (ca.SX(np.eye(3)[i]) for i in _ACROSS[axis])
        b1 = e1 - ca.dot(e1, direction) * direction
        b1 = b1 / ca.sqrt(ca.sumsqr(b1))
        b2 = e2 - ca.dot(e2, direction) * direction
        b2 = b2 - ca.dot(e2, b1) * b1
        return b1, b2 / ca.sqrt(ca.sumsqr(b2))


@dataclass(frozen=True, eq=False)
class ProbeTip(FlangeTool):
    """Nothing is read: a measurement is taken when the tip sits in its socket."""

    name = "probe"
    also_called = ("ball", "sphere", "tip", "touch", "pin", "stylus", "tcp", "contact")
    columns: ClassVar[dict[str, int]] = {}
    residual_size = 3
    target = "socket"
    free_sigma = (3.0, 50.0)
    title = "Probe in a socket"
    minutes = 2.0
    words = Words(
        is_="a tip that must meet it",
        part="probe tip",
        motion="shift of the probe tip",
        unit="mm",
        reading="seat of the tip",
        method="a probe on the flange and fixed points in the cell",
        posture="the probe at the target",
        to_do="Lead the probe into its socket, and write down the joints.",
        fields=(),
        traced=(
            ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
            ("Probe, calibration certificate", ("probe certificate",)),
        ),
        act="lead the probe into its socket",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        tool = {"kind": "probe", "calibrated": False, "point_mm": list(TIP)}
        return ProposedHeader({"tool": tool, "targets": {"socket": target_at(target)}}, 3, turns=True)

    def _free(self) -> Iterator[Unknown]:
        for axis, value in zip("xyz", self.point.tolist(), strict=True):
            yield Unknown(axis, "mm", value, self.shift_std)

    @property
    def known_to(self) -> float:
        return self.shift_std

    def tip_at(self, unknowns: ca.SX) -> ca.SX:
        """(3, 1) mm in the flange frame; `unknowns` is x, y, z, or empty if exact."""
        return ca.SX(self.point) if self.exact else unknowns

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        return self.tip_at(unknowns), ca.SX.zeros(3)

    def beside(self, target: ca.SX, unknowns: ca.SX) -> ca.SX:
        return target - self.tip_at(unknowns)
