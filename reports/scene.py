"""What a 3D picture shows: an arm in its postures, its beams and the targets, turned by hand or still. Base
frame, mm, z up."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from markupsafe import Markup, escape
from pydantic import PlainSerializer

from ..model.arrays import Matrix
from ..model.files.whole_file import refuse_existing, write_whole
from ..model.kinematics.robot import Robot
from ..model.records import if_any, internal, key, record, to_json
from ..words import numbers
from ..words.wording import clipped, counted
from .output.html import Turnable, scene_html, template_text
from .style.canvas import Picture
from .style.theme import in_font, light

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


STILL = "postures"  # name of the still drawing among the figures


def turnable(
    scene: Scene3D, *, alt: str, caption: str, paper: str, one: str = "posture", placed: str = "target"
) -> Turnable:
    """The scene made ready for a page: `alt` is said instead of it, `caption` below it, `paper` on paper;
    `one` is what a posture is called, `placed` what has a place."""
    states = {target.state for target in scene.targets}
    beams = any(posed.end is not None for posed in scene.postures)
    return Turnable(
        alt=alt,
        caption=caption,
        paper=paper,
        one=one,
        count=len(scene.postures),
        beams=beams,
        sights=any(posed.sights for posed in scene.postures),
        surfaces=bool(scene.outlines),
        unreached=beams and not all(posed.reaches for posed in scene.postures),
        located=bool(states - {"undetermined"}),
        placed=placed,
        undetermined="undetermined" in states,
        factor=scene.factor,
        drawing=still(scene, alt),
        data=_script_json(scene),
    )


def still_picture(shown: Turnable, name: str = STILL) -> Picture:
    """The still drawing as a figure of its own, for a PDF: its style within it, in the light palette."""
    rules = re.findall(r"^[^{}@\n]*\.still[^{}\n]*\{[^}]*\}", template_text("scene.css"), flags=re.MULTILINE)
    css = re.sub(r"var\(--(\w+)\)", lambda match: light(match.group(1)), "\n".join(rules))
    _, _, width, height = re.findall(r'viewBox="(\S+) (\S+) (\S+) (\S+)"', shown.drawing)[0]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
    svg = in_font(str(shown.drawing)).replace("<svg ", head, 1).replace(">", f"><style>{css}</style>", 1)
    return Picture(name, f"{shown.caption} {shown.paper}", shown.alt, svg)


def exaggerated(factor: float) -> str:
    """An ellipsoid's factor in words."""
    return "at its true size" if factor == 1 else f"{factor:g} times its true size"


def _script_json(scene: Scene3D) -> Markup:
    """JSON that no name can end early: inside <script> only `<` (and, to be sure, `>` and `&`) matter."""
    text = json.dumps(to_json(scene), separators=(",", ":"), allow_nan=False)
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)


MOST_DRAWN = 60  # postures: more than that are a blot
_SIZE = (720.0, 470.0)


def still(scene: Scene3D, alt: str) -> Markup:
    """The scene from its first side without perspective, as SVG in the palette's variables."""
    width, height = _SIZE
    postures = scene.postures[:MOST_DRAWN]
    flat = _Flat(scene, width, height)
    parts = [_grid(scene, flat), _axes(scene, flat)]
    parts += [flat.line(outline, "surface") for outline in scene.outlines]
    for posture in reversed(postures):
        selected = posture is postures[0]
        kind = "arm first" if selected else "arm"
        if posture.beam is not None:
            state = "beam" if posture.reaches else "beam missing"
            parts.append(flat.line(posture.beam, state))
        parts += [flat.line(sight, "sight first" if selected else "sight") for sight in posture.sights]
        parts.append(flat.line(posture.tool_line, f"{kind} tool"))
        parts.append(flat.line(posture.arm, kind))
        if selected:
            for joint in posture.numbers:
                parts += [flat.dot(joint.at, 4, "joint"), flat.text(joint.at, joint.text, 9, -7)]
    for target in scene.targets:
        parts += _target(target, scene.factor, flat)
    return Markup('<svg class="still" viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        round(width), round(height), alt, Markup("").join(parts)
    )


# What is not determined is a cross, what is held a square: a shape and a word, not a colour alone.
_CROSS = ((-6, -6, 6, 6), (-6, 6, 6, -6))
_SQUARE = ((-5, -5, 5, -5), (5, -5, 5, 5), (5, 5, -5, 5), (-5, 5, -5, -5))
_HAIRS = ((-8, 0, 8, 0), (0, -8, 0, 8))


def _target(target: Placed, factor: float | None, flat: _Flat) -> list[Markup]:
    at, name, axes = target.at, target.short_name, target.axes
    if target.state == "undetermined":
        parts = [flat.strokes(at, _CROSS, "undetermined")]
        name += ": not determined"
    elif target.state == "held":
        parts = [flat.strokes(at, _SQUARE, "held")]
        name += ": held"
    elif axes is not None and factor is not None:
        parts = [flat.ellipsoid(at, axes, factor), flat.strokes(at, _HAIRS, "target")]
    else:
        parts = [flat.dot(at, 5, "target")]
    return [*parts, flat.text(at, name, 10, 14)]


class _Flat:
    """Base frame (mm) to the drawing (px), fitted to what the scene holds."""

    def __init__(self, scene: Scene3D, width: float, height: float) -> None:
        azimuth, elevation = np.radians([AZIMUTH, ELEVATION])
        right = [-math.sin(azimuth), math.cos(azimuth), 0.0]
        down = [math.sin(elevation) * math.cos(azimuth), math.sin(elevation) * math.sin(azimuth)]
        self._turn = np.array([right, [*down, -math.cos(elevation)]])
        points = [np.array([0.0, 0.0, scene.axis]), *(target.at for target in scene.targets)]
        for posture in scene.postures[:MOST_DRAWN]:
            points += [*posture.arm, posture.tool, *(() if posture.end is None else (posture.end,))]
            points += [point for sight in posture.sights for point in sight]
        points += [point for outline in scene.outlines for point in outline]
        for target in scene.targets:
            if target.axes is not None and scene.factor is not None:
                points += [
                    target.at + by * axis for axis in target.axes for by in (-scene.factor, scene.factor)
                ]
        flat = np.array(points) @ self._turn.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = np.array([width - 100, height - 60])
        self._scale = float((room / np.maximum(high - low, 1e-6)).min())
        self._shift = np.array([width, height]) / 2 - self._scale * (low + high) / 2

    def _at(self, point: Matrix) -> tuple[float, float]:
        x, y = self._scale * (self._turn @ point) + self._shift
        return round(float(x), 1), round(float(y), 1)

    def line(self, points: Matrix, kind: str) -> Markup:
        path = " ".join(f"{x:g},{y:g}" for x, y in map(self._at, points))
        return Markup('<polyline class="{}" points="{}"/>').format(kind, path)

    def dot(self, point: Matrix, size: float, kind: str) -> Markup:
        x, y = self._at(point)
        return Markup('<circle class="{}" cx="{:g}" cy="{:g}" r="{:g}"/>').format(kind, x, y, size)

    def strokes(self, point: Matrix, lines: Iterable[tuple[int, int, int, int]], kind: str) -> Markup:
        """Lines (x, y to x, y in px) about a point."""
        x, y = self._at(point)
        path = "".join(f"M{x + a:g} {y + b:g}L{x + c:g} {y + d:g}" for a, b, c, d in lines)
        return Markup('<path class="{}" d="{}"/>').format(kind, path)

    def ellipsoid(self, centre: Matrix, axes: Matrix, factor: float) -> Markup:
        """Its outline, A'u over all unit u seen from one side: the ellipse of the matrix P A' A P'."""
        flat = self._scale * factor * self._turn @ axes.T
        size, across = np.linalg.eigh(flat @ flat.T)
        half = np.sqrt(np.maximum(size, 0.0))
        x, y = self._at(centre)
        turn = math.degrees(math.atan2(across[1, 1], across[0, 1]))
        return Markup(
            '<ellipse class="ellipsoid" cx="{:g}" cy="{:g}" rx="{:.4g}" ry="{:.4g}" '
            'transform="rotate({:.1f} {:g} {:g})"/>'
        ).format(x, y, half[1], half[0], turn, x, y)

    def text(self, point: Matrix, text: str, right: float, down: float) -> Markup:
        x, y = self._at(point)
        return Markup('<text x="{:g}" y="{:g}">{}</text>').format(x + right, y + down, escape(text))


def _grid(scene: Scene3D, flat: _Flat) -> Markup:
    (x0, x1, y0, y1), step, z = scene.grid.bounds, scene.grid.step, scene.grid.z
    lines = [[[x, y0, z], [x, y1, z]] for x in np.arange(x0, x1 + step / 2, step)]
    lines += [[[x0, y, z], [x1, y, z]] for y in np.arange(y0, y1 + step / 2, step)]
    return Markup("").join(flat.line(np.array(line), "grid") for line in lines)


def _axes(scene: Scene3D, flat: _Flat) -> Markup:
    parts = []
    if scene.floor:
        parts.append(flat.line(np.array([[0.0, 0.0, scene.floor], np.zeros(3)]), "axis"))
    for i, name in enumerate("xyz"):
        end = np.zeros(3)
        end[i] = scene.axis
        parts += [flat.line(np.array([np.zeros(3), end]), "axis"), flat.text(end, name, 4, -3)]
    return Markup("").join(parts)


def write_arm_page(path: Path, robot: Robot, postures: Sequence[Matrix]) -> None:
    """The page with the arm in `postures`, (n,) rad or mm each, as one HTML file; never over another file."""
    refuse_existing(path, or_else="remove it first")
    write_whole(path, arm_page(robot, postures))


def arm_page(robot: Robot, postures: Sequence[Matrix]) -> str:
    """Its text."""
    theta = ca.SX.sym("theta", robot.n)
    skeleton = ca.Function("skeleton", [theta], [ca.densify(robot.skeleton(theta))])
    posed, axes = [], axes_of(robot, np.array(postures))
    for i, joints in enumerate(postures):
        arm = np.array(skeleton(joints)).T
        posed.append(Posed(f"posture {i}", arm, arm[-1], None, True, axes=axes[i]))
    scene = Scene3D(posed, [], floor_of(robot), kinds=[joint.kind for joint in robot.joints])
    name = clipped(robot.name, 40)
    page = turnable(
        scene,
        alt=f"{name}: the arm in {counted(len(posed), 'posture')}, above a floor grid.",
        caption=f"{scene.grid_words}; x, y and z are the base frame. The arm ends at the flange.",
        paper="On paper: posture 0 in black, the others in grey.",
    )
    return scene_html(f"Robot {name}", page)
