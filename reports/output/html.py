"""Pages as HTML: one self-contained file. No network, light and dark, phone and paper."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ..style.blocks import Page
from ..style.canvas import Picture, themed
from .template import style, template

if TYPE_CHECKING:
    from markupsafe import Markup

PageKind = Literal["report", "study"]
LARGEST_ATTACHMENT = 200_000


@dataclass(frozen=True)
class Turnable:
    """What a page needs for its scene: what is said about it (`one` is what a posture is called), how many
    postures it has (`count`), what its key explains, the still drawing, the style, the data and the script,
    and the script's hash for the page's policy, which then runs no other."""

    alt: str
    caption: str
    paper: str
    one: str
    laser: bool
    count: int
    misses: bool
    placed: bool
    undetermined: bool
    factor: int | None
    drawing: Markup
    style: Markup
    data: Markup
    script: Markup
    script_hash: str


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


def scene_html(title: str, turnable: Turnable) -> str:
    """A scene alone as an HTML page: one self-contained file."""
    from markupsafe import Markup

    css = Markup(style()) + turnable.style
    return template("scene_page.html.j2").render(title=title, turnable=turnable, css=css)
