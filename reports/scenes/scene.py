"""The turnable picture of an arm, its beams and targets: one component for the page of a plan and a report.

A scene is plain JSON, mm in the base frame, z up. `templates/scene.html.j2` has its markup, `scene.js` turns
it, `scene.css` is its style; where no script runs, and on paper, a still drawing stands in its place.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from markupsafe import Markup, escape

from ...model.robot import Matrix
from ..output.html import Turnable
from ..output.template import TEMPLATES
from ..words.wording import clipped

Json = dict[str, Any]

MOST_DRAWN = 60  # postures in the drawing for paper: more than that are a blot
AZIMUTH, ELEVATION = -62.0, 20.0  # degrees: from where the scene is first seen, over y < 0
LARGEST_FACTOR = 1000  # that an ellipsoid can be exaggerated by
_READABLE = 0.12  # of the scene's radius: an ellipsoid is first drawn as large as that, at most
_ONE_PLACE = 15.0  # mm: joints nearer to each other than this share one number
_SIZE = (720.0, 470.0)


class Posed(NamedTuple):
    """The arm in one posture: its `name`, `arm` (n + 2, 3) from the base over the joints to the flange,
    `tool` (3,) the laser's origin or the probe's tip, `end` (3,) of the beam, None for a probe, and whether
    it `reaches` its target."""

    name: str
    arm: Matrix
    tool: Matrix
    end: Matrix | None
    reaches: bool


class Placed(NamedTuple):
    """A target `at` (3,): where it is `supposed` before any shot, `told` by the data or `held` there, or
    `untold`, drawn where its beams end. `axes` (3, 3): rows are half axes of the ellipsoid of its place."""

    name: str
    at: Matrix
    state: Literal["supposed", "told", "held", "untold"]
    axes: Matrix | None = None


def scene_json(postures: Sequence[Posed], targets: Sequence[Placed]) -> Json:
    """The scene as plain JSON; joint numbers stand where joints are, and `factor` is by how much ellipsoids
    are exaggerated at first, None where there are none."""
    everything = np.array(
        [
            *(point for posed in postures for point in (*posed.arm, posed.tool)),
            *(posed.end for posed in postures if posed.end is not None),
            *(target.at for target in targets),
            np.zeros(3),
        ]
    )
    low, high = everything.min(axis=0), everything.max(axis=0)
    centre = (low + high) / 2
    radius = max(float(np.linalg.norm(everything - centre, axis=1).max()), 1.0)
    extent = float((high - low)[:2].max())
    step = _grid_step(extent)
    # Postures in one plane stand on a floor all the same: half as wide as long, at least.
    wide = np.maximum((high - low)[:2], extent / 2) / 2 + step / 2
    first = np.floor((centre[:2] - wide) / step) * step
    last = np.ceil((centre[:2] + wide) / step) * step
    return {
        "centre": _rounded(centre),
        "radius": round(radius, 1),
        "view": [AZIMUTH, ELEVATION],
        "grid": {"step": step, "bounds": [first[0], last[0], first[1], last[1]]},
        "axis": round(0.22 * radius, 1),
        "factor": _factor(targets, radius),
        "targets": [
            {
                "name": clipped(target.name, 24),
                "at": _rounded(target.at),
                "state": target.state,
                "axes": None if target.axes is None else _significant(target.axes),
            }
            for target in targets
        ],
        "postures": [
            {
                "name": posed.name,
                "arm": _rounded(posed.arm),
                "tool": _rounded(np.array([posed.arm[-1], posed.tool])),
                "beam": None if posed.end is None else _rounded(np.array([posed.tool, posed.end])),
                "reaches": bool(posed.reaches),
                "numbers": _numbers(posed.arm),
            }
            for posed in postures
        ],
    }


def turnable(scene: Json, words: Json) -> Turnable:
    """The scene made ready for a page: words are {alt, caption, paper, one, laser}, `one` what a posture is
    called."""
    postures, states = scene["postures"], {target["state"] for target in scene["targets"]}
    shown = {
        "count": len(postures),
        "misses": words["laser"] and not all(posture["reaches"] for posture in postures),
        "placed": states != {"untold"},
        "untold": "untold" in states,
        "factor": scene["factor"],
    }
    # Our own text, with nothing of a plan or run in it.
    script, style = _file("scene.js"), _file("scene.css")
    return Turnable(
        words={**words, **shown},
        drawing=_drawing(scene, words["alt"]),
        style=Markup(style),
        data=_script_json(scene),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


@functools.cache
def _file(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def exaggerated(factor: float) -> str:
    """An ellipsoid's factor in words."""
    return "at its true size" if factor == 1 else f"{factor:g} times its true size"


def _script_json(value: Json) -> Markup:
    """JSON that no name can end early: inside <script> only `<` (and, to be sure, `>` and `&`) matter."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)


def _factor(targets: Sequence[Placed], radius: float) -> int | None:
    """The largest power of ten that leaves every ellipsoid readable beside the arm."""
    axes = [np.linalg.norm(target.axes, axis=1).max() for target in targets if target.axes is not None]
    if not axes:
        return None
    exponent = math.floor(math.log10(_READABLE * radius / max(axes)))
    return int(10 ** np.clip(exponent, 0, math.log10(LARGEST_FACTOR)))


def _grid_step(extent: float) -> float:
    """The roundest step (1, 2 or 5 times a power of ten, mm) of a grid of about ten lines."""
    rough = max(extent, 1.0) / 8
    power = 10.0 ** math.floor(math.log10(rough))
    return float(next(power * k for k in (1, 2, 5, 10) if power * k >= rough))


def _numbers(arm: Matrix) -> list[Json]:
    """Joint numbers and where they go; joints at one place share a label (a spherical wrist: 4, 5, 6)."""
    places: list[tuple[Matrix, list[str]]] = []
    for joint, point in enumerate(arm[1:-1], start=1):
        for place, names in places:
            if np.linalg.norm(place - point) < _ONE_PLACE:
                names.append(str(joint))
                break
        else:
            places.append((point, [str(joint)]))
    return [{"at": _rounded(place), "text": ", ".join(names)} for place, names in places]


def _rounded(values: Matrix) -> list[Any]:
    return (np.round(values, 1) + 0.0).tolist()  # type: ignore[no-any-return]


def _significant(axes: Matrix) -> list[list[float]]:
    """Half axes may be far below a tenth of a millimetre, and are drawn up to a thousand times as large."""
    return [[float(f"{value:.4g}") for value in axis] for axis in axes]


# ── the drawing for paper ─────────────────────────────────────────────────────────────────────


def _drawing(scene: Json, alt: str) -> Markup:
    """The scene from its first side without perspective, as SVG in the palette's variables."""
    width, height = _SIZE
    postures = scene["postures"][:MOST_DRAWN]
    flat = _Flat(scene, width, height)
    parts = [_grid(scene, flat), _axes(scene, flat)]
    for posture in reversed(postures):
        selected = posture is postures[0]
        kind = "arm first" if selected else "arm"
        if posture["beam"]:
            state = "beam" if posture["reaches"] else "beam missing"
            parts.append(flat.line(posture["beam"], state))
        parts.append(flat.line(posture["tool"], f"{kind} tool"))
        parts.append(flat.line(posture["arm"], kind))
        if selected:
            for number in posture["numbers"]:
                parts.append(flat.dot(number["at"], 4, "joint"))
                parts.append(flat.text(number["at"], number["text"], 9, -7))
    for target in scene["targets"]:
        parts += _target(target, scene["factor"], flat)
    return Markup('<svg class="still" viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        round(width), round(height), alt, Markup("").join(parts)
    )


# What is not determined is a cross, what is held a square: told by shape and word, not by colour alone.
_CROSS = ((-6, -6, 6, 6), (-6, 6, 6, -6))
_SQUARE = ((-5, -5, 5, -5), (5, -5, 5, 5), (5, 5, -5, 5), (-5, 5, -5, -5))
_HAIRS = ((-8, 0, 8, 0), (0, -8, 0, 8))


def _target(target: Json, factor: float | None, flat: _Flat) -> list[Markup]:
    at, name, axes = target["at"], target["name"], target["axes"]
    if target["state"] == "untold":
        parts = [flat.strokes(at, _CROSS, "untold")]
        name += ": not determined"
    elif target["state"] == "held":
        parts = [flat.strokes(at, _SQUARE, "held")]
        name += ": held"
    elif axes is not None and factor is not None:
        parts = [flat.ellipsoid(at, axes, factor), flat.strokes(at, _HAIRS, "target")]
    else:
        parts = [flat.dot(at, 5, "target")]
    return [*parts, flat.text(at, name, 10, 14)]


class _Flat:
    """Base frame (mm) to the drawing (px), fitted to what the scene holds."""

    def __init__(self, scene: Json, width: float, height: float) -> None:
        azimuth, elevation = np.radians(scene["view"])
        right = [-math.sin(azimuth), math.cos(azimuth), 0.0]
        down = [math.sin(elevation) * math.cos(azimuth), math.sin(elevation) * math.sin(azimuth)]
        self._turn = np.array([right, [*down, -math.cos(elevation)]])
        points: list[list[float]] = []
        for posture in scene["postures"][:MOST_DRAWN]:
            points += posture["arm"] + posture["tool"] + (posture["beam"] or [])
        points += [target["at"] for target in scene["targets"]] + [[0.0, 0.0, scene["axis"]]]
        for target in scene["targets"]:
            for axis in target["axes"] or []:
                for by in (-scene["factor"], scene["factor"]):
                    points.append([at + by * half for at, half in zip(target["at"], axis, strict=True)])
        seen = np.array(points) @ self._turn.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        room = np.array([width - 100, height - 60])
        self._scale = float((room / np.maximum(high - low, 1e-6)).min())
        self._shift = np.array([width, height]) / 2 - self._scale * (low + high) / 2

    def _at(self, point: list[float]) -> tuple[float, float]:
        x, y = self._scale * (self._turn @ np.array(point)) + self._shift
        return round(float(x), 1), round(float(y), 1)

    def line(self, points: list[list[float]], kind: str) -> Markup:
        path = " ".join(f"{x:g},{y:g}" for x, y in map(self._at, points))
        return Markup('<polyline class="{}" points="{}"/>').format(kind, path)

    def dot(self, point: list[float], size: float, kind: str) -> Markup:
        x, y = self._at(point)
        return Markup('<circle class="{}" cx="{:g}" cy="{:g}" r="{:g}"/>').format(kind, x, y, size)

    def strokes(self, point: list[float], lines: Iterable[tuple[int, int, int, int]], kind: str) -> Markup:
        """Lines (x, y to x, y in px) about a point."""
        x, y = self._at(point)
        path = "".join(f"M{x + a:g} {y + b:g}L{x + c:g} {y + d:g}" for a, b, c, d in lines)
        return Markup('<path class="{}" d="{}"/>').format(kind, path)

    def ellipsoid(self, centre: list[float], axes: list[list[float]], factor: float) -> Markup:
        """Its outline, A'u over all unit u seen from one side: the ellipse of the matrix P A' A P'."""
        seen = self._scale * factor * self._turn @ np.array(axes).T
        size, across = np.linalg.eigh(seen @ seen.T)
        half = np.sqrt(np.maximum(size, 0.0))
        x, y = self._at(centre)
        turn = math.degrees(math.atan2(across[1, 1], across[0, 1]))
        return Markup(
            '<ellipse class="ellipsoid" cx="{:g}" cy="{:g}" rx="{:.4g}" ry="{:.4g}" '
            'transform="rotate({:.1f} {:g} {:g})"/>'
        ).format(x, y, half[1], half[0], turn, x, y)

    def text(self, point: list[float], text: str, right: float, down: float) -> Markup:
        x, y = self._at(point)
        return Markup('<text x="{:g}" y="{:g}">{}</text>').format(x + right, y + down, escape(text))


def _grid(scene: Json, flat: _Flat) -> Markup:
    (x0, x1, y0, y1), step = scene["grid"]["bounds"], scene["grid"]["step"]
    lines = [[[x, y0, 0.0], [x, y1, 0.0]] for x in np.arange(x0, x1 + step / 2, step)]
    lines += [[[x0, y, 0.0], [x1, y, 0.0]] for y in np.arange(y0, y1 + step / 2, step)]
    return Markup("").join(flat.line(line, "grid") for line in lines)


def _axes(scene: Json, flat: _Flat) -> Markup:
    parts = []
    for i, name in enumerate("xyz"):
        end = [0.0, 0.0, 0.0]
        end[i] = scene["axis"]
        parts += [flat.line([[0.0, 0.0, 0.0], end], "axis"), flat.text(end, name, 4, -3)]
    return Markup("").join(parts)
