"""Positions of URScript (Universal Robots): p[…], [.…] and the joints that are nearest to a pose."""

from __future__ import annotations

import re
from dataclasses import replace

from ...model.kinematics.orientation import from_rotation_vector
from .position import BackupReading, pose_of
from .script import Script
from .statement_text import NUMBER, arguments_of, values_in

_LIST = rf"{NUMBER}(?:\s*,\s*{NUMBER})*"
_TCP = re.compile(r"\bset_tcp\s*\(")
_CALL = re.compile(r"(get_inverse_kin|pose_trans|pose_add)\s*\(")
_HERE = re.compile(r"get_(?:forward_kin|(?:actual|target)_tcp_pose)\s*\(\s*\)")
_MM = 1000.0


def read_urscript(reading: BackupReading) -> None:
    """Each script has variables of its own."""
    for file in reading.files:
        program = UrProgram(file, reading)
        program.whole(r"^[ \t]*(?:def|sec|thread|if|while)\b[^\n]*:", r"(?<![\w.])end(?!\w)")
        program.scan()
        program.run()
    stored = {one.name for one in reading.positions if one.kind == "joints"}
    for number, one in enumerate(reading.positions):
        beside = re.sub(r"_p$", "_q", one.name)  # Waypoint_1_q of Waypoint_1_p
        if one.kind == "cartesian" and one.near is None and beside in stored:
            reading.positions[number] = replace(one, near=beside)


class UrProgram(Script):
    """A script."""

    literal = re.compile(rf"(?P<kind>p\s*)?\[\s*(?P<numbers>{_LIST})\s*\]")
    begin = re.compile(r"p\s*\[")
    assign = re.compile(
        r"(?:(?:global|local)\s+)?(?P<name>[A-Za-z_]\w*)(?P<index>(?:\s*\[[^\]]*\])*)\s*=(?!=)\s*(?P<value>.*)",
        re.DOTALL,
    )
    move = re.compile(r"\b(?P<kind>move[jlpc]|servo[jc])\s*\(")
    jump = re.compile(r"(?:def|if|elif|else|while|for|thread|sec)\b")
    refused = re.compile(
        r"\b(?:(?:track_conveyor|path_offset|frame_tracking|set_conveyor|encoder_enable)\w*|move_frame\w*)\b"
    )

    def is_joints(self, literal: re.Match[str]) -> bool | None:
        return None if literal["kind"] is None else False

    def setting(self, pos: int, text: str) -> None:
        assign = self.assign.fullmatch(text)
        if assign is not None and assign["name"].endswith("_q"):
            self.kinds.setdefault(self.names.plain(assign["name"]), set()).add(True)
        if (put := _TCP.search(text)) is not None:
            self.active.set("tool", pos, self.tool(pos, arguments_of(text, put.end())[0][1]))

    def tool(self, pos: int, text: str) -> str | None:
        """The name of a tool that is set, which is its text; None where that is computed."""
        numbers, literal = self.added(text), self.literal.fullmatch(text)
        if literal is not None and literal["kind"]:
            numbers = values_in(literal["numbers"])
        if len(numbers) != 6:
            return None
        name = f"p{numbers}"
        if ("tool", name) not in self.reading.frames:
            self.frame(pos, "tool", name, pose_of(from_rotation_vector, numbers))
        return name

    def add_literal(
        self, pos: int, literal: re.Match[str], key: str, label: str, *, joints: bool, register: bool = False
    ) -> None:
        super().add_literal(pos, literal, key, label, joints=joints, register=register and not joints)

    def other(self, pos: int, text: str) -> None:
        if (speed := re.search(r"\b(?:speed[jl]|force_mode)\s*\(", text)) is not None:
            self.doubt(pos, "computed", f"{speed[0]}: where it ends is not known before")
        elif not _TCP.search(text):
            super().other(pos, text)

    def goal(self, pos: int, text: str) -> list[str]:
        if (call := _CALL.match(text)) is None:
            return super().goal(pos, re.sub(r"^pose\s*=\s*|^q\s*=\s*", "", text))
        parts = [(pos + at, part) for at, part in arguments_of(text, call.end())]
        if call[1] == "get_inverse_kin":
            return self.inverse(*parts)
        if len(parts) != 2 or self.literal.fullmatch(parts[1][1]) is None:
            self.computed(pos, text)
            return []
        names = [] if _HERE.fullmatch(parts[0][1]) else self.goal(*parts[0])
        self.step(pos, text, parts[1][1], names, "tool" if call[1] == "pose_trans" else "frame", _MM)
        return names

    def inverse(self, pose: tuple[int, str], *others: tuple[int, str]) -> list[str]:
        """A pose and, if stated, the joints that are near it."""
        self.joints = False
        names = self.goal(*pose)
        near: list[str] = []
        for at, text in others[:1]:
            key = re.match(r"qnear\s*=\s*", text)
            skip = key.end() if key else 0
            self.joints = True
            near = self.goal(at + skip, text[skip:])
        for number, one in enumerate(self.reading.positions):
            if one.name in names and near and one.near is None:
                self.reading.positions[number] = replace(one, near=near[0])
        return [*names, *near]
