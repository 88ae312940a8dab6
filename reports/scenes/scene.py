"""What a 3D picture shows: an arm in its postures, its beams and the targets. Base frame, mm, z up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from ...model.arrays import Matrix
from ...model.kinematics.robot import Robot
from ...words import numbers
from ...words.wording import clipped

AZIMUTH, ELEVATION = -62.0, 20.0  # degrees: from where the scene is first seen, over y < 0
LARGEST_FACTOR = 1000  # that an ellipsoid can be exaggerated by
_READABLE = 0.12  # of the scene's radius: an ellipsoid is first drawn as large as that, at most
_ONE_PLACE = 15.0  # mm: joints nearer to each other than this share one number
_NAME_WIDTH = 24


@dataclass(frozen=True, eq=False)
class Posed:
    """The arm in one posture: its `name`, `arm` (n + 2, 3) from the base over the joints to the flange,
    `tool` (3,) the laser's origin or the probe's tip, `end` (3,) of the beam, None for a probe, whether it
    `reaches` its target, `sights` (2, 3) each from the flange to what an instrument measures, and `axes`
    (n, 3) of the joints, None where only their places are known."""

    name: str
    arm: Matrix
    tool: Matrix
    end: Matrix | None
    reaches: bool
    sights: Sequence[Matrix] = ()
    axes: Matrix | None = None

    @property
    def tool_line(self) -> Matrix:
        """(2, 3) from the flange to the laser or tip."""
        return np.array([self.arm[-1], self.tool])

    @property
    def beam(self) -> Matrix | None:
        """(2, 3) from the laser to the beam's end."""
        return None if self.end is None else np.array([self.tool, self.end])

    @property
    def labels(self) -> list[tuple[Matrix, str]]:
        """Joint numbers where the joints are; joints at one place share a label (a wrist: 4, 5, 6)."""
        labels: list[tuple[Matrix, list[str]]] = []
        for joint, point in enumerate(self.arm[1:-1], start=1):
            for at, names in labels:
                if np.linalg.norm(at - point) < _ONE_PLACE:
                    names.append(str(joint))
                    break
            else:
                labels.append((point, [str(joint)]))
        return [(at, ", ".join(names)) for at, names in labels]


@dataclass(frozen=True, eq=False)
class Placed:
    """A target `at` (3,): its `nominal` place before any measurement, `estimated` from the data, `held`, or
    `undetermined`, drawn where its beams end. `axes` (3, 3): rows are half axes of its place's ellipsoid."""

    name: str
    at: Matrix
    state: Literal["nominal", "estimated", "held", "undetermined"]
    axes: Matrix | None = None

    @property
    def short_name(self) -> str:
        """The name, clipped to what fits into the picture."""
        return clipped(self.name, _NAME_WIDTH)


@dataclass(frozen=True, eq=False)
class Scene3D:
    """Postures and targets, and the frame that they are seen in; `floor` is how high the mounting face is,
    `outlines` (m, 3) lines of planes and balls, `kinds` those of the joints where they are known."""

    postures: Sequence[Posed]
    targets: Sequence[Placed]
    floor: float = 0.0
    outlines: Sequence[Matrix] = ()
    kinds: Sequence[str] = ()

    @cached_property
    def _corners(self) -> tuple[Matrix, Matrix]:
        low, high = self._points.min(axis=0), self._points.max(axis=0)
        return low, high

    @cached_property
    def _points(self) -> Matrix:
        return np.array(
            [
                *(point for posed in self.postures for point in (*posed.arm, posed.tool)),
                *(posed.end for posed in self.postures if posed.end is not None),
                *(point for posed in self.postures for sight in posed.sights for point in sight),
                *(point for outline in self.outlines for point in outline),
                *(target.at for target in self.targets),
                np.zeros(3),
                np.array([0.0, 0.0, self.floor]),
            ]
        )

    @property
    def grid_words(self) -> str:
        """What the grid shows."""
        height = "0" if self.floor == 0 else f"{numbers.exact(self.floor, 'mm')}, the mounting face"
        return f"Grid of {numbers.exact(self.grid_step, 'mm')} at z = {height}"

    @property
    def centre(self) -> Matrix:
        """(3,) of the box around everything."""
        low, high = self._corners
        return np.asarray((low + high) / 2)

    @cached_property
    def radius(self) -> float:
        """Of the ball about the centre that holds everything."""
        return max(float(np.linalg.norm(self._points - self.centre, axis=1).max()), 1.0)

    @property
    def axis(self) -> float:
        """Length of the drawn axes of the base frame."""
        return round(0.22 * self.radius, 1)

    @cached_property
    def grid_step(self) -> float:
        """The roundest step (1, 2 or 5 times a power of ten) of a floor grid of about ten lines."""
        low, high = self._corners
        rough = max(float((high - low)[:2].max()), 1.0) / 8
        power = 10.0 ** math.floor(math.log10(rough))
        return float(next(power * k for k in (1, 2, 5, 10) if power * k >= rough))

    @cached_property
    def grid_bounds(self) -> tuple[float, float, float, float]:
        """The grid's lowest and highest x, lowest and highest y."""
        low, high = self._corners
        size, step = (high - low)[:2], self.grid_step
        # Postures in one plane have a floor all the same: half as wide as long, at least.
        wide = np.maximum(size, size.max() / 2) / 2 + step / 2
        first = np.floor((self.centre[:2] - wide) / step) * step
        last = np.ceil((self.centre[:2] + wide) / step) * step
        return float(first[0]), float(last[0]), float(first[1]), float(last[1])

    @cached_property
    def factor(self) -> int | None:
        """By how much ellipsoids are exaggerated at first: the largest power of ten that leaves every one
        readable next to the arm; None where there is no ellipsoid."""
        sizes = [
            np.linalg.norm(target.axes, axis=1).max() for target in self.targets if target.axes is not None
        ]
        if not sizes:
            return None
        exponent = math.floor(math.log10(_READABLE * self.radius / max(sizes)))
        return int(10 ** np.clip(exponent, 0, math.log10(LARGEST_FACTOR)))


def axes_of(robot: Robot, joints: Matrix) -> Matrix:
    """(m, n, 3) the joints' unit axes of an arm at `joints` (m, n), rad or mm."""
    theta = ca.SX.sym("theta", robot.n)
    axes = ca.Function("axes", [theta], [ca.densify(robot.axes(theta))])
    return np.array([np.array(axes(row)).T for row in joints])


def floor_of(robot: Robot) -> float:
    """Height of the arm's mounting face in the base frame, mm: 0 where it is not stated."""
    return -(robot.conventions.below_base or 0.0) + 0.0


def scene_json(scene: Scene3D) -> dict[str, object]:
    """The scene as `scene.js` reads it."""
    return {
        "grid": {"step": scene.grid_step, "bounds": list(scene.grid_bounds), "z": scene.floor},
        "axis": scene.axis,
        "factor": scene.factor,
        "kinds": list(scene.kinds),
        "outlines": [_rounded(outline) for outline in scene.outlines],
        "targets": [
            {
                "name": target.short_name,
                "at": _rounded(target.at),
                "state": target.state,
                "axes": None if target.axes is None else _significant(target.axes),
            }
            for target in scene.targets
        ],
        "postures": [
            {
                "name": posed.name,
                "arm": _rounded(posed.arm),
                "tool": _rounded(posed.tool_line),
                "beam": None if posed.beam is None else _rounded(posed.beam),
                "reaches": bool(posed.reaches),
                "sights": [_rounded(sight) for sight in posed.sights],
                "numbers": [{"at": _rounded(at), "text": text} for at, text in posed.labels],
                **({} if posed.axes is None else {"axes": (np.round(posed.axes, 3) + 0.0).tolist()}),
            }
            for posed in scene.postures
        ],
    }


def _rounded(values: Matrix) -> list[Any]:
    return (np.round(values, 1) + 0.0).tolist()  # type: ignore[no-any-return]


def _significant(axes: Matrix) -> list[list[float]]:
    """Half axes may be far below a tenth of a millimetre, and are drawn up to a thousand times as large."""
    return [[float(f"{value:.4g}") for value in axis] for axis in axes]
