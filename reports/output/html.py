"""Pages as HTML: one self-contained file. No network, light and dark, phone and paper."""

from __future__ import annotations

import base64
import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..style.canvas import Picture, themed
from ..style.palette import css_variables
from ..style.typeface import FAMILY, Cut, font_file

if TYPE_CHECKING:
    from jinja2 import Template

    from ..scenes.scene import Turnable

TEMPLATES = Path(__file__).parent / "templates"
PageKind = Literal["report", "study"]
LARGEST_ATTACHMENT = 200_000
_WEIGHTS: dict[Cut, str] = {
    "Regular": "font-weight: 400",
    "Bold": "font-weight: 700",
    "Italic": "font-weight: 400; font-style: italic",
}


def html(
    page: dict[str, Any],
    pictures: dict[str, Picture],
    kind: PageKind,
    attached: str = "",
    turnable: Turnable | None = None,
) -> str:
    """A page (`blocks.py`) as HTML; `attached`, the text of result.json, goes with it if under 200 kB.

    `turnable` stands where a block `scene` is; its script is the only one that the page allows.
    """
    from markupsafe import Markup

    data = attached.encode()
    return template("page.html.j2").render(
        view=page,
        kind=kind,
        pictures={
            name: {"picture": picture, "svg": Markup(themed(picture.svg))}
            for name, picture in pictures.items()
        },
        # Our own text, with nothing of a run in it.
        css=Markup(style()) + (turnable.style if turnable else ""),
        turnable=turnable,
        attachment=base64.b64encode(data).decode() if 0 < len(data) < LARGEST_ATTACHMENT else None,
    )


@functools.cache
def template(name: str) -> Template:
    """A page of `templates`; what is filled in is escaped unless it is marked as ours."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


@functools.cache
def style() -> str:
    """The style sheet of every page: the typeface, embedded, and the palette in both themes."""
    faces = "\n".join(_face(cut, weight) for cut, weight in _WEIGHTS.items())
    sheet = (TEMPLATES / "page.css").read_text(encoding="utf-8")
    sheet = sheet.replace("/* LIGHT */", css_variables("light")).replace("/* DARK */", css_variables("dark"))
    return f"{faces}\n{sheet}"


def _face(cut: Cut, weight: str) -> str:
    data = base64.b64encode(font_file(cut, "woff2").read_bytes()).decode()
    return (
        f'@font-face {{ font-family: "{FAMILY}"; {weight}; font-display: block; '
        f'src: url("data:font/woff2;base64,{data}") format("woff2"); }}'
    )
