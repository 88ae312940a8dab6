"""A made-up kind of answer, by the steps of CONTRIBUTING: how level the base of an arm stands."""

from pathlib import Path
from typing import Annotated, Literal

from zerobeam.analysis.row import ParameterRow
from zerobeam.model.records import it, key, record
from zerobeam.reports.output.whole_folder import FolderContents, Kind, Written, write_answer
from zerobeam.reports.style.blocks import Cell, Page, Verdict, row_of, section_of, table_of
from zerobeam.words import numbers
from zerobeam.words.entries import FindingEntry, message_by
from zerobeam.words.sentences import to_json
from zerobeam.words.wording import NOT_DETERMINED

SCHEMA: Literal["made-up/level/1"] = "made-up/level/1"


# 1. The record.
@record(kw_only=True)
class Level:
    """How level a base stands: rotations about x and y, each a row with its status."""

    schema: Annotated[Literal["made-up/level/1"], it("kind and version of the document")] = SCHEMA
    robot: Annotated[str, it("the arm")]
    limit: Annotated[float, it("that a rotation may have", unit="deg")]
    rotations: Annotated[tuple[ParameterRow, ...], it("of the base against the horizontal")]

    @property
    @key("whether every rotation is determined")
    def verdict(self) -> Literal["pass", "degenerate"]:
        lost = any(row.status == "unidentifiable" for row in self.rotations)
        return "degenerate" if lost else "pass"

    def tilted(self) -> list[ParameterRow]:
        return [row for row in self.rotations if row.estimate is not None and abs(row.estimate) > self.limit]


# 2. Its entries in the catalogue.
LEVEL = (
    FindingEntry(
        "tilted",
        "doubt",
        lambda row, level: f"The rotation {row.name} is {numbers.exact(row.estimate, row.unit)}",
        lambda row, level: f"Shim the base for the rotation {row.name}, and measure again.",
        found=Level.tilted,
        colour="weak",
    ),
    FindingEntry("level", "note", remedy=lambda _, level: "Bolt it down.", found=lambda level: [None]),
)


# 3. The page.
def level_page(level: Level) -> Page:
    said = message_by(level, LEVEL, f"The base of {level.robot}: {level.verdict}.", None)
    rows = [
        row_of(row.name, _rotation(row), Cell(row.status, mark=row.status), tone=row.status)
        for row in level.rotations
    ]
    table = table_of("Rotations of the base", ["rotation", "estimate", "status"], rows, "lrl")
    verdict = Verdict(said.grade or "held", "", "")
    return Page(f"Base of {level.robot}", "", verdict, [], [section_of("Rotations", table)], message=said)


def _rotation(row: ParameterRow) -> str:
    if row.estimate is None or row.std is None:
        return NOT_DETERMINED
    return numbers.estimate(row.estimate, row.std, row.unit)


# 4. What is in its folder.
FOLDER = Kind.of_answer("level", "level.json", SCHEMA)


def write_level(folder: Path, level: Level) -> Written:
    return write_answer(folder, FOLDER, FolderContents(to_json(level), level_page(level)))
