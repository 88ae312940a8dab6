"""Kinds of instruments that the program does not have: what files do with any kind is tested with them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
from pydantic import Field

from zerobeam.model.instruments import registry
from zerobeam.model.instruments.kind import Flange, Station, Words
from zerobeam.model.parsing.validation import FileModel, Name, Positive


class StubStated(FileModel):
    kind: Literal["camera", "beacon", "six", "edge", "globe"] = Field(description="which stub")
    sigma_mm: Positive = Field(default=0.1, description="of a reading, millimetres")
    reflectors: dict[Name, Positive] = Field(default={}, description="of each, millimetres")


@dataclass(frozen=True, eq=False)
class Stub(Station):
    also_called = ("stub",)
    target_is = "nothing"
    target = "mark"
    met = False
    unknowns = ()
    key = b"stub"
    words = Words("a stub", "stub", "shift of it", "mm", "reading", "a stub", "it", "Do.", (), ())
    Stated = StubStated

    names: tuple[str, ...]

    @classmethod
    def of(cls, label: str, stated: Any, *, exact: bool) -> Stub:
        return cls(label, tuple(stated.reflectors) or ("",))

    @property
    def residual_size(self) -> int:
        return sum(self.columns.values())

    @property
    def variants(self) -> tuple[str, ...]:
        return self.names

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return reading


class Camera(Stub):
    """On the flange, sees a point mark."""

    name = "camera"
    target_is = "point"
    columns: ClassVar[dict[str, int]] = {"pixel_px": 2}


class Beacon(Stub):
    """Measures reflectors on the flange, each with its own sigma."""

    name = "beacon"
    varies = True
    columns: ClassVar[dict[str, int]] = {"measured_mm": 3}


class Six(Stub):
    name = "six"
    columns: ClassVar[dict[str, int]] = {"measured_mm": 3, "measured_quat": 4}


class Edge(Stub):
    """Touches a plane, and reads a length."""

    name = "edge"
    target_is = "plane"
    columns: ClassVar[dict[str, int]] = {"measured_mm": 1}


class Globe(Stub):
    """Touches a ball."""

    name = "globe"
    target_is = "point"
    touches_ball = True
    columns: ClassVar[dict[str, int]] = {}


class Nameless(Stub):
    """Is not called as its entry point."""

    name = "other"


KINDS = (Camera, Beacon, Six, Edge, Globe)


@contextmanager
def stub_kinds() -> Iterator[None]:
    """Within, the stubs are kinds of another package."""
    points = {
        kind.name: EntryPoint(kind.name, f"stub_kinds:{kind.__name__}", registry.GROUP) for kind in KINDS
    }
    points["nameless"] = EntryPoint("nameless", "stub_kinds:Nameless", registry.GROUP)
    points["gone"] = EntryPoint("gone", "no_such_package:Kind", registry.GROUP)
    points["number"] = EntryPoint("number", "stub_kinds:KINDS", registry.GROUP)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_entry_points", lambda: points)
        registry._loaded.cache_clear()
        yield
    registry._loaded.cache_clear()


def quaternion(angle: float) -> list[float]:
    """[w, x, y, z] of a rotation about z, rad."""
    return [float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))]
