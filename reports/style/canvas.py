"""The drawing surface of all figures: one style, the shipped typeface, SVG out; logarithmic axes.

Figures are matplotlib's object API with the Agg-free SVG backend, never pyplot's global state. They
are drawn in the light palette on a transparent ground; `themed` turns the palette's colours into
CSS variables, so that inside the HTML they follow its light and dark form.
"""

from __future__ import annotations

import contextlib
import functools
import io
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...analysis.status import UNVALIDATED, Status
from ...words import numbers
from .theme import FAMILY, PALETTE, font_file, light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DASHES = (0, (4, 3))  # of a line that bounds or compares
WIDTH = 6.2  # inches: nearly one text width on paper, and read as it is on a phone
_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"


@dataclass(frozen=True)
class Picture:
    """A finished figure: `title` its caption, `alt` what it shows in words, `svg` a whole SVG document."""

    name: str
    title: str
    alt: str
    svg: str


@dataclass(frozen=True)
class MovingPicture(Picture):
    """A figure of panels that move on a screen: `moving` they are, each a whole SVG document, and `stills`
    are shown instead where motion is not wanted; `svg` has these side by side."""

    stills: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()


@contextlib.contextmanager
def style() -> Iterator[None]:
    """matplotlib's settings for all figures, in force while a figure is made and written."""
    import matplotlib

    _register_typeface()
    ink, muted, line = light("ink"), light("muted"), light("line")
    settings: dict[Any, Any] = {
        "font.family": FAMILY,
        "font.size": 10.0,
        "text.color": ink,
        "axes.labelcolor": muted,
        "axes.edgecolor": line,
        "axes.facecolor": "none",
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.labelsize": 9.5,
        "axes.titlesize": 10.0,
        "axes.unicode_minus": True,
        "axes.formatter.useoffset": False,
        "grid.color": line,
        "grid.linewidth": 0.5,
        "xtick.color": line,
        "ytick.color": line,
        "xtick.labelcolor": muted,
        "ytick.labelcolor": muted,
        "xtick.labelsize": 9.0,
        "ytick.labelsize": 9.0,
        "figure.facecolor": "none",
        "savefig.facecolor": "none",
        "svg.fonttype": "none",
        "svg.hashsalt": "zerobeam",
        "legend.frameon": False,
        "legend.fontsize": 8.5,
        "legend.borderaxespad": 0.1,
        "legend.columnspacing": 1.2,
        "hatch.linewidth": 0.6,
        "hatch.color": line,
        "text.parse_math": False,
    }
    with matplotlib.rc_context(settings):
        yield


@functools.cache
def _register_typeface() -> None:
    from matplotlib import font_manager

    for cut in ("Regular", "Bold", "Italic"):
        font_manager.fontManager.addfont(font_file(cut))


def new_figure(height: float, *, fitted: bool = True) -> Figure:
    """An empty figure, WIDTH by `height` inches, made inside `style()`.

    `fitted` leaves room for labels by itself; it is slow where there are many panels.
    """
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained" if fitted else None)


def bare_y(axes: Axes) -> None:
    """Take away the vertical axis: rows are named by labels."""
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def beside(axes: Axes, x: float, y: float, words: str, *, gap: float = 7, color: str | None = None) -> None:
    """Words to the right of a dot, `gap` points away."""
    colour = color or light("ink")
    axes.annotate(words, (x, y), (gap, 0), textcoords="offset points", va="center", fontsize=9, color=colour)


_HALF = 0.36  # of the strip of a row


def hatched(axes: Axes, y: float, words: str) -> None:
    """The hatched strip of what has no number, at `y`, with `words` that say so."""
    axes.axhspan(y - _HALF, y + _HALF, facecolor="none", edgecolor=light("line"), hatch="/////", linewidth=0)
    if words:
        axes.text(
            0.5,
            y,
            words,
            transform=axes.get_yaxis_transform(),
            ha="center",
            va="center_baseline",
            color=light("unidentifiable"),
            fontsize=9,
            bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 1},
        )


def mark_unvalidated(axes: Axes, statuses: Iterable[Status], *, above: float = 4) -> None:
    """Say above axes, that many points away, that their numbers are unvalidated, where one of these statuses
    is: the axes of every figure of an answer go through here."""
    if "unvalidated" in statuses:
        words = UNVALIDATED.replace(": ", ":\n")  # narrow axes have room for half of it
        axes.set_title(words, loc="left", pad=above, color=light("misfit"), fontsize=8.5)


def to_svg(figure: Figure, name: str) -> str:
    """The figure as an SVG document whose ids begin with `name`, so that several can share one page.

    Text stays text, in the shipped typeface. The same figure gives the same bytes.
    """
    if (layout := figure.get_layout_engine()) is not None:
        # savefig would draw twice, the first time to lay out; it does so beside "none" as well.
        layout.execute(figure)
        figure.set_layout_engine(None)
    written = io.BytesIO()
    figure.savefig(written, format="svg", metadata={"Date": None, "Creator": None})
    whole = written.getvalue().decode()
    root = ElementTree.fromstring(whole)
    used = set(re.findall(r"url\(#([^)]+)\)", whole)) | {
        element.attrib[f"{{{_XLINK}}}href"].removeprefix("#")
        for element in root.iter()
        if f"{{{_XLINK}}}href" in element.attrib
    }
    for element in root.iter():
        name_of = element.attrib.pop("id", None)
        if name_of in used:
            element.set("id", f"{name}-{name_of}")
        for key, value in element.attrib.items():
            if key == f"{{{_XLINK}}}href":
                element.set(key, f"#{name}-{value.removeprefix('#')}")
            elif "url(#" in value:
                element.set(key, value.replace("url(#", f"url(#{name}-"))
    for metadata in root.findall(f"{{{_SVG}}}metadata"):
        root.remove(metadata)
    return _text(root)


def themed(svg: str) -> str:
    """`svg` with the palette's colours as CSS variables (`var(--ink)`), for use inside the HTML."""
    roles = {colour.light: f"var(--{role})" for role, colour in PALETTE.items()}
    root = ElementTree.fromstring(svg)
    for element in root.iter():
        for key in ("style", "fill", "stroke"):
            if key in element.attrib:
                value = element.attrib[key]
                for colour, variable in roles.items():
                    value = value.replace(colour, variable)
                element.set(key, value)
    # Width is the page's matter; the view box keeps the proportions.
    root.attrib.pop("width", None)
    root.attrib.pop("height", None)
    root.set("aria-hidden", "true")
    return _text(root)


def _text(root: ElementTree.Element) -> str:
    ElementTree.register_namespace("", _SVG)
    ElementTree.register_namespace("xlink", _XLINK)
    return ElementTree.tostring(root, encoding="unicode")


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers between `low` and `high`: 1, 2, 5 of each decade, or decades alone if they are many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    factors = (1, 2, 5) if high / low < 60 else (1,)
    return [tick for k in decades for factor in factors if low <= (tick := factor * 10.0**k) <= high]


def set_log_scale(axes: Axes, which: str, low: float, high: float) -> None:
    """A logarithmic scale of `which` (x or y) from `low` to `high` with plain numbers at round ticks."""
    axes.set(**{f"{which}scale": "log", f"{which}lim": (low, high), f"{which}ticks": log_ticks(low, high)})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.minorticks_off()
    axis.set_major_formatter(plain)


def plain(value: float, _: object = None) -> str:
    """A tick's number as people write it."""
    return numbers.exact(value)
