"""JointTrajectory messages in YAML, carried out; joint states as `ros2 topic echo` prints them."""

import math

from program_arm import PendantArm
from ruamel.yaml import YAML


def carried_out(text: str, arm: PendantArm) -> str:
    """The texts of the joint states, one after each trajectory."""
    said = ""
    for message in YAML(typ="safe", pure=True).load_all(text):
        if message is None:
            continue
        time = 0.0
        for point in message["points"]:
            start = point["time_from_start"]
            assert start["sec"] + start["nanosec"] * 1e-9 > time
            time = start["sec"] + start["nanosec"] * 1e-9
            arm.move([round(math.degrees(value), 11) for value in point["positions"]])
        arm.centre()
        # Drivers order the joints as they like.
        pairs = sorted(zip(message["joint_names"], arm.joints(), strict=True), reverse=True)
        names = "".join(f"- {name}\n" for name, _ in pairs)
        values = "".join(f"- {math.radians(value)!r}\n" for _, value in pairs)
        stamp = "header:\n  stamp:\n    sec: 1\n    nanosec: 2\n  frame_id: ''\n"
        said += f"{stamp}name:\n{names}position:\n{values}velocity: []\neffort:\n- .nan\n---\n"
    return said
