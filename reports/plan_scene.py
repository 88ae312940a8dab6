"""A plan as a scene: the arm in each posture, its beams and targets, for canvas and SVG alike."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup, escape
from threadpoolctl import threadpool_limits

from ..analysis.aim import aim, servo_joints
from ..model.plan import Plan
from ..model.problem import Problem
from ..model.robot import Matrix
from .wording import clipped

Json = dict[str, Any]

MOST_DRAWN = 60  # postures in the drawing for paper: more than that are a blot
AZIMUTH, ELEVATION = -62.0, 20.0  # degrees: from where the scene is first seen, over y < 0
_ONE_PLACE = 15.0  # mm: joints nearer to each other than this share one number
_SVG_SIZE = (720.0, 470.0)


class Aim(NamedTuple):
    """The postures as the servo will leave them, where it can turn them onto their targets.

    `joints` (N, n) rad or mm, as planned where `hit` (N,) is False; `skeleton` (N, n + 2, 3), `origin`
    (N, 3), `direction` (N, 3, zero for a probe) and `targets` (K, 3) mm in the base frame; `target`
    (N,) which target is meant; `length` (N,) mm along the beam to the point nearest to the target,
    negative where the laser points away from it.
    """

    joints: Matrix
    hit: np.ndarray[tuple[int], np.dtype[np.bool_]]
    skeleton: Matrix
    origin: Matrix
    direction: Matrix
    targets: Matrix
    target: np.ndarray[tuple[int], np.dtype[np.int64]]
    length: Matrix

    @property
    def reaches(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """(N,) True where beam or probe comes to the target: a laser shines one way only."""
        return self.hit & (self.length >= 0)


def aimed_postures(plan: Plan) -> Aim:
    """What `check` judges, as places in the base frame: no offsets, targets where they are supposed."""
    with threadpool_limits(limits=1, user_api="blas"):
        problem = Problem.from_plan(plan)
        x = problem.supposed()
        aimed = aim(problem, x, servo_joints(problem))
        joints = np.where(aimed.hit[:, None], aimed.problem.joints, plan.postures)
        shots = problem.moved(joints)
        delta, targets, _ = problem.split(x)
        (points,) = problem.functions.kernel("skeleton")(joints, delta)
        origin, direction = shots.beams(x)
    between = targets[problem.target_index] - origin
    return Aim(
        joints,
        aimed.hit,
        points.transpose(0, 2, 1),
        origin,
        direction,
        targets,
        problem.target_index,
        (between * direction).sum(axis=1),
    )


def plan_scene(plan: Plan, aimed: Aim) -> Json:
    """The scene as plain JSON, mm in the base frame, z up; joint numbers stand where joints are.

    `beam` is None for a probe. A beam that does not reach its target is drawn as long as that is far.
    """
    drawn = [aimed.skeleton.reshape(-1, 3), aimed.origin, aimed.targets, np.zeros((1, 3))]
    beams = _beams(plan, aimed)
    everything = np.concatenate([*drawn, *beams.reshape(1, -1, 3)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    centre = (low + high) / 2
    radius = max(float(np.linalg.norm(everything - centre, axis=1).max()), 1.0)
    extent = float((high - low)[:2].max())
    step = _grid_step(extent)
    # Postures in one plane stand on a floor all the same: half as wide as long, at least.
    wide = np.maximum((high - low)[:2], extent / 2) / 2 + step / 2
    first = np.floor((centre[:2] - wide) / step) * step
    last = np.ceil((centre[:2] + wide) / step) * step
    laser = plan.header.tool.kind == "laser"
    return {
        "centre": _rounded(centre),
        "radius": round(radius, 1),
        "view": [AZIMUTH, ELEVATION],
        "grid": {"step": step, "bounds": [first[0], last[0], first[1], last[1]]},
        "axis": round(0.22 * radius, 1),
        "targets": [
            {"name": clipped(name, 24), "at": _rounded(place)}
            for name, place in zip(plan.target_names, aimed.targets, strict=True)
        ],
        "postures": [
            {
                "arm": _rounded(aimed.skeleton[i]),
                "tool": _rounded(np.array([aimed.skeleton[i, -1], aimed.origin[i]])),
                "beam": _rounded(beams[i]) if laser else None,
                "reaches": bool(aimed.reaches[i]),
                "numbers": _numbers(aimed.skeleton[i]),
            }
            for i in range(len(aimed.joints))
        ],
    }


def _beams(plan: Plan, aimed: Aim) -> Matrix:
    """(N, 2, 3) mm, from the laser on; both ends at the tip for a probe, whose direction is zero."""
    far = np.linalg.norm(aimed.targets[aimed.target] - aimed.origin, axis=1)
    length = np.where(aimed.reaches, aimed.length, far)
    return np.stack([aimed.origin, aimed.origin + length[:, None] * aimed.direction], axis=1)


def _grid_step(extent: float) -> float:
    """The roundest step (1, 2 or 5 times a power of ten, mm) of a grid of about ten lines."""
    rough = max(extent, 1.0) / 8
    power = 10.0 ** math.floor(math.log10(rough))
    return float(next(power * k for k in (1, 2, 5, 10) if power * k >= rough))


def _numbers(skeleton: Matrix) -> list[Json]:
    """Joint numbers and where they go; joints at one place share a label (a spherical wrist: 4, 5, 6)."""
    places: list[tuple[Matrix, list[str]]] = []
    for joint, point in enumerate(skeleton[1:-1], start=1):
        for place, names in places:
            if np.linalg.norm(place - point) < _ONE_PLACE:
                names.append(str(joint))
                break
        else:
            places.append((point, [str(joint)]))
    return [{"at": _rounded(place), "text": ", ".join(names)} for place, names in places]


def _rounded(values: Matrix) -> list[Any]:
    return np.round(values, 1).tolist()  # type: ignore[no-any-return]


# ── the drawing for paper ─────────────────────────────────────────────────────────────────────


def scene_svg(scene: Json, alt: str) -> Markup:
    """The scene from its first side without perspective, as SVG in the palette's variables."""
    width, height = _SVG_SIZE
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
        parts.append(flat.dot(target["at"], 5, "target"))
        parts.append(flat.text(target["at"], target["name"], 10, 14))
    return Markup('<svg class="still" viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>').format(
        round(width), round(height), alt, Markup("").join(parts)
    )


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
