"""Pages as self-contained HTML files: no network, light and dark, phone and paper; cards for notebooks."""

from __future__ import annotations

import base64
import functools
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from ..style.blocks import Block, Page, Table
from ..style.canvas import MovingPicture, Picture, themed
from ..style.theme import FAMILY, Cut, css_variables, font_file

TEMPLATES = Path(__file__).parent / "templates"
_WEIGHTS: dict[Cut, str] = {
    "Regular": "font-weight: 400",
    "Bold": "font-weight: 700",
    "Italic": "font-weight: 400; font-style: italic",
}


@functools.cache
def template(name: str) -> Template:
    """A page of `templates`; what is filled in is escaped unless it is marked as ours."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    script = scene_script()
    environment.globals["scene_js"] = Markup(script)
    environment.globals["scene_hash"] = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return environment.get_template(name)


@functools.cache
def template_text(name: str) -> str:
    """A file of `templates` as it is."""
    return (TEMPLATES / name).read_text(encoding="utf-8")


_DRAWING = ("vectors", "colours", "labels", "bodies", "flat")  # each after those that it imports


@functools.cache
def scene_script() -> str:
    """The script of the turnable picture: the modules that draw arms in the app, too, and `scene.js`, without
    imports, exports and comments."""
    parts = [template_text(f"drawing/{name}.js") for name in _DRAWING] + [template_text("scene.js")]
    text = re.sub(r"/\*\*.*?\*/\s*", "", "".join(parts), flags=re.DOTALL)
    text = re.sub(r"^import .*\n|^\s*//.*\n|^\s*\n|(?<=[;{,]) // .*$", "", text, flags=re.MULTILINE)
    return '"use strict";\n{\n' + re.sub(r"^export ", "", text, flags=re.MULTILINE) + "}\n"


@functools.cache
def style() -> str:
    """The style sheet of every page: the typeface, embedded, and the palette in both themes."""
    faces = "\n".join(font_face(cut) for cut in _WEIGHTS)
    return f"{faces}\n{sheet()}"


def sheet() -> str:
    """The same without the typeface."""
    return _coloured(template_text("page.css"))


def _coloured(sheet: str) -> str:
    return sheet.replace("/* LIGHT */", css_variables("light")).replace("/* DARK */", css_variables("dark"))


def font_face(cut: Cut) -> str:
    """The CSS rule that embeds one cut of the typeface."""
    data = base64.b64encode(font_file(cut, "woff2").read_bytes()).decode()
    return (
        f'@font-face {{ font-family: "{FAMILY}"; {_WEIGHTS[cut]}; font-display: block; '
        f'src: url("data:font/woff2;base64,{data}") format("woff2"); }}'
    )


PageKind = Literal["report", "study", "plan"]
LARGEST_ATTACHMENT = 200_000


@dataclass(frozen=True)
class Turnable:
    """A scene made ready for a page: what is said about it (`one` is what a posture is called), how many
    postures it has (`count`), what its key explains, by how much ellipsoids are exaggerated at first
    (`factor`), the still drawing, and the data for `scene.js`."""

    alt: str
    caption: str
    paper: str
    one: str
    count: int
    beams: bool
    sights: bool
    surfaces: bool
    unreached: bool
    located: bool
    placed: str
    undetermined: bool
    factor: int | None
    drawing: Markup
    data: Markup


def html(
    page: Page,
    pictures: Mapping[str, Picture],
    kind: PageKind,
    attached: str = "",
    turnable: Turnable | None = None,
) -> str:
    """A page (`blocks.py`) as HTML; `attached`, the text of result.json, goes with it if under 200 kB.

    `turnable` is shown where a block `scene` is; its script is the only one that the page allows.
    """
    data = attached.encode()
    return template("page.html.j2").render(
        view=page,
        kind=kind,
        pictures=_drawings(pictures),
        css=_css(turnable),
        turnable=turnable,
        attachment=base64.b64encode(data).decode() if 0 < len(data) < LARGEST_ATTACHMENT else None,
    )


def _drawings(pictures: Mapping[str, Picture]) -> dict[str, dict[str, object]]:
    return {name: {"picture": picture, **_drawn(picture)} for name, picture in pictures.items()}


def _drawn(picture: Picture) -> dict[str, Markup | list[Markup]]:
    """A figure as SVG in the palette's variables; one that moves as its panels."""
    if not isinstance(picture, MovingPicture):
        return {"svg": Markup(themed(picture.svg)), "moving": []}
    moving, stills = ([Markup(themed(svg)) for svg in each] for each in (picture.moving, picture.stills))
    return {"moving": moving, "stills": stills}


def scene_html(title: str, turnable: Turnable) -> str:
    """A scene alone as an HTML page: one self-contained file."""
    return template("scene_page.html.j2").render(title=title, turnable=turnable, css=_css(turnable))


def _css(turnable: Turnable | None) -> Markup:
    """Our own text, with nothing of a run in it."""
    return Markup(style() + ("" if turnable is None else template_text("scene.css")))


def card(page: Page | None, tables: Sequence[Table]) -> str:
    """The heading, verdict and notes of a page (or nothing) with some tables, as HTML for another page."""
    return template("card.html.j2").render(
        view=page, tables=tables, css=Markup(_coloured(template_text("card.css")))
    )


def fragment(blocks: Sequence[Block], pictures: Mapping[str, Picture]) -> str:
    """Blocks of a page as HTML for a page that has the style sheet; what is not among the `pictures` is left
    out, as is the scene."""
    return template("blocks.html.j2").render(blocks=blocks, pictures=_drawings(pictures))
