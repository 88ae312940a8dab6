"""A program of a libfranka user as far as the tests need it: it moves the arm through a joint list."""

from pathlib import Path

import numpy as np
from program_arm import PendantArm


def carried_out(joint_list: Path, arm: PendantArm) -> Path:
    """The file of what it recorded."""
    names: dict[str, list[float]] = {}
    exec(compile(joint_list.read_text(), joint_list.name, "exec"), {}, names)
    recorded = []
    for name, radians in names.items():
        arm.move(np.degrees(radians))
        if name.startswith("zb_p"):
            arm.centre()
            values = ", ".join(f"{value:.10f}" for value in np.radians(arm.joints()))
            recorded.append(f"zb_m{name.removeprefix('zb_p')} = [{values}]\n")
    saved = joint_list.with_name("recorded.py")
    saved.write_text("".join(recorded))
    return saved
