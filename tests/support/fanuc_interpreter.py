"""An interpreter of the TP programs that zerobeam writes, and the position registers as they are saved."""

import re
from pathlib import Path

from import_files import positions_of
from program_arm import PendantArm


def carried_out(listing: str, arm: PendantArm, ground: bool = True, registers: int = 100) -> str:
    """posreg.va after the program has run; joint 3 counts from the ground, as the pendant has it."""
    assert listing.isascii()
    points = {point.name: point.joints for point in positions_of("fanuc", listing, Path("a.ls"))}
    held: dict[int, list[float]] = {2: [1.0, 2, 3, 4, 5, 6]}  # of another program
    begun, end = listing.index("/MN\n") + 4, listing.index("/POS")
    for number, line in enumerate(listing[begun:end].splitlines(), start=1):
        assert line.startswith(f"{number:4}:")
        assert line.endswith(";")
        statement = line[5:-1].strip()
        motion = re.fullmatch(r"J P\[(\d+)\] (\d+)% (FINE|CNT\d+)", statement)
        register = re.fullmatch(r"PR\[(\d+)\]=JPOS", statement)
        element = re.fullmatch(r"PR\[(\d+),(\d)\]=(\d+)", statement)
        if motion is not None:
            row = list(points[motion[1]])
            row[2] += row[1] if ground else 0.0
            arm.move([round(value, 9) for value in row])
        elif register is not None:
            row = arm.joints()
            row[2] -= row[1] if ground else 0.0
            held[int(register[1])] = row
        elif element is not None:
            held[int(element[1])][int(element[2]) - 1] = float(element[3])
        elif statement == "PAUSE":
            arm.centre()
        else:
            assert re.fullmatch(r"![^;]{0,32}|UFRAME_NUM=0|UTOOL_NUM=\d+", statement), statement
    return registers_text(held, registers)


def registers_text(held: dict[int, list[float]], count: int) -> str:
    """As a controller saves position registers."""
    lines = [f"[*POSREG*]$POSREG  Storage: CMOS  Access: RW  : ARRAY[1,{count}] OF Position Reg"]
    for number in range(1, count + 1):
        if number not in held:
            lines.append(f"    [1,{number}] =   '' Uninitialized")
            continue
        lines.append(f"    [1,{number}] =   ''   Group: 1")
        values = [f"J{i} = {value:9.3f} deg" for i, value in enumerate(held[number], start=1)]
        lines += ["  " + "   ".join(values[i : i + 3]) + " " for i in range(0, len(values), 3)]
        lines.append("")
    return "\n".join(lines) + "\n"
