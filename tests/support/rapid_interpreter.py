"""An interpreter of the RAPID that zerobeam writes: routines, MoveAbsJ, Stop, files."""

import re
from types import SimpleNamespace
from typing import Any

from program_arm import PendantArm

_MOVE = re.compile(r"MoveAbsJ (\w+),v50\\T:=(.+),(\w+),(\w+)")
_WRITE = re.compile(r"Write log,(.*?)(\\NoNewLine)?")
_ROUTINE = re.compile(r"(?:PROC|FUNC \w+) (\w+)\((.*)\)")


class _Returned(Exception):
    pass


def jointtarget(value: Any) -> Any:
    """[[rax_1…],[eax_a…]] as a record."""
    return SimpleNamespace(robax=SimpleNamespace(**{f"rax_{i}": v for i, v in enumerate(value[0], start=1)}))


class RapidController:
    """Runs one module on an arm; `files` are what it has written, `said` what it showed."""

    def __init__(self, text: str, arm: PendantArm, first: int = 0) -> None:
        self.arm, self.first, self.log, self.said, self.longest_s = arm, first, "", [], 0.0
        assert text.isascii()
        bare = [re.sub(r"^\s*!.*", "", line).strip() for line in text.splitlines()]
        statements = re.sub(r"\n\+", "+", "\n".join(filter(None, bare))).split("\n")
        assert statements[0] == "MODULE zb_plan"
        assert statements[-1] == "ENDMODULE"
        self.names: dict[str, Any] = {"fine": "fine", "tool0": "tool0"}
        self.routines: dict[str, tuple[list[str], list[str]]] = {}
        body: list[str] = []
        for line in statements[1:-1]:
            routine = _ROUTINE.fullmatch(line)
            if routine is not None:
                body = []
                given = [part.split()[1] for part in routine[2].split(",") if part]
                self.routines[routine[1]] = given, body
            elif line.startswith("CONST "):
                kind, name, value = re.fullmatch(r"CONST (\w+) (\w+):=(.*);", line).groups()
                parsed = eval(value.replace("TRUE", "True").replace("FALSE", "False"))
                self.names[name] = jointtarget(parsed) if kind == "jointtarget" else parsed
            elif line not in ("ENDPROC", "ENDFUNC"):
                body.append(line)

    def run(self, name: str = "zb_run") -> str:
        """Call a routine; the log that it has written."""
        self._call(name, [])
        return self.log

    def _call(self, name: str, values: list[Any]) -> Any:
        given, body = self.routines[name]
        try:
            self._block(body, dict(zip(given, values, strict=True)))
        except _Returned as returned:
            return returned.args[0]
        return None

    def _block(self, body: list[str], local: dict[str, Any]) -> None:
        i = 0
        while i < len(body):
            line = body[i]
            branch = re.fullmatch(r"IF (.*) THEN", line)
            if branch is None:
                self._statement(line.removesuffix(";"), local)
                i += 1
                continue
            depth, parts, j = 1, [[]], i + 1
            while depth:
                depth += body[j].startswith("IF ") and body[j].endswith(" THEN")
                depth -= body[j] == "ENDIF"
                if body[j] == "ELSE" and depth == 1:
                    parts.append([])
                elif depth:
                    parts[-1].append(body[j])
                j += 1
            holds = self._value(branch[1], local)
            self._block(parts[0] if holds else parts[1] if len(parts) > 1 else [], local)
            i = j

    def _statement(self, line: str, local: dict[str, Any]) -> None:
        move, write = _MOVE.fullmatch(line), _WRITE.fullmatch(line)
        one = re.fullmatch(r"IF (.*?) RETURN (.*)", line)
        assigned = re.fullmatch(r"(?:VAR \w+ )?(\w+):=(.*)", line)
        called = re.fullmatch(r"(zb_\w+)(?: (.*))?", line)
        if move is not None:
            goal = self._value(move[1], local)
            self.longest_s = max(self.longest_s, self._value(move[2], local))
            self.arm.move([getattr(goal.robax, f"rax_{i}") for i in range(1, self.arm.plan.robot.n + 1)])
        elif write is not None:
            self.log += self._value(write[1], local) + ("" if write[2] else "\n")
        elif one is not None:
            if self._value(one[1], local):
                raise _Returned(self._value(one[2], local))
        elif line.startswith("RETURN "):
            raise _Returned(self._value(line.removeprefix("RETURN "), local))
        elif line.startswith("TPReadNum "):
            local[line.split(",")[0].split()[1]] = self.first
        elif line.startswith("TPWrite "):
            text = self._value(line.removeprefix("TPWrite "), local)
            assert len(text) <= 80
            self.said.append(text)
        elif line == "Stop\\NoRegain":
            self.arm.centre()
        elif assigned is not None:
            local[assigned[1]] = self._value(assigned[2], local)
        elif called is not None:
            self._call(called[1], self._value(f"[{called[2] or ''}]", local))
        else:
            assert re.fullmatch(
                r'VAR \w+ \w+|Open "HOME:"\\File:="zb_plan.log",log\\Append|Close log', line
            ), line

    def _value(self, text: str, local: dict[str, Any]) -> Any:
        python = re.sub(r"(?<![<>:=])=(?!=)", "==", text) if '"="' not in text else text
        functions = {
            name: lambda *values, name=name: self._call(name, list(values)) for name in self.routines
        }
        found = eval(python, {**self.names, **functions, **_FUNCTIONS, "CJointT": self._read, **local})
        if isinstance(found, str):
            assert len(found) <= 80, "a RAPID string has 80 characters at most"
        return found

    def _read(self) -> Any:
        row = self.arm.joints()
        return jointtarget([[*row, *[0.0] * (6 - len(row))]])


_FUNCTIONS = {"Abs": abs, "NumToStr": lambda value, digits: f"{value:.{digits}f}"}
