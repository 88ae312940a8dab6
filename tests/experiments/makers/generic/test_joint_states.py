"""Joint states as `ros2 topic echo` prints them."""

from __future__ import annotations

import numpy as np
import pytest
from import_files import import_joint_states
from recorded_logs import POSTURES

NAMES = ["joint6", "joint1", "joint2", "joint3", "joint4", "joint5", "gripper"]


def message(row, names=NAMES, inline=False):
    values = np.radians([row[5], *row[:5], 0.0])
    if inline:
        joints = f"name: [{', '.join(names)}]\nposition: [{', '.join(map(repr, values.tolist()))}]\n"
    else:
        joints = "name:\n" + "".join(f"- '{name}'\n" for name in names)
        joints += "position:\n" + "".join(f"  - {value!r}\n" for value in values.tolist())
    return f"header:\n  stamp:\n    sec: 1\n  frame_id: ''\n{joints}velocity: []\neffort:\n- .nan\n---\n"


@pytest.fixture
def read(tmp_path, header):
    def call(text, columns=None):
        file = tmp_path / "recorded.yaml"
        file.write_text(text)
        return import_joint_states([file], ["a"], header, tmp_path / "run.jsonl", columns=columns)

    return call


@pytest.mark.parametrize("inline", [False, True])
def test_each_message_is_a_measurement(read, inline):
    found = read("".join(message(row, inline=inline) for row in POSTURES))
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)
    own = [f"arm_{name}" for name in NAMES]
    columns = [f"arm_joint{i}=joint{i}" for i in (2, 1, 3, 4, 5, 6)]
    found = read("".join(message(row, own, inline) for row in POSTURES).removesuffix("---\n"), columns)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)


def test_texts_that_are_refused(read, refused):
    good = message(POSTURES[0])
    assert refused(read, "---\n").what == "no measurements found: the file has no joint states"
    error = refused(read, good + good.replace("'joint3'", "'elbow'"))
    assert error.what == "the message has no joint 'joint3'"
    assert error.line == 25
    value = repr(float(np.radians(POSTURES[0][0])))
    assert "'joint1' is not a finite number" in refused(read, good.replace(value, ".nan")).what
    assert refused(read, good.replace("position:", "positions:")).what == (
        "a message has no names or no positions"
    )
    none = good.split("position:\n")[0] + "position: []\n"
    assert refused(read, none).what == "the message has no joint 'joint1'"
