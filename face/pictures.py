"""Figures and scenes that show themselves in a notebook and can be saved."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..model.errors import BadInput
from ..model.files.whole_file import refuse_existing
from ..reports.output.html import Turnable, font_face, scene_html
from ..reports.output.pdf import picture_bytes
from ..reports.style.canvas import Picture
from ..reports.style.theme import light
from ..words.wording import clipped


@dataclass(frozen=True, repr=False)
class Figure:
    """A figure of a report: shows itself in a notebook.

    Attributes
    ----------
    title : str
        Its caption.
    alt : str
        What it shows, in words.
    svg : str
        A whole SVG document.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> sol = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100)
    >>> sol.plot.offsets()
    <Figure offsets: ...>
    """

    _picture: Picture

    @property
    def title(self) -> str:
        """Its caption."""
        return self._picture.title

    @property
    def alt(self) -> str:
        """What it shows, in words."""
        return self._picture.alt

    @property
    def svg(self) -> str:
        """A whole SVG document."""
        return self._picture.svg

    def savefig(self, path: Path | str) -> Path:
        """Write it as the file's ending says: .svg, .pdf or .png (300 dots an inch).

        As with matplotlib, a file that is there is replaced.

        Raises
        ------
        BadInput
            Another ending, or the file cannot be written.
        """
        path = _file(path, (".svg", ".pdf", ".png"))
        form = path.suffix.lower()
        if form == ".svg":
            content = self._picture.svg.encode()
        else:
            content = picture_bytes(self._picture, "pdf" if form == ".pdf" else "png")
        return _written(path, content, "wb")

    def __repr__(self) -> str:
        return f"<Figure {self._picture.name}: {self._picture.title}>"

    def _repr_svg_(self) -> str:
        return self._picture.svg

    def _repr_html_(self) -> str:
        # As an image it brings its typeface along, and its ids stay its own.
        start = self._picture.svg.index(">", self._picture.svg.index("<svg")) + 1
        style = f"<style>{font_face('Regular')}</style>"
        svg = self._picture.svg[:start] + style + self._picture.svg[start:]
        data = base64.b64encode(svg.encode()).decode()
        ground, muted = light("ground"), light("muted")
        return (
            f'<figure style="margin:0;padding:.8rem;max-width:37rem;background:{ground};color:{muted}">'
            f'<img style="width:100%" alt="{html.escape(self.alt)}" src="data:image/svg+xml;base64,{data}">'
            f'<figcaption style="font-size:.875em">{html.escape(self.title)}</figcaption></figure>'
        )


@dataclass(frozen=True, repr=False)
class SceneView:
    """A 3D scene that can be turned: shows itself in a notebook, without a network.

    Attributes
    ----------
    name : str
        Of what it is.
    page : str
        A whole HTML page.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> sol = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100)
    >>> sol.plot.scene()
    <SceneView of good.jsonl>
    """

    name: str
    page: str

    def save(self, path: Path | str) -> Path:
        """Write it to a new file (.html).

        Raises
        ------
        BadInput
            Another ending, or the file exists.
        """
        path = _file(path, (".html",))
        refuse_existing(path)
        return _written(path, self.page.encode(), "xb")

    def __repr__(self) -> str:
        return f"<SceneView of {clipped(self.name, 60)}>"

    def _repr_html_(self) -> str:
        # A page in a frame of its own: it can neither read nor change the notebook around it.
        return (
            f'<iframe title="{html.escape(clipped(self.name, 60))}, in 3D" sandbox="allow-scripts"'
            f' style="width:100%;height:44rem;border:0" srcdoc="{html.escape(self.page)}"></iframe>'
        )


def scene_view(name: str, turnable: Turnable) -> SceneView:
    """The scene of a report as a page of its own."""
    return SceneView(name, scene_html(clipped(name, 60), turnable))


def _file(path: Path | str, endings: tuple[str, ...]) -> Path:
    path = Path(path)
    if path.suffix.lower() not in endings:
        raise BadInput(
            "the file's ending says no known format",
            found=repr(path.name),
            allowed=", ".join(endings),
            argument="path",
        )
    return path


def _written(path: Path, content: bytes, mode: Literal["wb", "xb"]) -> Path:
    try:
        with path.open(mode) as file:
            file.write(content)
    except OSError as error:
        raise BadInput("the file cannot be written", found=error.strerror or str(error), file=path) from error
    return path
