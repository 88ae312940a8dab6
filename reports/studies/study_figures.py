"""The figures of all studies are of two kinds: rows of marks with intervals, and curves over a quantity."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...words import numbers
from ..style.canvas import WIDTH, Picture, bare_y, new_figure, plain, set_log_scale, style, to_svg
from ..style.theme import in_font, light
from .study_blocks import NOT_DETERMINED, spread_range

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROW, _TALLEST, _LETTERS = 0.165, 7.0, 8.5  # inches, inches, points
_LETTER_WIDTH = 0.06  # inches, of the names of ticks that are written upwards
_FEW = 9  # values of a curve that are all in words


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a mark or a curve is drawn: a hollow mark has the ground's colour within."""

    role: str = "identified"
    shape: str = "o"
    filled: bool = True
    size: float = 4.0
    stroke: str = "-"
    width: float = 1.3
    alpha: float = 1.0

    @property
    def line(self) -> Any:
        """The properties of its line, marks included."""
        face = light(self.role if self.filled else "ground")
        marker = {"marker": self.shape, "markersize": self.size, "markerfacecolor": face}
        stroke = {"linestyle": self.stroke or "none", "linewidth": self.width, "alpha": self.alpha}
        return {**marker, **stroke, "color": light(self.role)}


@dataclass(frozen=True)
class Dot:
    """A dot at a value with its interval and `words`, `up` above the middle of its row. Beyond the panel it
    is a triangle at the edge, with the words `beyond`."""

    at: float
    low: float | None = None
    high: float | None = None
    look: Look = Look()
    words: str = ""
    beyond: str = ""
    up: float = 0.0


@dataclass(frozen=True)
class Stretch:
    """A bar between two values; the fainter the smaller `alpha`."""

    low: float
    high: float
    alpha: float = 1.0
    high_in_row: float = 0.4
    up: float = 0.0


@dataclass(frozen=True)
class MarkRow:
    """A row of a figure: what is in each panel, or the words of a `gap`; `words` say it in the alternative
    text where the dots alone do not. A row that is a `head` has its name alone."""

    name: str
    panels: Sequence[Sequence[Dot | Stretch]] = ()
    gap: str = ""
    head: bool = False
    words: str = ""


@dataclass(frozen=True)
class Scale:
    """A scale: logarithmic or not, its ends, its ticks and their names where they are stated."""

    log: bool = False
    ends: tuple[float, float] | None = None
    ticks: Sequence[float] | None = None  # None: where they fall; empty: none
    names: Sequence[str] = ()

    def of(self, values: Iterable[float]) -> tuple[float, float]:
        """Its ends for these values: somewhat beyond them, unless they are stated."""
        known = [value for value in values if math.isfinite(value) and (value > 0 or not self.log)]
        if self.ends is not None:
            return self.ends
        if self.log:
            return log_ends(known)
        low, high = (min(known), max(known)) if known else (0.0, 1.0)
        room = 0.05 * (high - low) or 1.0
        return low - room, high + room

    def put(self, axes: Axes, which: str, values: Iterable[float]) -> tuple[float, float]:
        """Give axes this scale in the direction `which` (x or y)."""
        ends, axis = self.of(values), axes.xaxis if which == "x" else axes.yaxis
        if self.log:
            set_log_scale(axes, which, *ends)
        else:
            axes.set(**{f"{which}lim": ends})
        if self.ticks is not None:
            axis.set_ticks(self.ticks)
        axis.set_major_formatter(plain)
        if self.names:
            axis.set_ticks(
                self.ticks or (), list(map(in_font, self.names)), rotation=90 if self.upright else 0
            )
        return ends

    def name(self, value: float) -> str:
        """The name of a value, or the value itself."""
        return dict(zip(self.ticks or (), self.names, strict=False)).get(value, numbers.exact(value))

    @property
    def upright(self) -> bool:
        """Whether the names are too many to be written side by side."""
        return len(self.names) > 4


@dataclass(frozen=True)
class Across:
    """The scale of a panel of rows, with the values of its `lines`."""

    label: str
    scale: Scale = Scale()
    lines: Sequence[float] = ()
    title: str = ""


Entries = Sequence[
    tuple[Look | Stretch | str, str]
]  # of a legend: a look, a bar, `limit` or a gap, and the words


def rows_picture(
    name: str,
    title: str,
    about: str,
    rows: Sequence[MarkRow],
    panels: Sequence[Across],
    legend: Entries = (),
    *,
    row_height: float = _ROW,
) -> Picture | None:
    """Marks in named rows, None without any; the alternative text says what it is `about`, and the marks."""
    if not rows:
        return None
    around = 0.95 if legend else 0.75
    height = min(_TALLEST, around + row_height * len(rows))
    letters = min(_LETTERS, 0.84 * 72 * (height - around) / len(rows))
    with style():
        figure = new_figure(height)
        every = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for k, (axes, across) in enumerate(zip(every, panels, strict=True)):
            _panel_of_rows(axes, rows, across, k, letters)
        every[0].set_ylim(len(rows) - 0.4, -0.6)
        names = [(y, in_font(row.name)) for y, row in enumerate(rows) if not row.head]
        every[0].set_yticks([y for y, _ in names], [text for _, text in names])
        every[0].tick_params(axis="y", labelcolor=light("ink"), labelsize=letters)
        _heads(figure, every[0], rows, letters)
        legend_above(figure, legend, 3 if any(len(words) > 25 for _, words in legend) else 4)
        svg = to_svg(figure, name)
    return Picture(name, title, f"{about} {_rows_in_words(rows)}", svg)


def _rows_in_words(rows: Sequence[MarkRow]) -> str:
    """The heads, and below them the dots of each row."""
    texts = []
    for row in rows:
        dots = [one for panel in row.panels for one in panel if isinstance(one, Dot)]
        marks = [one.words or one.beyond or numbers.significant(one.at, 2) for one in dots]
        words = row.words or ", ".join([*marks, row.gap] if row.gap else marks)
        texts.append(f"{row.name}:" if row.head else f"{row.name} {words};".lstrip())
    return f"{' '.join(texts).rstrip(';')}."


def _heads(figure: Figure, axes: Axes, rows: Sequence[MarkRow], letters: float) -> None:
    from matplotlib.transforms import blended_transform_factory

    where = blended_transform_factory(figure.transFigure, axes.transData)
    look: Any = {"va": "center_baseline", "fontsize": letters + 0.3, "fontweight": "bold", "transform": where}
    for y, row in enumerate(rows):
        if row.head:
            axes.text(0.008, y + 0.1, in_font(row.name), color=light("ink"), **look).set_in_layout(False)


def _panel_of_rows(axes: Axes, rows: Sequence[MarkRow], across: Across, k: int, letters: float) -> None:
    marks = [one for row in rows if row.panels for one in row.panels[k]]
    values = [
        end for one in marks for end in (one.low, one.high, getattr(one, "at", None)) if end is not None
    ]
    ends = across.scale.put(axes, "x", [*values, *across.lines])
    bare_y(axes)
    axes.grid(visible=False)
    axes.tick_params(axis="x", labelsize=8, length=2)
    axes.set_xlabel(in_font(across.label))
    axes.set_title(across.title, fontsize=9.5, pad=5)
    ticks = [tick for tick in axes.get_xticks() if ends[0] <= tick <= ends[1]]
    for y, row in enumerate(rows):
        if row.head:
            continue
        span = (y - 0.5, y + 0.5)
        axes.vlines(ticks, *span, color=light("line"), linewidth=0.5, zorder=0.5)
        axes.vlines(across.lines, *span, color=light("ink"), linewidth=0.9, zorder=0.6)
        if row.gap:
            top = y + 0.04 if row.panels and row.panels[k] else y - 0.4  # below what there is
            hatch(axes.axhspan, top, y + 0.4, words=row.gap, zorder=1, facecolor=light("ground"))
            how = {
                "transform": axes.get_yaxis_transform(),
                "va": "center_baseline",
                "fontsize": letters - 0.5,
            }
            write_gap(axes, 0.5, (top + y + 0.4) / 2, row.gap, **how)
        for one in row.panels[k] if row.panels else ():
            if isinstance(one, Stretch):
                _draw_bar(axes, y - one.up, one)
            else:
                _draw_mark(axes, y - one.up, one, ends, letters - 0.5)


def _draw_bar(axes: Axes, y: float, one: Stretch) -> None:
    # On the ground's colour, so that the grid does not show through.
    for colour, alpha in ((light("ground"), 1.0), (light("identified"), one.alpha)):
        axes.barh(y, one.high - one.low, one.high_in_row, one.low, color=colour, alpha=alpha, linewidth=0)


def _draw_mark(axes: Axes, y: float, one: Dot, ends: tuple[float, float], letters: float) -> None:
    at, look, gap, words, colour = one.at, one.look.line, 5, one.words, light("ink")
    begin = one.high if one.high is not None else at
    if not ends[0] <= at <= ends[1]:
        begin = at = ends[at > ends[1]]
        look |= {"marker": "<" if at == ends[0] else ">", "markersize": 4.6}
        gap, words, colour = 5 if at == ends[0] else -5, one.beyond, light(one.look.role)
    elif one.low is not None and one.high is not None:
        interval = [max(ends[0], one.low), min(ends[1], one.high)]
        axes.plot(interval, [y, y], "-", linewidth=one.look.width, color=light(one.look.role), zorder=2.3)
    axes.plot([at], [y], zorder=2.4, clip_on=False, **look)
    if words:
        where: Any = {"xytext": (gap, 0), "textcoords": "offset points", "va": "center_baseline"}
        side = "left" if gap > 0 else "right"
        axes.annotate(in_font(words), (begin, y), **where, ha=side, fontsize=letters, color=colour)


@dataclass(frozen=True)
class Curve:
    """Values over a quantity, with the lower and upper ends of a bar at each, or of a `band`. Without `words`
    it is not in the legend; one that is `quiet` is not in the alternative text."""

    xs: Sequence[float]
    ys: Sequence[float]
    words: str = ""
    look: Look = Look()
    low: Sequence[float] | None = None
    high: Sequence[float] | None = None
    band: bool = False
    quiet: bool = False

    def in_words(self, at: Callable[[float], str]) -> str:
        """Its first value and its last, of a few all, each with its place."""
        every = [
            (spread_range(self.low[k], y) if self.band and self.low else numbers.significant(y, 2), at(x))
            for k, (x, y) in enumerate(zip(self.xs, self.ys, strict=True))
            if math.isfinite(y)
        ]
        some = every if len(every) < _FEW else [every[0], every[-1]]
        text = ", ".join(f"{value} at {x}" for value, x in some)
        return f"{self.words} {text}".strip() if some else ""


@dataclass(frozen=True)
class CurvePanel:
    """A panel of curves on the scale `y`: a dashed `limit` or a `line` across it, hatched `gaps` (from, to,
    words); `more` draws what is the figure's own. The alternative text has its `words`, or else its
    `name` and the curves."""

    curves: Sequence[Curve]
    y: Scale
    title: str = ""
    head: str = ""
    across: str = ""
    up: str = ""
    limit: float | None = None
    line: float | None = None
    gaps: Sequence[tuple[float, float, str]] = ()
    more: Callable[[Axes], None] = lambda axes: None
    words: str = ""
    name: str = ""


def curves_picture(
    name: str,
    title: str,
    about: str,
    panels: Sequence[CurvePanel],
    x: Scale,
    *,
    wide: int = 1,
    panel_height: float = 2.0,
    across: str = "",
    up: str = "",
    legend: Entries = (),
    in_words: bool = True,
) -> Picture:
    """Panels of curves, `wide` of them side by side; what `across` and `up` are is said once, and so is each
    curve in the legend, before the other entries. The alternative text says what it is `about`, and each
    panel `in_words`."""
    with style():
        rows = math.ceil(len(panels) / wide)
        named_rows = min(rows, 2 if len(panels) % wide else 1) if x.upright else 0
        names = named_rows * _LETTER_WIDTH * max(map(len, x.names), default=0)
        figure = new_figure(0.9 + panel_height * rows + names)
        every = figure.subplots(rows, wide, squeeze=False)
        for k, axes in enumerate(every.flat):
            if k >= len(panels):
                axes.set_visible(False)
                continue
            _panel_of_curves(axes, panels[k], x)
            below = k + wide >= len(panels) or bool(panels[k].across)
            axes.tick_params(labelsize=8.5, labelbottom=below)
            axes.tick_params(labelleft=k % wide == 0 or panels[k].y != panels[k - k % wide].y)
        for words, say in ((across, figure.supxlabel), (up, figure.supylabel)):
            say(in_font(words), fontsize=9.5, color=light("muted"))
        curves = {one.words: one.look for panel in panels for one in panel.curves if one.words}
        legend_above(figure, [*((look, words) for words, look in curves.items()), *legend], 3)
        svg = to_svg(figure, name)
    texts = "; ".join(filter(None, (_panel_in_words(panel, x) for panel in panels if in_words)))
    return Picture(name, title, f"{about} {texts}." if texts else about, svg)


def _panel_in_words(panel: CurvePanel, x: Scale) -> str:
    if panel.words:
        return panel.words
    name = panel.name or " ".join((panel.title or panel.head or panel.across).split())
    texts = [one.in_words(x.name) for one in panel.curves if not one.quiet]
    for low, high, words in panel.gaps:
        at = ", ".join(x.name(value) for value in panel.curves[0].xs if low <= value <= high)
        texts.append(f"{words} at {at}")
    return " ".join(filter(None, [name, ", ".join(filter(None, texts))]))


def _panel_of_curves(axes: Axes, panel: CurvePanel, x: Scale) -> None:
    left, right = x.put(axes, "x", [value for one in panel.curves for value in one.xs])
    parts = [part for one in panel.curves for part in (one.ys, one.low or (), one.high or ())]
    panel.y.put(axes, "y", [value for part in parts for value in part])
    for one in panel.curves:
        if one.low is not None and one.high is not None:
            ends, colour = (one.xs, one.low, one.high), light(one.look.role)
            if one.band:
                axes.fill_between(*ends, color=colour, alpha=0.22, linewidth=0)
            else:
                axes.vlines(*ends, color=colour, linewidth=1.1, zorder=2.5)
        axes.plot(one.xs, one.ys, zorder=2.6, **one.look.line)
    if panel.limit is not None:
        limit_line(axes.axhline, panel.limit, zorder=1.5)
    if panel.line is not None:
        axes.axhline(panel.line, color=light("muted"), linewidth=0.9, zorder=1.6)
    for low, high, words in panel.gaps:
        hatch(axes.axvspan, low, high, words=words, zorder=1)
        at = math.sqrt(low * high) if x.log else (low + high) / 2
        share = math.log(high / low) / math.log(right / left) if x.log else (high - low) / (right - left)
        points = 72 * share * axes.get_position().width * WIDTH
        how: Any = {"transform": axes.get_xaxis_transform(), "va": "center", "fontsize": 8, "zorder": 3}
        write_gap(axes, at, 0.5, words, rotation=0 if points > 5 * len(words) else 90, **how)
    panel.more(axes)
    if panel.title:
        axes.set_title(_in_lines(panel.title), loc="left", fontsize=9, fontweight="bold", pad=3)
    if panel.head:
        axes.set_title(_in_lines(panel.head), fontsize=8.5, pad=4)
    axes.set_xlabel(in_font(panel.across))
    axes.set_ylabel(_in_lines(panel.up), fontsize=8.5)


def _in_lines(text: str) -> str:
    return "\n".join(map(in_font, text.split("\n")))


def legend_above(figure: Figure, entries: Entries, columns: int) -> None:
    """The legend above a figure, if there is anything in it."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = []
    for one, words in entries:
        if isinstance(one, Look):
            handles.append(Line2D([], [], label=in_font(words), **one.line))
        elif isinstance(one, Stretch):
            shade: Any = {"color": light("identified"), "alpha": one.alpha, "linewidth": 0}
            handles.append(Patch(label=in_font(words), **shade))
        elif one == "limit":
            handles.append(limit_line(Line2D, [], [], label=in_font(words)))
        else:
            look: Any = {"edgecolor": light("muted"), "linewidth": 0.4, "label": words}
            handles.append(hatch(Patch, words=one, **look))
    if handles:
        where: Any = {"loc": "outside upper left", "ncols": columns}
        figure.legend(handles=handles, **where, handlelength=1.6, handletextpad=0.5)


def limit_line(draw: Callable[..., Any], *at: object, **options: object) -> Any:
    """The line of a tolerance, drawn by `axhline`, `vlines` or `Line2D`."""
    return draw(*at, linestyle=(0, (4, 2)), linewidth=1.0, color=light("weak"), **options)


def hatch(draw: Callable[..., Any], *at: object, words: str, **options: object) -> Any:
    """The patch of a gap, drawn by `axhspan` or `Patch`: hatched one way where the data do not determine it,
    the other way for any other reason."""
    lines = "/////" if words.startswith(NOT_DETERMINED) else "\\\\\\"
    look = {"facecolor": "none", "edgecolor": light("line"), "hatch": lines, "linewidth": 0}
    return draw(*at, **(look | options))


def write_gap(axes: Axes, x: float, y: float, words: str, **options: Any) -> None:
    """The words of a gap, on the figure's ground."""
    colour = light("unidentifiable" if " ".join(words.split()) == NOT_DETERMINED else "held")
    ground = {"facecolor": light("ground"), "edgecolor": "none", "pad": 0.7}
    axes.text(x, y, words, ha="center", color=colour, bbox=ground, **options)


def log_ends(values: Iterable[float | None]) -> tuple[float, float]:
    """Ends of a logarithmic scale that has all these values, and ticks."""
    known = [value for value in values if value]
    low, high = (min(known), max(known)) if known else (0.01, 1.0)
    room = max(1.25, math.sqrt(4 * low / high))
    return low / room, high * room
