"""A scene made ready for a page.

`templates/scene.html.j2` has its markup, `scene.js` turns it, `scene.css` is its style; where no script runs,
and on paper, a still drawing is shown instead.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import json
import re
from dataclasses import dataclass

from markupsafe import Markup

from ..output.html import Turnable
from ..output.template import TEMPLATES
from ..style.canvas import Picture
from ..style.palette import light
from ..style.typeface import in_font
from .drawing import still
from .scene import Scene3D, scene_json

STILL = "postures"  # name of the still drawing among the figures


@dataclass(frozen=True)
class SceneWords:
    """What is said about a scene: `alt` instead of it, `caption` below it, `paper` on paper; `one` is what a
    posture is called. Whether a `laser` made the beams."""

    alt: str
    caption: str
    paper: str
    one: str
    laser: bool


def turnable(scene: Scene3D, words: SceneWords) -> Turnable:
    """The scene made ready for a page."""
    states = {target.state for target in scene.targets}
    # Our own text, with nothing of a plan or run in it.
    script, style = _file("scene.js"), _file("scene.css")
    return Turnable(
        alt=words.alt,
        caption=words.caption,
        paper=words.paper,
        one=words.one,
        laser=words.laser,
        count=len(scene.postures),
        misses=words.laser and not all(posed.reaches for posed in scene.postures),
        placed=bool(states - {"undetermined"}),
        undetermined="undetermined" in states,
        factor=scene.factor,
        drawing=still(scene, words.alt),
        style=Markup(style),
        data=_script_json(scene),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def still_picture(shown: Turnable) -> Picture:
    """The still drawing as a figure of its own, for a PDF: its style within it, in the light palette."""
    rules = re.findall(r"^[^{}@\n]*\.still[^{}\n]*\{[^}]*\}", _file("scene.css"), flags=re.MULTILINE)
    css = re.sub(r"var\(--(\w+)\)", lambda found: light(found.group(1)), "\n".join(rules))
    _, _, width, height = re.findall(r'viewBox="(\S+) (\S+) (\S+) (\S+)"', shown.drawing)[0]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
    svg = in_font(str(shown.drawing)).replace("<svg ", head, 1).replace(">", f"><style>{css}</style>", 1)
    return Picture(STILL, f"{shown.caption} {shown.paper}", shown.alt, svg)


@functools.cache
def _file(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def exaggerated(factor: float) -> str:
    """An ellipsoid's factor in words."""
    return "at its true size" if factor == 1 else f"{factor:g} times its true size"


def _script_json(scene: Scene3D) -> Markup:
    """JSON that no name can end early: inside <script> only `<` (and, to be sure, `>` and `&`) matter."""
    text = json.dumps(scene_json(scene), separators=(",", ":"), allow_nan=False)
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)
