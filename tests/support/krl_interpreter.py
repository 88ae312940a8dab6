"""An interpreter of the KRL that zerobeam writes; each start is one selection of the program."""

import re
from typing import Any

from program_arm import PendantArm

_DECLARED = re.compile(
    r"(?:DECL )?(?:(?P<kind>\w+) )?(?P<name>\w+)(?P<size>\[\d*\])?=(?P<value>.*?)(?: ;.*)?"
)


class KrlController:
    """A module on an arm: its source and its data list, which keeps what the program assigns."""

    def __init__(self, source: str, data: str, arm: PendantArm) -> None:
        assert source.isascii()
        assert data.isascii()
        self.arm, self._data = arm, data
        self.values: dict[str, Any] = {}
        self.moved = False
        for line in data.splitlines():
            declared = _DECLARED.fullmatch(line)
            if declared is not None and not line.startswith((";", "&")):
                self.values[declared["name"]] = _value(declared["value"])
        bare = [line.split(" ;")[0].strip() for line in source.splitlines()]
        self._lines = [line for line in bare if line and line[0] not in "&;"]
        assert self._lines[0].startswith("DEF ")
        assert self._lines[-1] == "END"

    def start(self) -> bool:
        """Select and start the program once; whether it has moved the arm."""
        self.moved, first = False, True
        taken: list[bool] = []
        chosen: list[Any] = []
        for line in self._lines[1:-1]:
            if line.startswith("IF "):
                name, value = re.fullmatch(r"IF (\w+)==(\w+) THEN", line).groups()
                taken.append(self.values[name] == _value(value))
            elif line.startswith("SWITCH "):
                chosen.append(self.values[line.split()[1]])
                taken.append(False)
            elif line.startswith("CASE "):
                taken[-1] = chosen[-1] == int(line.split()[1])
            elif line in ("ENDIF", "ENDSWITCH"):
                taken.pop()
                if line == "ENDSWITCH":
                    chosen.pop()
            elif all(taken):
                if line.startswith("PTP "):
                    # Block coincidence: the first motion is to where the arm is.
                    assert first == (line == "PTP $AXIS_ACT")
                    first = False
                self._statement(line)
        return self.moved

    def _statement(self, line: str) -> None:
        motion = re.fullmatch(r"PTP (ZB_\w+)( C_PTP)?", line)
        assigned = re.fullmatch(r"(ZB_\w+)=(.*)", line)
        if motion is not None:
            axes = self.values[motion[1]]
            self.arm.move([axes[f"A{i}"] for i in range(1, len(axes) + 1)])
            self.moved = True
        elif assigned is not None:
            self.values[assigned[1]] = self._computed(assigned[2])
        else:
            assert re.fullmatch(r"PTP \$AXIS_ACT|BAS\(#\w+,\d+\)|\$[\w.]+(\[\d\])?=[\w$]+", line), line

    def _computed(self, text: str) -> Any:
        if text == "$AXIS_ACT":
            axes = {f"A{i}": value for i, value in enumerate(self.arm.joints(), start=1)}
            return {**axes, **{f"E{i}": 0.0 for i in range(1, 7)}}
        more = re.fullmatch(r"(\w+)\+1", text)
        return _value(text) if more is None else self.values[more[1]] + 1

    def data(self) -> str:
        """The data list as the controller keeps it."""
        lines = []
        for line in self._data.splitlines():
            declared = _DECLARED.fullmatch(line)
            if declared is None or line.startswith((";", "&")):
                lines.append(line)
            else:
                head = line[: declared.start("value")]
                lines.append(head + _text(self.values[declared["name"]]))
        return "\n".join(lines) + "\n"


def _value(text: str) -> Any:
    if text.startswith("{"):
        return {part.split()[0]: float(part.split()[1]) for part in text.strip("{}").split(",")}
    if text in ("TRUE", "FALSE"):
        return text == "TRUE"
    return text.strip('"') if text.startswith('"') else int(text)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ",".join(f"{axis} {number:.6f}" for axis, number in value.items()) + "}"
    if isinstance(value, bool):
        return str(value).upper()
    return f'"{value}"' if isinstance(value, str) else str(value)
