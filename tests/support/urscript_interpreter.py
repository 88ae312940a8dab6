"""An interpreter of the URScript that zerobeam writes: made into Python, block by block, and run."""

import math
import re
from typing import Any

from program_arm import PendantArm


def carried_out(text: str, arm: PendantArm, first: int = 0) -> tuple[str, list[str]]:
    """The log as PolyScope shows it, and what was sent to the listener."""
    log: list[str] = []
    sent: list[str] = []
    answers = iter([first])
    asked: list[float] = []

    def integer(message: str) -> int:
        assert message
        if message.startswith("Begin"):
            return next(answers)
        # The person turns joints by the degrees that the centred beam needs, then records.
        if not asked:
            before = arm.joints()
            arm.centre()
            asked.extend([0.0, *(after - was for after, was in zip(arm.joints(), before, strict=True))])
        return 0

    def movej(joints: list[float], a: float, v: float, r: float = 0.0) -> None:
        assert 0 < v <= math.radians(60)
        assert a > 0
        asked.clear()
        arm.move([round(math.degrees(value), 12) for value in joints])

    def textmsg(one: str, other: str = "") -> None:
        log.append(f"2026-11-22 15:00:00.{len(log):03} :-: {one}{other}\n")

    names: dict[str, Any] = {
        "movej": movej,
        "textmsg": textmsg,
        "d2r": math.radians,
        "r2d": math.degrees,
        "floor": math.floor,
        "norm": abs,
        "str_cat": lambda one, other: one + other,
        "to_str": lambda value: str(value),
        "sync": lambda: None,
        "popup": lambda *_, **__: None,
        "get_actual_joint_positions": lambda: [math.radians(value) for value in arm.joints()],
        "request_integer_from_primary_client": integer,
        "socket_open": lambda host, port, name: True,
        "socket_send_line": lambda line, name: sent.append(line + "\n"),
    }
    exec(_python(text), names)
    names["zb_plan"]()
    return "".join(log), sent


def _python(text: str) -> str:
    assert text.isascii()
    lines, depth = [], 0
    for content in text.splitlines():
        line = content.strip()
        if not line or line.startswith("#"):
            continue
        if line == "end":
            depth -= 1
            continue
        if re.match(r"(elif\b|else:)", line):
            depth -= 1
        stated = re.fullmatch(r"global (\w+) = (.*)", line)
        if stated is not None:
            lines.append("    " * depth + f"global {stated[1]}")
            line = f"{stated[1]} = {stated[2]}"
        lines.append("    " * depth + line)
        if line.endswith(":"):
            depth += 1
    assert depth == 0
    return "\n".join(lines)
