"""What a file is, by what is in it, and what it holds that an import can choose from."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ....model.errors import BadInput
from ....model.files.reading import decode, read_bytes
from ..bags.opened import is_bag
from ..fanuc import REGISTERS, fanuc_positions, fanuc_registers
from ..joint_states import messages
from ..kuka import AGGREGATE, DATA_LIST, kuka_positions
from ..rapid import DECLARED, rapid_positions, without_text
from ..ros import Topic, topics_of
from ..taught import Point
from ..typed import PROGRAM_LINE
from .columns_found import Column, Layout, columns_of, head_of, layout_of, table_with

Form = Literal[
    "csv", "log ur", "log egm", "ros", "joint states", "rapid", "kuka", "fanuc", "program log", "ours"
]
_OURS = re.compile(r"""^[ \t]*\{?[ \t]*["']?schema["']?\s*:\s*["']?zerobeam/(\w[\w-]*)/""", re.MULTILINE)
_JOINT_STATE = re.compile(r"^(?:name|position)\s*:", re.MULTILINE)
_MOST_SHOWN = 500  # points, messages


@dataclass(frozen=True)
class Contents:
    """`form` is what the file is, and `why` that is seen; `count` has what it holds, in words.

    Of a table: `layout`, `columns`, the `rows` that were looked at and whether they are all (`whole`). Of
    taught points: `points`, each with its name and whether it has joints. Of a bag: `topics`. Of joint states
    in text: `names` of the joints. Of a file of ours: its `kind`.
    """

    form: Form
    why: str
    count: str
    layout: Layout | None = None
    columns: tuple[Column, ...] = ()
    rows: int = 0
    whole: bool = True
    points: tuple[tuple[str, bool], ...] = ()
    topics: tuple[Topic, ...] = ()
    names: tuple[str, ...] = ()
    kind: str = ""


def contents_of(path: Path, layout: Layout | None = None) -> Contents:
    """What is in a file; `layout` is how a table is laid out, if that is stated.

    BadInput for what no importer reads.
    """
    kind = is_bag(path)
    if kind is not None:
        topics = topics_of(path)
        states = [topic for topic in topics if topic.joints]
        said = "; ".join(f"{topic.messages} joint states on {topic.name}" for topic in states)
        return Contents("ros", f"the first bytes of {kind}", said or "no joint states", topics=topics)
    text, whole = head_of(path)
    if layout is None and whole and (found := _program(path, text)) is not None:
        return found
    return _table(path, text, whole, layout)


def _program(path: Path, text: str) -> Contents | None:
    """What other programs wrote, or this one; None of what seems to be a table."""
    if (ours := _OURS.search(text[:4096])) is not None:
        said = f"a file of zerobeam: {ours[1]}"
        return Contents("ours", f"its schema, zerobeam/{ours[1]}", said, kind=ours[1])
    lines = len(PROGRAM_LINE.findall(text))
    if lines:
        return Contents("program log", "lines that a plan's program writes", f"{lines} postures")
    if REGISTERS in text:
        registers = fanuc_registers(text, path, 1, None, True)
        return _points("fanuc", "its position registers ($POSREG)", registers)
    if re.search(r"^/POS\b", text, re.MULTILINE):
        return _points("fanuc", "its line /POS, as of a TP program", fanuc_positions(text, path))
    declared = (match["kind"].lower() for match in DECLARED.finditer(without_text(text)))
    if any(kind in ("jointtarget", "robtarget") for kind in declared):
        return _points("rapid", "its declarations of RAPID targets", rapid_positions(text, path))
    if AGGREGATE.search(text) or DATA_LIST.search(text):
        return _points("kuka", "its positions in KRL", kuka_positions(text, path))
    if len(set(_JOINT_STATE.findall(text))) == 2:
        found = messages(text)
        names = tuple(dict.fromkeys(name for _, message in found for name in message.get("name", ())))
        said = f"{len(found)} messages, each a measurement"
        return Contents("joint states", "its keys, as of JointState messages", said, names=names)
    if "delta_theta" in text and "delta_alpha" in text:
        raise BadInput(
            "this is the factory calibration of a UR arm, not a recording",
            remedy="make a robot file of it: zerobeam import ur-calibration",
            file=path,
        )
    return None


def _points(form: Form, why: str, points: list[Point]) -> Contents:
    taught = sum(point.joints is not None for point in points)
    said = f"{len(points)} points, {taught} with joint values"
    shown = tuple((point.name, point.joints is not None) for point in points[:_MOST_SHOWN])
    return Contents(form, why, said, points=shown)


def _table(path: Path, text: str, whole: bool, stated: Layout | None) -> Contents:
    if not text.strip():
        decode(read_bytes(path), file=path, line=None)  # says that it is empty
        raise BadInput("the file is empty", file=path)
    layout = stated or layout_of(text)
    table = table_with(path, text, layout)
    columns = tuple(columns_of(table))
    if not any(column.lowest is not None for column in columns):
        raise BadInput(
            "the file is no recording that can be imported: it has no column of numbers",
            found=", ".join(column.name for column in columns[:10])[:200],
            allowed="a table of joint positions, a log, a ROS bag, a program or points of a controller",
            file=path,
        )
    names = set(table.names or ())
    form: Form = "csv"
    why = "its rows with equally many columns"
    if "actual_q_0" in names and "timestamp" in names:
        form, why = "log ur", "its columns timestamp and actual_q_0, as of an RTDE recording"
    elif {"R_FB_POS_RJ1", "TIMESTAMP"} <= names:
        form, why = "log egm", "its columns TIMESTAMP and R_FB_POS_RJ1, as of abb_libegm"
    said = f"{len(table.rows)} rows of {table.width} columns"
    if not whole:
        said += " in its first part; the rest is checked at the import"
    return Contents(form, why, said, layout=layout, columns=columns, rows=len(table.rows), whole=whole)
