"""The page of a conversion: what to do first, positions, lines to look at, why nothing is
written; and its folder, with the audit that puts the old files back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..experiments.positions.conversion import POSITIONS_SCHEMA, Conversion, ListedLine, PositionRow
from ..experiments.positions.program_backup import AUDIT
from ..model.errors import BadInput
from ..words import numbers
from ..words.sentences import to_json
from ..words.wording import clipped, counted, path_argument, shown
from .output.whole_folder import FolderContents, Kind, Written, names_in, write_answer
from .style.blocks import (
    Block,
    Commands,
    Page,
    Paragraph,
    Row,
    Section,
    Table,
    Verdict,
    row_of,
    section_of,
    table_of,
)

_MOST_ACCEPTED = 12  # names of lines in one command


def positions_page(answer: Conversion) -> Page:
    """All that is said of a conversion."""
    return Page(
        "My programs",
        f"{shown(answer.backup)}, {answer.language}",
        _verdict(answer),
        [],
        list(_sections(answer)),
    )


def _verdict(answer: Conversion) -> Verdict:
    count = counted(len(answer.positions), "position")
    if answer.command == "show":
        return Verdict("held", "Found", f"{count}; nothing is converted.")
    if answer.converted:
        moved = max(row.moved_mm or 0.0 for row in answer.positions)
        if answer.command == "reach":
            return Verdict(
                "pass",
                "Converted",
                f"Approach {shown(answer.approach or '')} slowly first: it goes"
                f" {numbers.significant(moved, 2, 'mm')} elsewhere than before. With the wrong sign it"
                " would be off by twice that.",
            )
        return Verdict(
            "pass",
            "Converted",
            f"Approach {shown(answer.approach or '')} slowly first: it must be where it was. Unconverted it"
            f" would be off by {numbers.significant(moved, 2, 'mm')}, with the wrong sign by twice that.",
        )
    if answer.refused:
        return Verdict("misfit", "Refused", f"{counted(len(answer.refused), 'line')}: nothing is written.")
    if answer.to_state:
        return Verdict("weak", "To be stated", f"{'; '.join(answer.to_state)}: nothing is written.")
    if answer.open_lines:
        return Verdict(
            "weak", "To be looked at", f"{counted(len(answer.open_lines), 'line')}: nothing is written."
        )
    return Verdict("weak", "Nothing to convert", "There is no position in it that would be.")


def _sections(answer: Conversion) -> Iterator[Section]:
    yield section_of("What to do", *_first(answer), brief=True)
    if answer.refused:
        rows = [row_of(f"{shown(one.file)}:{one.line}", shown(one.sentence)) for one in answer.refused]
        yield section_of("Refused", table_of("", ["line", "why"], rows, "ll"), brief=True)
    if answer.listed:
        yield section_of("To look at", _listed(answer.listed), *_accepting(answer), brief=True)
    if answer.frames:
        yield section_of("Tools and frames", _frames(answer), brief=True)
    if answer.positions:
        yield section_of("Files", _files(answer), brief=True)
        yield section_of("Positions", _positions(answer))


def _first(answer: Conversion) -> Iterator[Block]:
    if answer.command == "show":
        yield Paragraph("Zeros were entered at the controller: state them, and write converted files.")
        yield Commands(
            [f"zerobeam positions keep {path_argument(answer.backup)} --robot ARM --entered J2=… -o FOLDER"]
        )
    moved = [row.moved_mm for row in answer.positions if row.moved_mm is not None]
    if moved and answer.command == "reach":
        joints = sum(row.kind == "joints" for row in answer.positions)
        yield Paragraph(
            "For calculated poses alone, and for this arm alone: poses that were taught on it hold its errors"
            " already, and would be off by as much. Leave their files out."
            + (f" {counted(joints, 'position')} in joints: taught, they stay." if joints else "")
        )
        corrected = [row for row in answer.positions if row.moved_mm is not None]
        if any(row.uncertainty_mm is None for row in corrected):
            yield Paragraph(
                "U is not known where an offset that moves the place is not determined by the data, is only"
                " as good as what is assumed, or is excluded."
            )
    elif moved:
        first = "Convert the whole backup, not one file" if answer.single else "Load all files of it"
        apart = numbers.significant(max(moved), 2, "mm")
        by = f"{apart} or more" if answer.to_state else f"up to {apart}"  # some could not be computed
        yield Paragraph(f"{first}, or parts will disagree by {by}.")
    if answer.entered:
        zeros = ", ".join(f"{one.joint} {one.value:+.4f}" for one in answer.entered)
        yield Paragraph(
            f"Entered ({answer.source}), deg (mm): {zeros}. At the same place each joint reads so much more,"
            " less where it is negative."
        )
    elif answer.source:
        yield Paragraph(f"By {answer.source}: nothing is entered at the controller.")
    for option in answer.to_state:
        yield Paragraph(f"State {option}.")
    for note in answer.notes:
        yield Paragraph(note)


def _listed(lines: Sequence[ListedLine]) -> Table:
    rows = [
        row_of(
            f"{shown(one.file)}:{one.line}",
            one.kind,
            shown(one.sentence),
            "-" if one.shift_mm is None else f"{one.shift_mm:.2f}{' per 100' if one.per_100_mm else ''}",
            "yes" if one.accepted else "no",
        )
        for one in lines
    ]
    return table_of("", ["line", "kind", "what is there", "shift, mm", "accepted"], rows, "lllrl")


def _accepting(answer: Conversion) -> Iterator[Block]:
    names = list(dict.fromkeys(f"{one.file}:{one.line}" for one in answer.open_lines))
    if names and answer.command != "show":
        yield Paragraph("These lines stay as they are. Look at each; then accept them by name:")
        yield Commands(
            [
                f"--accept {','.join(names[i : i + _MOST_ACCEPTED])}"
                for i in range(0, len(names), _MOST_ACCEPTED)
            ]
        )


def _frames(answer: Conversion) -> Table:
    rows = [
        row_of(
            f"{one.what} {shown(one.name) or '(left open)'}",
            _numbers(one.numbers),
            "as before" if one.new_numbers is None else _numbers(one.new_numbers),
            shown(one.place),
        )
        for one in answer.frames
    ]
    return table_of("", ["what", "pose", "afterwards", "from"], rows, "llll")


_U = "U with it (k = 2), mm"


def _files(answer: Conversion) -> Table:
    rows = []
    for file in dict.fromkeys(row.file for row in answer.positions):
        of_file = [row for row in answer.positions if row.file == file]
        moved = [row for row in of_file if row.moved_mm is not None]
        off = f"{max(row.moved_mm or 0.0 for row in moved):.2f}" if moved else "-"
        worst = max(
            moved, key=lambda row: np.inf if row.uncertainty_mm is None else row.uncertainty_mm, default=None
        )
        rows.append(_row(answer, [shown(file), str(len(of_file)), off, _u(worst)]))
    if answer.command == "show":
        return table_of("", ["file", "positions"], [Row(row.cells[:2]) for row in rows], "lr")
    return _table(answer, ["file", "positions", "off without it by up to, mm", _U], rows, "lrrr")


def _positions(answer: Conversion) -> Table:
    rows = [
        _row(
            answer,
            [
                f"{clipped(row.name)} ({shown(row.file)}:{row.line})",
                _numbers(row.before),
                _numbers(row.after),
                "-" if row.moved_mm is None else f"{row.moved_mm:.2f}",
                shown(row.configuration or "-"),
                f"{shown(row.tool or '-')}, {shown(row.frame or '-')}",
                _u(row),
            ],
        )
        for row in answer.positions
    ]
    heads = ["position", "before", "after", "off by, mm", "configuration", "tool, frame", _U]
    return _table(answer, heads, rows, "lllrllr")


def _u(row: PositionRow | None) -> str:
    if row is None or row.moved_mm is None:
        return "-"
    return "not known" if row.uncertainty_mm is None else f"{row.uncertainty_mm:.2f}"


def _row(answer: Conversion, cells: list[str]) -> Row:
    """The last cell is U, which is at stake for the estimated arm alone: `keep` keeps places as they are."""
    return row_of(*cells if answer.command == "reach" else cells[:-1])


def _table(answer: Conversion, heads: list[str], rows: Sequence[Row], aligned: str) -> Table:
    return table_of("", heads if answer.command == "reach" else heads[:-1], rows, aligned)


def _numbers(values: Sequence[float] | None) -> str:
    return (
        "-"
        if values is None
        else ", ".join(f"{value + 0.0:.10g}" if abs(value) < 1 else f"{value:.3f}" for value in values)
    )


def write_conversion(folder: Path, answer: Conversion) -> Written:
    """Write a conversion to a folder that is empty or does not exist: whole, or not at all."""
    if folder.is_dir() and names_in(folder):
        raise BadInput(
            "the folder is not empty", file=folder, remedy="name another one: no conversion is overwritten"
        )
    tops = {name.partition("/")[0] for name in answer.content}
    kind = Kind.of_answer("conversion", AUDIT, POSITIONS_SCHEMA, *tops, pages="positions")

    def files(new: Path) -> None:
        for name, content in answer.content.items():
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).write_bytes(content)

    return write_answer(folder, kind, FolderContents(to_json(answer), positions_page(answer), others=files))
