"""Positions of scripts of light arms: DRL (Doosan), URScript (Universal Robots)."""

from __future__ import annotations

import re
from dataclasses import replace

from ...model.kinematics.orientation import from_rotation_vector
from .position import NUMBER, BackupReading, Lines, What, arguments_of, pose_of, values_in
from .script import Script

_DRL_LIST = rf"{NUMBER}(?:\s*,\s*{NUMBER})*\s*,?\s*"
_DRL_TCP = re.compile(r"\bset_tcp\s*\(\s*([\"'])?")
_REF = re.compile(r"\bset_ref_coord\s*\(\s*([^()]*)\)")
_STEP = re.compile(r"\ba?move_(?:spiral|periodic)\b")
_KEY = re.compile(r"(\w+)\s*=(?!=)\s*")


def read_drl(reading: BackupReading) -> None:
    """Each program has variables of its own."""
    for file in reading.files:
        program = DrlProgram(file, reading)
        program.scan()
        program.run()


class DrlProgram(Script):
    """A program of DRL."""

    literal = re.compile(rf"(?:(?P<kind>pos[jx])\s*)?[\[(]\s*[\[(]?\s*(?P<numbers>{_DRL_LIST})[\])]?\s*[\])]")
    begin = re.compile(r"pos[jx]\s*[\[(]")
    assign = re.compile(
        r"(?P<name>[A-Za-z_]\w*)(?P<index>(?:\s*\[[^\]]*\])*)\s*[-+*/]?=(?!=)\s*(?P<value>.*)", re.DOTALL
    )
    move = re.compile(r"\ba?move(?P<kind>jx|j|l|c|sj|sx|b)\s*\(")
    jump = re.compile(r"(?:def|if|elif|else|for|while|try|except|with|class)\b")
    refused = re.compile(r"\b(?:set_user_cart_coord|overwrite_user_cart_coord|add_tcp)\b")

    def is_joints(self, literal: re.Match[str]) -> bool | None:
        return literal["kind"] == "posj" if literal["kind"] else None

    def setting(self, pos: int, text: str) -> None:
        if (put := _DRL_TCP.search(text)) is not None:
            name = re.match(r"([^\"'\n]*)[\"']", self.file.text[pos + put.end() :]) if put[1] else None
            self.active.set("tool", pos, name and name[1])
        if (put := _REF.search(text)) is not None:
            self.active.set("frame", pos, _frame(put[1]))

    def takes_joints(self, move: re.Match[str]) -> bool:
        return move["kind"] in ("j", "sj")

    def goals_of(self, move: re.Match[str], arguments: Lines) -> Lines:
        goals = []
        for at, text in arguments:
            key = _KEY.match(text)
            if key is None and not text.startswith("DR_"):
                goals.append((at, text))
            elif key is not None and key[1].startswith("pos"):
                goals.append((at + key.end(), text[key.end() :]))
        return goals[: 2 if move["kind"] == "c" else 1]

    def other(self, pos: int, text: str) -> None:
        if (step := _STEP.search(text)) is not None:
            self.relative(pos, f"{step[0]} is a step from where the arm is")
        if "move_home" in text:
            self.doubt(pos, "elsewhere", "move_home: home is stored in the controller")
        super().other(pos, text)

    def motion(self, pos: int, move: re.Match[str], arguments: Lines) -> None:
        goals = self.goals_of(move, arguments)
        words = {key[1]: text[key.end() :].strip() for _, text in arguments if (key := _KEY.match(text))}
        bare = [text for _, text in arguments if text.startswith("DR_")]
        mod = words.get("mod", next((text for text in bare if "_MOD_" in text), ""))
        ref = words.get("ref", next((text for text in bare if "_MOD_" not in text), ""))
        frame = _frame(ref) if ref else self.active.at("frame", pos) or "base"
        if mod in ("DR_MV_MOD_REL", "1"):
            by = goals[0][1] if goals else ""
            if self.joints:  # it ends by as much further as it begins
                self.added(by)
            else:
                self.step(pos, by, by, (), "tool" if frame == "DR_TOOL" else "frame")
            return None
        if frame in (None, "DR_TOOL") and not self.joints:
            return self.refuse(pos, "the frame of this motion is set when the program runs")
        names = [name for at, text in goals for name in self.goal(at, text)]
        return self.goes(pos, names, frame)

    def goal(self, pos: int, text: str) -> list[str]:
        if (same := re.fullmatch(r"pos[jx]\s*\(\s*\*?\s*([A-Za-z_]\w*)\s*\)", text)) is not None:
            return super().goal(pos + same.start(1), same[1])  # posx(NAME) is NAME
        if (call := re.match(r"(trans|posb)\s*\(", text)) is not None:
            parts = [(pos + at, part) for at, part in arguments_of(text, call.end())]
            if call[1] == "posb":
                return [name for at, part in parts[1:] if "=" not in part for name in self.goal(at, part)]
            names, by = self.goal(*parts[0]), parts[1][1] if len(parts) > 1 else ""
            axes: What = "tool" if any(part == "DR_TOOL" for _, part in parts) else "frame"
            self.step(pos, text, by, names, axes)
            return names
        if text.startswith("[") and self.literal.fullmatch(text) is None:
            return [name for at, part in arguments_of(text, 1) for name in self.goal(pos + at, part)]
        return super().goal(pos, text)


def _frame(text: str) -> str | None:
    """The name of a reference: base, DR_WORLD, DR_USER1, a number; None of a variable."""
    text = text.strip()
    return "base" if text in ("DR_BASE", "0") else text if re.fullmatch(r"DR_\w+|\d+", text) else None


_UR_LIST = rf"{NUMBER}(?:\s*,\s*{NUMBER})*"
_UR_TCP = re.compile(r"\bset_tcp\s*\(")
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

    literal = re.compile(rf"(?P<kind>p\s*)?\[\s*(?P<numbers>{_UR_LIST})\s*\]")
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
        if (put := _UR_TCP.search(text)) is not None:
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
        elif not _UR_TCP.search(text):
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
