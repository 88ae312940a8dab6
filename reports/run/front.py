"""Page one of a run's answer between what to do and what it rests on: the one table, the error of the TCP
before and after, what would make it better (a remedy a row). HTML, PDF, terminal, notebook
and app have the same blocks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from ...analysis.answer.answer_message import Message
from ...analysis.answer.result import Result
from ...analysis.diagnostics.values_to_enter import Entered, TcpError
from ...analysis.observability.geometry_result import GeometryResult
from ...analysis.observability.outlook import Outlook
from ...analysis.solution import ParameterResult
from ...words import numbers
from ...words.case import RunCase
from ...words.catalogue import nominal_arm
from ...words.controllers import TCP_OF_NOMINAL_ARM, taken_by
from ...words.enter import ALL_OR_NONE, TCP_NOT_CLAIMED, TCP_OF_A_MISFIT, U_OF_VALUES
from ...words.geometry_words import OffsetRow
from ...words.message import offered, quantity_of_u, values_shown
from ...words.numbers import unit_of
from ...words.outlook_words import (
    HEADS,
    TITLE,
    best_remedies,
    outlook_notes,
    plan_command,
    region_short,
    region_words,
    remedy_words,
)
from ...words.trust import above, tolerances_of, trusted, without_estimate
from ...words.wording import WEAK, joints
from ..style.blocks import (
    Bar,
    Bars,
    Block,
    Cell,
    Commands,
    FigureBlock,
    Paragraph,
    Row,
    SceneBlock,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from .parameter_section import worth_column
from .unobservable import NAME
from .workspace import NAME as MAP


def outlook_blocks(
    outlook: Outlook | None, rows: Iterable[OffsetRow], planned: str | None, *, brief: bool, of: str = "U"
) -> list[Block]:
    """At most three remedies if `brief`, else all beside the answer as it is, with the commands; `rows` are
    those of the offsets, `planned` as of `plan_command`, `of` as of `quantity_of_u`. Nothing where none gains
    anything."""
    if outlook is None or not outlook.worth:
        return []
    shown = (
        best_remedies(outlook)
        if brief
        else [outlook.now, *(row for row in outlook.remedies if row.gain >= 0)]
    )
    units = {row.name: row.unit for row in rows if any(row.name in one.U for one in shown)}
    words = [remedy_words(one, outlook.now, units) for one in shown]
    if brief:
        head = f"{TITLE} (TCP: {region_short(outlook.region)})"
        cells = [row_of(one.remedy, one.largest, one.tcp_median, one.minutes) for one in words]
        return [table_of("", [head, f"largest {of}", "TCP", "time"], cells, "lr")]
    cells = [row_of(one.remedy, *one.U, one.tcp_median, one.tcp_95, one.minutes) for one in words]
    heads = ["", *(joints([name])[0] for name in units), *HEADS]
    table = table_of(f"{TITLE}: predicted U (k = 2) of each offset, and error of the TCP", heads, cells, "lr")
    commands = [command for row in shown if (command := plan_command(planned, row)) is not None]
    return [table, *map(Paragraph, outlook_notes(outlook)), *([Commands(commands)] if commands else [])]


def outlook_section(result: Result) -> Section | None:
    """Of a run; None where nothing gains anything, or by a model that does not describe it."""
    planned = RunCase.of_result(result).planned
    blocks = outlook_blocks(result.outlook, result.offsets, planned, brief=False)
    return section_of(TITLE, *blocks) if blocks else None


def front(result: Result, content: Message, *, remedies: bool = True) -> list[Block]:
    """The blocks under the message `content`; of a wrong model there is none that could be taken for an
    answer. Without `remedies` where all of them are said below."""
    return list(_blocks(result, content, remedies))


def _blocks(result: Result, content: Message, remedies: bool) -> Iterator[Block]:
    if result.misfit is not None:
        yield Paragraph(TCP_OF_A_MISFIT)
        return
    entered, may = offered(result, content), content.may
    offsets = [row for row in result.parameters if row.group == "offset"]
    head = "offset"
    if (values := values_shown(result, content)) is not None:
        head = "enter" if may.enter else "would enter"
    yield offsets_front(
        offsets,
        result.coverage_factor,
        tolerances_of(result.inputs.header),
        head,
        values,
        doubted=not may.export,
        geometry=result.geometry,
    )
    if result.null_motion is not None:
        yield FigureBlock(NAME)
    yield from _tcp(result, entered)
    planned = RunCase.of_result(result).planned
    if remedies:
        of = quantity_of_u(values)
        yield from outlook_blocks(result.outlook, result.offsets, planned, brief=True, of=of)
    if entered is not None:
        yield FigureBlock(MAP)
    elif shows_scene(result, entered):
        yield SceneBlock()


def shows_scene(result: Result, entered: Entered | None) -> bool:
    """Whether its picture is the scene: nothing is `entered`, and no motion shows why."""
    return (
        entered is None and result.misfit is None and result.null_motion is None and result.scene is not None
    )


def offsets_front(
    offsets: Sequence[ParameterResult],
    k: float,
    tolerances: Mapping[str, float],
    head: str = "offset",
    entered: Entered | None = None,
    *,
    doubted: bool = False,
    geometry: GeometryResult | None = None,
) -> Table:
    """The one table: joint, value, its U, and why it can be trusted or not; none is where something speaks
    against the values (`doubted`). `tolerances` are those of `trusted`. Beside the U of
    values for an arm that is taken as exact is that for a typical arm, by the `geometry`."""
    columns = ["joint", head, f"± U ({numbers.coverage(k)})", "trusted"]
    caption = ""
    if entered is not None and not entered.as_offsets:
        caption = ALL_OR_NONE if head == "enter" else U_OF_VALUES
    rows = [_row(row, k, tolerances, entered, doubted=doubted) for row in offsets]
    if entered is not None and geometry is not None and geometry.tolerance is None:
        _, worth = worth_column(geometry, k)
        columns.insert(3, "typical arm")
        beside = [worth(row) if row.std is not None and row.status != "assumed" else "" for row in offsets]
        rows = [
            Row((*row.cells[:-1], Cell(u), row.cells[-1]), row.tone)
            for row, u in zip(rows, beside, strict=True)
        ]
        return table_of(caption, columns, rows, "lrrrl")
    return table_of(caption, columns, rows, "lrrl")


def _row(
    row: ParameterResult,
    k: float,
    tolerances: Mapping[str, float],
    entered: Entered | None,
    *,
    doubted: bool,
) -> Row:
    """One joint. What is not determined, what is only assumed, and of values to enter what is not entered,
    has no number."""
    (name,), why = joints([row.name]), Cell(row.trusted or trusted(row, k, tolerances), mark=row.status)
    tone = row.status
    if row.held or row.status == "assumed":
        return row_of(name, "", "", why, tone=tone)
    if row.estimate is None or row.std is None:
        return row_of(name, Cell(without_estimate(row), span=2), why, tone=tone)
    unit = unit_of(row.unit)
    if entered is not None and row.name not in entered.values:
        return row_of(name, "", "", why, tone=tone)
    value, u = (
        (row.estimate, k * row.std)
        if entered is None
        else (entered.values[row.name], k * entered.u[row.name])
    )
    if entered is not None and row.status == "identified" and entered.status.get(row.name) == "weak":
        limit = tolerances.get(row.unit)
        value_is = WEAK if limit is None else above(limit, k, row.unit)
        why = Cell(f"only with the others: {value_is}", mark="weak")
    if doubted and row.status == "identified":
        why = Cell("no: see what is to be done", mark="weak")
    return row_of(name, numbers.estimate(value, u, unit), numbers.spread(u, unit), why, tone=tone)


def _tcp(result: Result, offered: Entered | None) -> Iterator[Block]:
    """The error of the TCP as it is, and with the values that are offered, or with the corrected model, which
    has the links too. A file has it of what is offered alone. Of a controller that computes with another arm
    there is none."""
    if nominal_arm(RunCase.of_result(result)):
        yield Paragraph(TCP_OF_NOMINAL_ARM)
        return
    entered, after = offered or result.entered, "entered"
    if taken_by(result.inputs.vendor) != "offsets":
        entered, after = result.entered_geometry or entered, "corrected"
    if entered is None or entered.tcp_before is None or entered.tcp_after is None:
        if result.next_steps is None or result.accuracy.workspace is None:
            yield Paragraph(TCP_NOT_CLAIMED)
        return
    of = "median (95 % stay below)"
    bars = [_bar("now", entered.tcp_before, "held"), Bar(after, 0.0, "not claimed", "held")]
    if offered is not None:
        bars[1] = _bar(after, entered.tcp_after, "identified")
    else:  # the arm is not known well enough: where its median may be
        of, before = "median of this arm (95 %)", entered.tcp_before
        low, high = (numbers.significant(each, 2, "mm") for each in before.median_band_mm)
        bars[0] = Bar("now", before.median_mm, f"{low} to {high}", "held")
    exact = ", links taken as exact" if result.geometry.tolerance is None else ""
    yield Bars(f"TCP error, {of}, {region_words(result.region)}{exact}", bars)


def _bar(name: str, error: TcpError, tone: str) -> Bar:
    median, most = (numbers.significant(each, 2, "mm") for each in (error.median_mm, error.p95_mm))
    return Bar(name, error.median_mm, f"{median} ({most})", tone)
