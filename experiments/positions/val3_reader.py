"""Positions of VAL3 applications (Staubli), s6 and s7: their data, and what programs (.pgx) do with it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np

from ...model.arrays import Matrix
from ...model.kinematics.orientation import from_xyz
from .position import NUMBER, BackupReading, FileReading, Lines, SourceFile, Span, What, arguments_of, pose_of
from .script import PositionNames, Script, stem_of

_ROOTS = ("world[0]", "flange[0]")
_TAG = re.compile(r"<(?P<tag>[\w:.-]+)(?P<rest>(?:\s+[\w:.-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*/?>")
_ATTRIBUTE = re.compile(r"([\w:.-]+)\s*=\s*([\"'])(.*?)\2", re.DOTALL)
_REMARK = re.compile(r"<!--.*?-->", re.DOTALL)
_PLAIN = ("joint", "point", "tool", "frame")
_KINDS = {"jointrx": "joint", "pointrx": "point", **dict(zip(_PLAIN, _PLAIN, strict=True))}
_POSE, _WORDS = ("x", "y", "z", "rx", "ry", "rz"), ("shoulder", "elbow", "wrist")


@dataclass
class _Datum:
    """An element of an array of data; `fields` are the places of what it says."""

    kind: str
    name: str
    pos: int
    father: str = ""
    fields: dict[str, Span] = field(default_factory=dict)


@dataclass
class Val3Names(PositionNames):
    """NAME is NAME[0]; `kinds` are those of the data of an application, whose folder is the scope."""

    kinds: dict[str, str] = field(default_factory=dict)

    def plain(self, name: str) -> str:
        word, _, index = re.sub(r"\s", "", name).lower().partition("[")
        return f"{word}[{index.removesuffix(']').lstrip('0') or '0'}]"

    def scoped(self, plain: str) -> str:
        """The name of a tool or frame in the backup: with its folder, where there are several."""
        return plain if plain in _ROOTS or not self.scope else f"{self.scope}:{plain}"


def read_data(here: FileReading, names: Val3Names) -> None:
    """Positions, tools and frames, and the kinds of all data."""
    file, data = here.file, list[_Datum]()
    kind = name = father = ""
    text = _REMARK.sub(lambda remark: re.sub(r"[^\n]", " ", remark[0]), file.text)
    for tag in _TAG.finditer(text):
        attributes = list(_ATTRIBUTE.finditer(text, *tag.span("rest")))
        words = {each[1]: each[3] for each in attributes}
        spans = {each[1]: each.span(3) for each in attributes}
        if tag["tag"] == "Data" or (tag["tag"] in _KINDS and "name" in words):
            kind = _KINDS.get(words.get("type", tag["tag"]).lower(), "")
            name, father = words.get("name", ""), ""
        elif tag["tag"].endswith("Father"):
            library = f"{words['alias']}:" if words.get("alias") else ""
            father = f"{library}{words.get('name', '')}[{words.get('fatherIndex', '0')}]"
        elif tag["tag"] == "Value" or re.fullmatch(r"value[A-Z]\w*", tag["tag"]):
            index = words.get("key", words.get("index", "0"))
            data.append(_Datum(kind, f"{name}[{index}]", tag.start(), words.get("fatherId", father), spans))
        elif re.fullmatch(r"(?:joint|t[pft]|cp)Value", tag["tag"]) and data:
            data[-1].fields.update(spans)
    poses = {names.plain(one.name): one for one in data if one.kind in ("tool", "frame")}
    for one in data:
        _datum(here, one, poses, names)
    names.kinds |= {stem_of(names.plain(one.name)): one.kind for one in data if one.kind}


def _datum(here: FileReading, one: _Datum, poses: dict[str, _Datum], names: Val3Names) -> None:
    file = here.file
    plain, keys = names.plain(one.name), [f"j{i}" for i in range(1, 7)] if one.kind == "joint" else _POSE
    spans = [one.fields[key] for key in keys if key in one.fields]
    if one.kind in ("tool", "frame"):
        pose = _pose(file, plain, poses, names) if plain not in _ROOTS else None
        if pose is not None or (spans and plain not in _ROOTS):
            what: What = "tool" if one.kind == "tool" else "frame"
            here.frame(one.pos, what, names.scoped(plain), pose, "it is not in six numbers")
    elif one.kind and spans:
        numeric = all(re.fullmatch(NUMBER, file.text[slice(*span)]) for span in spans)
        seven = any(re.fullmatch(r"j[7-9]", key) for key in one.fields)
        if len(spans) < 6 or not numeric or plain in names.keys or seven:
            sentence = f"{one.name} states {len(spans)} numbers, or is there twice: write out six of it"
            return here.unread(one.pos, sentence, one.name)
        key, words = f"{names.scope}:{plain}", [one.fields[word] for word in _WORDS if word in one.fields]
        names.store(plain, key)
        free = any(re.fullmatch(r"[sew](?:same|free)|", file.text[slice(*word)]) for word in words)
        words = [] if free or len(words) < 3 else words
        frame = None if one.kind == "joint" else names.scoped(names.plain(one.father))
        here.six(one.pos, key, one.name, spans, words, joints=one.kind == "joint", frame=frame)


def _pose(
    file: SourceFile, name: str, poses: dict[str, _Datum], names: Val3Names, depth: int = 0
) -> Matrix | None:
    """(4, 4) of a tool in the flange, or of a frame in the world; None where it is not in numbers."""
    if name in _ROOTS:
        return np.eye(4)
    fields = poses[name].fields if name in poses else {}
    texts = [file.text[slice(*fields[key])] for key in _POSE if key in fields]
    if len(texts) < 6 or depth > 20 or not all(re.fullmatch(NUMBER, text) for text in texts):
        return None
    father = _pose(file, names.plain(poses[name].father), poses, names, depth + 1)
    pose = pose_of(from_xyz, [float(text) for text in texts])
    return None if father is None or pose is None else np.asarray(father @ pose)


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
