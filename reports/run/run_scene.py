"""A run in 3D: the arm at its measurements, the beams as fitted, and how well each target's place is known.

All of it comes from the part `scene` of `result.json`.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...analysis.answer.result import Result
from ...analysis.diagnostics.scene_data import RunScene, SceneTarget
from ...model.arrays import Matrix
from ...model.instruments.kind import Instrument
from ...words import numbers
from ...words.wording import NOT_DETERMINED, clipped, counted, label, listed
from ..output.html import Turnable
from ..scene import Placed, Posed, Scene3D, exaggerated, turnable
from ..style.blocks import Paragraph, SceneBlock, Section, section_of

_TITLES = {
    "Targets": "Positions of the targets",
    "Instruments": "Position of the instrument",
    "Targets and instruments": "Positions of targets and instruments",
}
_KEYS = {"Targets": "target", "Instruments": "instrument", "Targets and instruments": "target or instrument"}
_MOST_NAMED = 6  # targets in the words next to the picture: more are in the report's tables


def run_scene(result: Result) -> Scene3D | None:
    """The scene of a result; None where the fit did not converge."""
    scene = result.scene
    if scene is None:
        return None
    count = len(scene.shots)
    return Scene3D(
        [
            Posed(
                name=f"measurement {shot.shot} at {clipped(shot.target, 24)} ({i} of {count})",
                arm=np.array(shot.links[:-1]),
                tool=np.array(shot.links[-1]),
                end=None if shot.beam_to is None else np.array(shot.beam_to),
                reaches=shot.ahead,
                sights=[np.array(sight) for sight in shot.sights],
            )
            for i, shot in enumerate(scene.shots, start=1)
        ],
        [_placed(target, scene) for target in scene.targets],
        outlines=[np.array(line) for outline in scene.outlines for line in outline.lines],
    )


def half_axes(covariance: Matrix, radius2: float) -> Matrix:
    """(3, 3) rows are the half axes of the ellipsoid of a covariance (3, 3), the longest last."""
    size, across = np.linalg.eigh(covariance)
    return np.asarray((across * np.sqrt(radius2 * np.maximum(size, 0.0))).T)


def _placed(target: SceneTarget, scene: RunScene) -> Placed:
    if target.at_mm is None:
        # It has no place: the cross is where the beams end that are meant for it.
        ends = [shot.beam_to or shot.links[-1] for shot in scene.shots if shot.target == target.name]
        at = np.mean(ends, axis=0) if ends else np.zeros(3)
        return Placed(target.name, at, "undetermined")
    at = np.array(target.at_mm)
    if target.covariance_mm2 is None:
        return Placed(target.name, at, "held")
    return Placed(target.name, at, "estimated", half_axes(np.array(target.covariance_mm2), scene.radius2))


# ── its words ───────────────────────────────────────────────────────────────────────────────


def run_turnable(result: Result) -> Turnable | None:
    """The scene made ready for the report's page; None where there is none, as of a misfit."""
    recorded, scene = result.scene, run_scene(result)
    if recorded is None or scene is None or result.misfit is not None:
        return None
    positions = _positions(recorded)
    count, all_shots = len(scene.postures), len(result.shots)
    kinds = dict.fromkeys(result.inputs.instruments.values())
    what = f"with {_listed_parts(kinds)} as fitted"
    more = "" if len(positions) <= _MOST_NAMED else f"; and {len(positions) - _MOST_NAMED} more"
    named = f" {_places(recorded)} (x, y, z in the base frame): {'; '.join(positions[:_MOST_NAMED])}{more}."
    targets = named if positions else ""
    open_ = [
        label(row.name)
        for row in result.parameters
        if row.status == "unidentifiable" and row.group in ("offset", "tool") and not row.tolerated
    ]
    nominal = ""
    if open_:
        be, them = ("is", "it") if len(open_) == 1 else ("are", "them")
        nominal = f" {listed(open_)} {be} {NOT_DETERMINED}: the picture has {them} at the nominal values."
    size = "" if scene.factor is None else f"; an ellipsoid is drawn {exaggerated(scene.factor)}"
    return turnable(
        scene,
        alt=f"The arm in {counted(count, 'measurement')}, {what}, above a floor grid.{targets}",
        caption=f"The arm at the recorded joints with the fitted offsets, {counted(count, 'measurement')}"
        f"{'' if count == all_shots else f' of {all_shots}'}. {scene.grid_words}; x, y and z are the base"
        f" frame.{nominal}",
        paper=f"On paper: measurement {recorded.shots[0].shot} in black, the others in grey{size}.",
        one="measurement",
        placed=_KEYS[_places(recorded)],
    )


def _listed_parts(kinds: Iterable[type[Instrument]]) -> str:
    """What is drawn of the kinds of instruments."""
    return listed(["its beams" if kind.beam else f"the {kind.words.part}" for kind in kinds])


def _places(scene: RunScene) -> str:
    """What has a place."""
    stations = sum(target.station for target in scene.targets)
    if not stations:
        return "Targets"
    return "Instruments" if stations == len(scene.targets) else "Targets and instruments"


def scene_section(result: Result, *, drawn: bool = True) -> Section | None:
    """The section of the report: a paragraph on the targets' places, which paper has too, and the picture,
    unless that is not to be `drawn` here."""
    scene = result.scene
    if scene is None:
        return None
    picture = [SceneBlock(screen_only=True)] if drawn else []
    return section_of(_TITLES[_places(scene)], Paragraph(_sentences(_positions(scene), scene)), *picture)


def _positions(scene: RunScene) -> list[str]:
    return [_position_words(target, scene.radius2) for target in scene.targets]


def _sentences(positions: list[str], scene: RunScene) -> str:
    if not positions:
        return "The run has no target whose position is estimated."
    text = f"In the base frame (x, y, z): {'; '.join(positions[:_MOST_NAMED])}."
    if len(positions) > _MOST_NAMED:
        text += f" The other {len(positions) - _MOST_NAMED} are in the picture and in result.json."
    if any(target.covariance_mm2 is not None for target in scene.targets):
        text += (
            " The ellipsoid holds the place at 95\u00a0%, its three coordinates taken together: it is wider"
            " than the intervals of the single ones."
        )
    return text


def _position_words(target: SceneTarget, radius2: float) -> str:
    name = f"{'instrument ' if target.station else ''}{clipped(target.name, 24)}"
    if target.at_mm is None:
        return f"{name} {NOT_DETERMINED}"
    if target.covariance_mm2 is None:
        return f"{name} held in at least one coordinate"
    covariance = np.array(target.covariance_mm2)
    std = np.sqrt(np.diag(covariance)).tolist()
    coordinates = [numbers.estimate(value, u) for value, u in zip(target.at_mm, std, strict=True)]
    sizes = np.linalg.norm(half_axes(covariance, radius2), axis=1)
    axes = numbers.with_unit(listed([numbers.spread(float(size)) for size in sizes[::-1]]), "mm")
    at = numbers.with_unit(", ".join(coordinates), "mm")
    return f"{name} at {at}, half axes of its 95\u00a0% ellipsoid {axes}"
