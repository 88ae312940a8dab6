"""SPEL+ (Epson): a plan as a program.

Facts, from the SPEL+ Language Reference of Seiko Epson: JA is a point by its joint angles, degrees; Agl reads
the angle of a joint; Preserve keeps a variable when a program ends; AOpen opens a file to append to it.
"""

from __future__ import annotations

from pathlib import Path

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import (
    LOG,
    LOG_PLAN,
    head_lines,
    listed,
    made_for,
    percents,
    require_name,
    short_hash,
    steps_of,
)

_USAGE = (
    "Start this function again and again, from the Run window: each start records where the arm is, in",
    "zb_plan.log, and goes to the next posture. In between no program runs: jog the beam onto the centre.",
    "confirm: the folder of the log is that of ChDisk and CurDir$ on your controller.",
    "confirm: zb_next is 0 before the first start (Print zb_next): it keeps its value from another plan.",
)


def spel_program(plan: Plan, motion: ProgramMotion, file: Path) -> str:
    """Text of the program, whose function has the name of `file`."""
    note = made_for(plan, "epson", "a SPEL+ program", 6, "JA")
    require_name(
        file,
        r"[A-Za-z]\w{0,31}",
        "function",
        "SPEL+",
        "a letter, then letters, digits and _: at most 32 (zb_plan.prg)",
    )
    steps = steps_of(plan, motion)
    angles = [
        f'      zb_line$ = zb_line$ + " " + FmtStr$(Agl({i}), "0.0000")' for i in range(1, plan.robot.n + 1)
    ]
    lines = [
        *(f"' {line}" for line in (*head_lines(plan, motion, note), *_USAGE)),
        "Global Preserve Integer zb_next",
        "",
        f"Function {file.stem}",
        "  Integer zb_yes",
        "  String zb_line$",
        "  Motor On",
        "  Power Low",
        f"  Speed {min(percents(plan.robot, motion.speed))}",
        "  Accel 10, 10",
        "  If zb_next > 0 Then",
        '    Print "Is the beam on the centre of the posture? 1: record it, 0: go there again"',
        "    Input zb_yes",
        "    zb_next = zb_next - 1",
        "    If zb_yes = 1 Then",
        f'      zb_line$ = "{LOG} " + FmtStr$(zb_next, "0") + " deg"',
        *angles,
        '      AOpen "zb_plan.log" As #30',
        f'      Print #30, "{LOG_PLAN} {short_hash(plan)}"',
        "      Print #30, zb_line$",
        "      Close #30",
        "      zb_next = zb_next + 1",
        "    EndIf",
        "  EndIf",
        "  Select zb_next",
    ]
    for step in steps:
        lines += [f"    Case {step.number}", f"      ' posture {step.number}, {one_line(step.target)}"]
        lines += [f"      Go JA({listed(row)})" for row in step.named.values()]
    return "\n".join(
        [
            *lines,
            f"    Case {len(steps)}",
            '      Print "All postures are recorded."',
            "      zb_next = -1",
            "  Send",
            "  zb_next = zb_next + 1",
            "Fend",
            "",
        ]
    )
