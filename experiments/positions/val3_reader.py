"""Positions of VAL3 applications (Staubli), s6 and s7: their data, and what programs (.pgx) do with it."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from .position import BackupReading, FileReading, What
from .position_names import stem_of
from .script import Script
from .statement_text import NUMBER, Lines, arguments_of
from .val3_data import Val3Names, read_data

_CODE = re.compile(r"<(Code|code)\b[^>]*>(?:\s*<!\[CDATA\[)?(.*?)(?:\]\]>\s*)?</\1>", re.DOTALL)
_LIST = rf"{NUMBER}(?:\s*,\s*{NUMBER})*"


def read_val3(reading: BackupReading) -> None:
    """Each folder is an application."""
    scopes: dict[str, Val3Names] = {}
    for file in reading.files:
        folder, here = file.name.rpartition("/")[0], FileReading(file, reading)
        names = scopes.setdefault(folder, Val3Names(Val3Program.word, scope=folder))
        try:
            ElementTree.fromstring(file.text.encode("ascii", "replace"))
        except (ElementTree.ParseError, LookupError) as error:  # the encoding that it states
            here.unread(0, f"this is no whole file of an application: {error}")
        if file.suffix == ".dtx":
            read_data(here, names)
        elif file.suffix == ".pjx" and (unit := re.search(r"millimeterUnit=[\"']false", file.text)):
            here.refuse(unit.start(), "lengths are inches, and millimetres alone are read")
    for file in reading.files:
        if file.suffix != ".pgx":
            continue
        names = scopes[file.name.rpartition("/")[0]]
        for code in _CODE.finditer(file.text):
            program = Val3Program(file, reading, names)
            program.scan(*code.span(2))
            program.run()
        for local in re.finditer(r"<(?:Local|Parameter|local|param)\b[^>]*?\bname=[\"'](\w+)", file.text):
            if local[1].lower() in names.kinds:
                sentence = f"{local[1]} hides the data of this name"
                FileReading(file, reading).refuse(local.start(), sentence)


class Val3Program(Script):
    """A program of an application."""

    names: Val3Names

    literal = re.compile(rf"\{{\s*(?P<numbers>{_LIST})\s*\}}")
    assign = re.compile(
        r"(?P<name>[A-Za-z_]\w*(?:\s*\[[^\]]*\])?)(?P<index>(?:\.\w+)*)\s*=(?!=)\s*(?P<value>.*)", re.DOTALL
    )
    move = re.compile(r"\bmove(?P<kind>jc|j|l|c)\s*\(")
    jump = re.compile(r"(?:if|else\w*|for|while|do|until|switch|case)\b", re.IGNORECASE)
    refused = re.compile(r"\b(?:setFrame|link|alter|setLatch)\s*\(")
    word = re.compile(r"(?<![\w.\"'$:])[A-Za-z_]\w*(?:\s*\[[^\]]*\])?(?!\w)")

    def assigned(self, pos: int, assign: re.Match[str]) -> None:
        """Data have their values before; what a program assigns overwrites them."""

    def statement(self, pos: int, text: str) -> None:
        assign = self.assign.fullmatch(text)
        if assign is not None and self.names.kinds.get(stem_of(self.names.plain(assign["name"]))) in (
            "tool",
            "frame",
        ):
            return self.refuse(pos, f"{assign['name']} is set when the program runs")
        if assign is not None and self.names.plain(assign["name"]) in self.names.keys:
            return self.names.changed(self, pos, assign["name"])
        return super().statement(pos, text)

    def motion(self, pos: int, move: re.Match[str], arguments: Lines) -> None:
        names = [name for at, text in self.goals_of(move, arguments) for name in self.goal(at, text)]
        tools = [self.names.plain(text) for _, text in arguments[-2:-1]]
        tool = next((each for each in tools if re.fullmatch(r"[\w:]+\[\d+\]", each)), "?")
        self.moves(pos, names, self.names.scoped(tool) if tool != "?" else tool)

    def goal(self, pos: int, text: str) -> list[str]:
        if (call := re.match(r"(appro|compose)\s*\(", text)) is None:
            return super().goal(pos, text)
        parts = [(pos + at, part) for at, part in arguments_of(text, call.end())]
        names = self.goal(*parts[0])
        fathers = {one.frame for one in self.reading.positions if one.name in names}
        same = len(parts) == 3 and {self.names.scoped(self.names.plain(parts[1][1]))} == fathers
        axes: What | None = "tool" if call[1] == "appro" else "frame" if same else None
        self.step(pos, text, parts[-1][1], names, axes)
        return names
