"""The data of the RAPID module, and RAPID's way to write values."""

from __future__ import annotations

import math
import re

import numpy as np

from .return_code import INVALID_ARGUMENT, RequestRefused

MODULE = "zerobeam_egm"
_NO_AXIS = 9e9  # what RAPID writes for an external axis that there is not

JointTarget = tuple[tuple[float, ...], tuple[float, ...]]
Value = bool | float | JointTarget

_INITIAL: dict[str, Value] = {
    "zb_target": ((0.0,) * 6, (_NO_AXIS,) * 6),
    "zb_speed": 10.0,
    "zb_command": 0.0,
    "zb_start": False,
    "zb_done": 0.0,
    "zb_error": 0.0,
}
_LIST = re.compile(r"\s*\[\s*\[([^\[\]]*)\]\s*,\s*\[([^\[\]]*)\]\s*\]\s*")


class RapidData:
    """PERS data by name; `written` and `text` speak RAPID."""

    def __init__(self) -> None:
        self._values = dict(_INITIAL)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._values)

    def type_of(self, name: str) -> str:
        value = self._values[name]
        return "bool" if isinstance(value, bool) else "num" if isinstance(value, float) else "jointtarget"

    def flag(self, name: str) -> bool:
        value = self._values[name]
        assert isinstance(value, bool)
        return value

    def number(self, name: str) -> float:
        value = self._values[name]
        assert isinstance(value, float)
        return value

    def joints_deg(self, name: str) -> tuple[float, ...]:
        """The six robot axes of a jointtarget, degrees."""
        value = self._values[name]
        assert isinstance(value, tuple)
        return value[0]

    def set(self, name: str, value: bool | float) -> None:
        assert type(value) is type(self._values[name])
        self._values[name] = value

    def text(self, name: str) -> str:
        """The value as RAPID writes it."""
        value = self._values[name]
        if isinstance(value, bool):
            return "TRUE" if value else "FALSE"
        if isinstance(value, float):
            return number_text(value)
        return "[" + ",".join(f"[{','.join(map(number_text, part))}]" for part in value) + "]"

    def written(self, name: str, text: str) -> None:
        """Take a value as RAPID writes it; RequestRefused where it is none of the type."""
        value: Value | None
        if isinstance(self._values[name], bool):
            value = {"TRUE": True, "FALSE": False}.get(text.strip().upper())
        elif isinstance(self._values[name], float):
            value = _number(text)
        else:
            parts = _LIST.fullmatch(text)
            lists = (
                [] if parts is None else [[_number(v) for v in part.split(",")] for part in parts.groups()]
            )
            whole = [tuple(v for v in part if v is not None) for part in lists]
            value = (whole[0], whole[1]) if [len(part) for part in whole] == [6, 6] else None
        if value is None:
            raise RequestRefused(INVALID_ARGUMENT, f"{text[:80]} is no {self.type_of(name)}")
        self._values[name] = value


def number_text(value: float, digits: int = 6) -> str:
    """A num is of single precision; as the value of a datum it is written in six digits (9E+09, 0.866025)."""
    return format(float(np.float32(value)), f".{digits}g").upper()


def _number(text: str) -> float | None:
    try:
        value = float(np.float32(float(text)))
    except ValueError:
        return None
    return value if math.isfinite(value) else None
