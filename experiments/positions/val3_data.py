"""Data files of VAL3 applications (.dtx), s6 and s7: points, joints, tools and frames."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from ...model.arrays import Matrix
from ...model.kinematics.orientation import from_xyz
from .position import FileReading, SourceFile, What, pose_of
from .position_names import PositionNames, stem_of
from .statement_text import NUMBER, Span

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
