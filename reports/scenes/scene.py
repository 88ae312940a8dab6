"""What a 3D picture shows: an arm in its postures, its beams and the targets. Base frame, mm, z up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, partial
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import PlainSerializer

from ...model.arrays import Matrix
from ...model.kinematics.robot import Robot
from ...model.records import if_any, internal, key, record
from ...words import numbers
from ...words.wording import clipped

AZIMUTH, ELEVATION = -62.0, 20.0  # degrees: from where the scene is first seen, over y < 0
LARGEST_FACTOR = 1000  # that an ellipsoid can be exaggerated by
_READABLE = 0.12  # of the scene's radius: an ellipsoid is first drawn as large as that, at most
_ONE_PLACE = 15.0  # mm: joints nearer to each other than this share one number
_NAME_WIDTH = 24


def _rounded(points: Matrix | None, decimals: int = 1) -> Any:
    return None if points is None else (np.round(points, decimals) + 0.0).tolist()


def _significant(axes: Matrix | None) -> list[list[float]] | None:
    """Half axes may be far below a tenth of a millimetre, and are drawn up to a thousand times as large."""
    return None if axes is None else [[float(f"{value:.4g}") for value in axis] for axis in axes]


# As `scene.js` reads them.
_POINTS = PlainSerializer(_rounded)
_LINES = PlainSerializer(lambda lines: [_rounded(line) for line in lines])


@record(eq=False)
class JointNumbers:
    """The numbers of the joints at one place, `at` (3,)."""

    at: Annotated[Matrix, _POINTS]
    text: str


@record(eq=False)
class Posed:
    """The arm in one posture: its `name`, `arm` (n + 2, 3) from the base over the joints to the flange,
    `tool` (3,) the laser's origin or the probe's tip, `end` (3,) of the beam, None for a probe, whether it
    `reaches` its target, `sights` (2, 3) each from the flange to what an instrument measures, and `axes`
    (n, 3) of the joints, None where only their places are known."""

    name: str
    arm: Annotated[Matrix, _POINTS]
    tool: Annotated[Matrix, internal]
    end: Annotated[Matrix | None, internal]
    reaches: bool
    sights: Annotated[Sequence[Matrix], _LINES] = ()
    axes: Annotated[Matrix | None, if_any, PlainSerializer(partial(_rounded, decimals=3))] = None

    @property
    @key("(2, 3) from the flange to the laser or tip", name="tool")
    def tool_line(self) -> Annotated[Matrix, _POINTS]:
        return np.array([self.arm[-1], self.tool])

    @property
    @key("(2, 3) from the laser to the beam's end")
    def beam(self) -> Annotated[Matrix | None, _POINTS]:
        return None if self.end is None else np.array([self.tool, self.end])

    @property
    @key("joint numbers where the joints are; joints at one place share a label (a wrist: 4, 5, 6)")
    def numbers(self) -> list[JointNumbers]:
        labels: list[tuple[Matrix, list[str]]] = []
        for joint, point in enumerate(self.arm[1:-1], start=1):
            for at, names in labels:
                if np.linalg.norm(at - point) < _ONE_PLACE:
                    names.append(str(joint))
                    break
            else:
                labels.append((point, [str(joint)]))
        return [JointNumbers(at, ", ".join(names)) for at, names in labels]


@record(eq=False)
class Placed:
    """A target `at` (3,): its `nominal` place before any measurement, `estimated` from the data, `held`, or
    `undetermined`, drawn where its beams end. `axes` (3, 3): rows are half axes of its place's ellipsoid."""

    name: Annotated[str, internal]
    at: Annotated[Matrix, _POINTS]
    state: Literal["nominal", "estimated", "held", "undetermined"]
    axes: Annotated[Matrix | None, PlainSerializer(_significant)] = None

    @property
    @key("the name, clipped to what fits into the picture", name="name")
    def short_name(self) -> str:
        return clipped(self.name, _NAME_WIDTH)


@record(eq=False)
class SceneGrid:
    """The floor grid: its `step`, its lowest and highest x, lowest and highest y, its height."""

    step: float
    bounds: tuple[float, float, float, float]
    z: float


@record(eq=False)
class Scene3D:
    """Postures and targets, and the frame that they are seen in; `floor` is how high the mounting face is,
    `outlines` (m, 3) lines of planes and balls, `kinds` those of the joints where they are known."""

    postures: Sequence[Posed]
    targets: Sequence[Placed]
    floor: Annotated[float, internal] = 0.0
    outlines: Annotated[Sequence[Matrix], _LINES] = ()
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
        return f"Grid of {numbers.exact(self.grid.step, 'mm')} at z = {height}"

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
    @key("length of the drawn axes of the base frame")
    def axis(self) -> float:
        return round(0.22 * self.radius, 1)

    @cached_property
    @key("the floor")
    def grid(self) -> SceneGrid:
        """About ten lines, a step of 1, 2 or 5 times a power of ten apart."""
        low, high = self._corners
        size = (high - low)[:2]
        rough = max(float(size.max()), 1.0) / 8
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(power * k for k in (1, 2, 5, 10) if power * k >= rough)
        # Postures in one plane have a floor all the same: half as wide as long, at least.
        wide = np.maximum(size, size.max() / 2) / 2 + step / 2
        first = np.floor((self.centre[:2] - wide) / step) * step
        last = np.ceil((self.centre[:2] + wide) / step) * step
        bounds = (float(first[0]), float(last[0]), float(first[1]), float(last[1]))
        return SceneGrid(float(step), bounds, self.floor)

    @cached_property
    @key(
        "by how much ellipsoids are exaggerated at first: the largest power of ten that leaves every one"
        " readable next to the arm; null where there is no ellipsoid"
    )
    def factor(self) -> int | None:
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
