"""The templates of all pages, and the style sheet that they share."""

from __future__ import annotations

import base64
import functools
from pathlib import Path
from typing import TYPE_CHECKING

from ..style.palette import css_variables
from ..style.typeface import FAMILY, Cut, font_file

if TYPE_CHECKING:
    from jinja2 import Template

TEMPLATES = Path(__file__).parent / "templates"
_WEIGHTS: dict[Cut, str] = {
    "Regular": "font-weight: 400",
    "Bold": "font-weight: 700",
    "Italic": "font-weight: 400; font-style: italic",
}


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
    faces = "\n".join(font_face(cut) for cut in _WEIGHTS)
    return f"{faces}\n{sheet()}"


def sheet() -> str:
    """The same without the typeface."""
    text = (TEMPLATES / "page.css").read_text(encoding="utf-8")
    return text.replace("/* LIGHT */", css_variables("light")).replace("/* DARK */", css_variables("dark"))


def font_face(cut: Cut) -> str:
    """The CSS rule that embeds one cut of the typeface."""
    data = base64.b64encode(font_file(cut, "woff2").read_bytes()).decode()
    return (
        f'@font-face {{ font-family: "{FAMILY}"; {_WEIGHTS[cut]}; font-display: block; '
        f'src: url("data:font/woff2;base64,{data}") format("woff2"); }}'
    )
