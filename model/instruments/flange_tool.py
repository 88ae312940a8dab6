"""What a laser and a probe have in common: a point on the flange that sees its target in the flange frame."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np

from ..arrays import Matrix
from ..errors import BadInput
from .kind import Assumption, Flange, Instrument, Unknown

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
