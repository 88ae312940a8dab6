import hashlib

import numpy as np
import pytest

from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import read_plan, write_plan

PLAN = """\
schema: zerobeam/plan/1
robot: irb1600
tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
targets:
  psd: {guess_mm: [1200, 0, 600]}
postures_deg:
  - [0, 10, 20, 30, 40, 50]
  - {joints_deg: [1, 11, 21, 31, 41, 51], target: psd}
  - - 2
    - 12
    - 22
    - 32
    - 42
    - 52
"""


@pytest.fixture
def plan_file(tmp_path):
    def write(text):
        path = tmp_path / "plan.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def change(old, new, text=PLAN):
    assert old in text
    return text.replace(old, new, 1)


def test_a_plan_in_internal_units(plan_file):
    path = plan_file(PLAN)
    plan = read_plan(path)
    np.testing.assert_allclose(plan.postures[1], np.radians([1, 11, 21, 31, 41, 51]))
    assert plan.postures.shape == (3, 6)
    assert plan.targets == ("psd", "psd", "psd")
    assert plan.lines == (8, 9, 10)
    assert plan.header.targets["psd"].guess_mm == (1200, 0, 600)
    assert type(plan.header) is Header
    assert plan.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert plan.warnings == ()


def test_the_target_of_a_plain_row(plan_file, refused):
    bare = change("targets:\n  psd: {guess_mm: [1200, 0, 600]}\n", "")
    assert read_plan(plan_file(bare)).targets == ("psd", "psd", "psd")
    renamed = change("  psd:", "  screen:", change("target: psd", "target: screen"))
    assert read_plan(plan_file(renamed)).targets == ("screen", "screen", "screen")
    two = change("600]}\n", "600]}\n  other: {}\n")
    error = refused(read_plan, plan_file(two))
    assert "posture 0 does not say which target" in error.what
    assert error.allowed == "psd, other"
    assert error.line == 9


def test_targets_in_the_order_of_their_first_posture(plan_file):
    text = change("target: psd", "target: b", change("targets:\n  psd: {guess_mm: [1200, 0, 600]}\n", ""))
    plan = read_plan(plan_file(text))
    assert plan.target_names == ("psd", "b")
    np.testing.assert_array_equal(plan.target_index, [0, 1, 0])


@pytest.mark.parametrize(
    ("old", "new", "what", "line"),
    [
        ("zerobeam/plan/1", "zerobeam/run/1", "not a plan file", 1),
        ("schema: zerobeam/plan/1\n", "", "not a plan file", 1),
        ("irb1600", "irb9", "no robot of this name", 2),
        ("joint_deg: 0.01", "joint_deg: [1, 1]", "wrong number of values", 4),
        ("postures_deg", "postures", "unknown key 'postures'", 7),
        ("[0, 10, 20, 30, 40, 50]", "[0, 10, 20, 30, 40]", "posture 0 has the wrong number of joints", 8),
        ("[0, 10, 20, 30, 40, 50]", "[0, 10, 20, '30', 40, 50]", "joint 4 is not a number", 8),
        ("[0, 10, 20, 30, 40, 50]", "[0, 10, 20, .inf, 40, 50]", "not finite", 8),
        ("[0, 10, 20, 30, 40, 50]", "up", "not a list of numbers", 8),
        ("[0, 10, 20, 30, 40, 50]", "{joints_deg: [0, 0, 0, 0, 0, 0]}", "'target' is missing", 8),
        ("target: psd", "targt: psd", "unknown key 'targt' in item 2 of postures_deg", 9),
        ("    - 42", "    - 142", "posture 2: joint 5 is outside its limits", 10),
        ("    - 42", "    - null", "joint 5 is not a number", 14),
        (
            "postures_deg:",
            "distances: [{between: [psd, b], mm: 5, sigma_mm: 1}]\npostures_deg:",
            "a distance names a target",
            7,
        ),
    ],
)
def test_a_plan_that_cannot_be_used(plan_file, refused, old, new, what, line):
    path = plan_file(change(old, new))
    error = refused(read_plan, path)
    assert what in error.what, error
    assert error.line == line, error
    assert error.file == str(path)


def test_a_plan_without_postures(plan_file, refused):
    top = PLAN[: PLAN.index("postures_deg")]
    error = refused(read_plan, plan_file(top + "postures_deg: []\n"))
    assert "postures_deg is empty" in error.what
    assert "'postures_deg' is missing" in refused(read_plan, plan_file(top)).what


def test_limits_warn(plan_file):
    text = change("    - 42", "    - 142", change("robot:", "limits: warn\nrobot:"))
    (warning,) = read_plan(plan_file(text)).warnings
    assert warning.endswith("up to 142 deg, in 1 of 3 postures: 2")


def header(**changes):
    content = {
        "robot": "irb1600",
        "tool": {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    }
    return Header.model_validate({**content, **changes})


POSTURES = np.random.default_rng(1).uniform(-80, 60, (4, 6))


@pytest.mark.parametrize(
    ("targets", "changes"),
    [
        (["psd"] * 4, {}),
        (["a"] * 4, {"targets": {"a": {"guess_mm": [1, 2, 3]}}}),
        (["a"] * 4, {}),
        (["a", "b", "a", "b"], {"targets": {"a": {}, "b": {}}, "held": ["delta1"]}),
        (["a", "b", "a", "b"], {"provenance": {"when": "2024-05-01", "n": "12", "yes": "~"}}),
        (["yes", "12", "~", "a: b"], {"distances": [{"between": ["yes", "12"], "mm": 5, "sigma_mm": 1}]}),
    ],
)
def test_a_written_plan_is_read_again_to_the_last_digit(tmp_path, targets, changes):
    path = tmp_path / "plan.yaml"
    write_plan(path, header(**changes), POSTURES, targets)
    plan = read_plan(path)
    assert plan.targets == tuple(targets)
    np.testing.assert_array_equal(plan.postures, POSTURES / plan.robot.display)
    assert plan.header.model_copy(update={"schema_": None}) == header(**changes)
    assert [entry.name for entry in tmp_path.iterdir()] == ["plan.yaml"]


def test_a_written_plan_is_for_people(tmp_path):
    path = tmp_path / "plan.yaml"
    write_plan(path, header(), [[0, 10, 20, 30, 40, 50], [1, 11, 21, 31, 41, 51]], ["psd", "psd"])
    head, postures = path.read_text().split("postures_deg:\n")
    assert head.startswith("schema: zerobeam/plan/1\nrobot: irb1600\ntool:\n  kind: laser\n")
    assert "  point_mm: [0.0, 0.0, 65.0]\n" in head
    assert postures == "  - [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]\n  - [1.0, 11.0, 21.0, 31.0, 41.0, 51.0]\n"


def test_nothing_is_overwritten_and_nothing_unsound_is_written(tmp_path, refused):
    path = tmp_path / "plan.yaml"
    path.write_text("mine")
    error = refused(write_plan, path, header(), POSTURES, ["psd"] * 4, force=False)
    assert "exists already" in error.what
    assert "--force" in str(error.remedy)
    assert path.read_text() == "mine"
    other = tmp_path / "other.yaml"
    assert "outside its limits" in refused(write_plan, other, header(), POSTURES + 300, ["psd"] * 4).what
    assert "wrong number" in refused(write_plan, other, header(), POSTURES[:, :5], ["psd"] * 4).what
    assert "not finite" in refused(write_plan, other, header(), POSTURES * np.nan, ["psd"] * 4).what
    assert "no postures" in refused(write_plan, other, header(), [], []).what
    assert not other.exists()


VIA = """\
  - joints_deg: [1, 11, 21, 31, 41, 51]
    target: psd
    via_deg: [[0, 0, 0, 0, 30, 0], [1, 5, 9, 0, 30, 0]]
"""


def test_intermediate_postures_are_of_the_posture_that_states_them(plan_file, refused):
    text = PLAN[: PLAN.index("  - {joints_deg")] + VIA
    plan = read_plan(plan_file(text))
    assert plan.targets == ("psd", "psd")
    assert plan.via_of(0).shape == (0, 6)
    np.testing.assert_allclose(np.degrees(plan.via_of(1)), [[0, 0, 0, 0, 30, 0], [1, 5, 9, 0, 30, 0]])
    assert read_plan(plan_file(PLAN)).via_of(2).shape == (0, 6)
    error = refused(read_plan, plan_file(change("[1, 5, 9, 0, 30, 0]", "[1, 500, 9, 0, 30, 0]", text)))
    assert error.what.startswith("before posture 1, intermediate posture 1: joint 2 is outside its limits")
    assert error.line == 9
    error = refused(read_plan, plan_file(change("[1, 5, 9, 0, 30, 0]", "[1, 5]", text)))
    assert error.what == "intermediate posture 1 before posture 1 has the wrong number of joints"
