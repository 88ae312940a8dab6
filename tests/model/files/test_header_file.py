"""Headers with the tolerances of a plant: which of the three is taken, and what is wrong with the file."""

from pathlib import Path

import pytest
from exact_runs import demo_runs

from zerobeam.analysis.analyse import analyse
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import header_content
from zerobeam.model.files.measurements import read_header
from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.run import read_run, write_run
from zerobeam.model.parsing.confinement import TOLERANCES, confined
from zerobeam.words.sentences import to_json

HEADER = """\
robot: irb1600
tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
"""
PLANT = """\
tolerance: {length_mm: 0.15, angle_deg: 0.04}
gravity_deg: 0.02
tool_sigma: {mm: 0.3, tilt_deg: 0.02}
"""


@pytest.fixture
def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "plant.yaml"
    path.write_text(PLANT, encoding="utf-8")
    monkeypatch.setenv(TOLERANCES, str(path))
    return path


def header_file(folder: Path, more: str = "") -> Path:
    path = folder / "header.yaml"
    path.write_text(HEADER + more, encoding="utf-8")
    return path


def test_where_a_header_says_nothing_the_tolerances_of_the_plant_hold(tmp_path: Path, plant: Path) -> None:
    own = read_header(header_file(tmp_path))
    assert own.arm is not None
    assert (own.arm.tolerance.length_mm, own.arm.tolerance.angle_deg) == (0.15, 0.04)
    assert (own.arm.gravity_deg, own.arm.harmonics_deg) == (0.02, 0.02)
    assert (own.tool.sigma.shift_mm, own.tool.sigma.tilt_deg) == (0.3, 0.02)
    # Written with the header, so that another plant reads the same; without what this one leaves out.
    written = header_content(own, "zerobeam/run/1")
    assert written["geometry"] == {
        "tolerance": {"length_mm": 0.15, "angle_deg": 0.04},
        "gravity_deg": 0.02,
    }


def test_what_a_header_states_goes_before(tmp_path: Path, plant: Path) -> None:
    geometry = "geometry: {tolerance: {length_mm: 0.5}, gravity: false}\n"
    sigma = HEADER.replace("direction: [1, 0, 0]", "direction: [1, 0, 0], sigma: {mm: 0.7}")
    path = header_file(tmp_path)
    path.write_text(sigma + geometry, encoding="utf-8")
    own = read_header(path)
    assert own.arm is not None
    assert (own.arm.tolerance.length_mm, own.arm.tolerance.angle_deg) == (0.5, 0.04)
    assert (own.arm.gravity, own.arm.gravity_deg) == (False, 0.02)
    assert (own.tool.sigma.shift_mm, own.tool.sigma.tilt_deg) == (0.7, 0.02)


def test_an_exact_arm_has_no_tolerances_and_a_free_tool_not_those_of_the_plant(
    tmp_path: Path, plant: Path
) -> None:
    own = read_header(header_file(tmp_path, "geometry: exact\n"))
    assert own.arm is None
    assert own.exact_tool
    path = header_file(tmp_path)
    path.write_text(HEADER.replace("laser,", "laser, calibrated: false,"), encoding="utf-8")
    assert read_header(path).tool.sigma.shift_mm == 10.0


def test_a_file_that_the_header_names_goes_before_that_of_the_environment(
    tmp_path: Path, plant: Path
) -> None:
    (tmp_path / "line4").mkdir()
    (tmp_path / "line4/arms.yaml").write_text("tolerance: {length_mm: 0.9}\n", encoding="utf-8")
    own = read_header(header_file(tmp_path / "line4", "geometry: {tolerances: arms.yaml, gravity: false}\n"))
    assert own.arm is not None
    assert (own.arm.tolerance.length_mm, own.arm.tolerance.angle_deg) == (0.9, 0.1)
    assert (own.arm.gravity, own.arm.gravity_deg, own.arm.tolerances) == (False, 0.05, None)


def test_what_a_plant_leaves_out_stays_assumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of link lengths alone does not make a laser's mounting one that was stated."""
    (tmp_path / "arms.yaml").write_text("tolerance: {length_mm: 0.9}\n", encoding="utf-8")
    monkeypatch.setenv(TOLERANCES, str(tmp_path / "arms.yaml"))
    own = read_header(header_file(tmp_path))
    assert own.arm is not None
    assert own.arm.declared_kinds == {"length"}
    assert "sigma" not in own.tool.model_fields_set
    assert not any(one.stated for one in own.made("tool", 6).taken_as_known)


def test_without_a_file_a_header_is_as_it_is_stated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOLERANCES, raising=False)
    own = read_header(header_file(tmp_path))
    assert own.geometry is None
    assert "sigma" not in own.tool.model_fields_set


@pytest.mark.long
def test_runs_plans_and_results_state_them(
    tmp_path: Path, plant: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was written at one plant means the same where there is no such file."""
    postures = "postures_deg:\n" + "  - [0, 10, 20, 30, 40, 50]\n" * 2
    path = tmp_path / "plan.yaml"
    path.write_text(f"schema: zerobeam/plan/1\n{HEADER}{postures}", encoding="utf-8")
    assert read_plan(path).header.arm.gravity_deg == 0.02
    run = read_run(demo_runs()[0].path)
    assert run.header.arm.tolerance.length_mm == 0.15
    write_run(tmp_path / "run.jsonl", run.header, run.shots)
    monkeypatch.delenv(TOLERANCES)
    again = read_run(tmp_path / "run.jsonl")
    assert again.header == run.header
    written = to_json(analyse(again, ess=100).result)["inputs"]["header"]
    assert written["geometry"]["tolerance"] == {"length_mm": 0.15, "angle_deg": 0.04}
    assert written["tool"]["sigma"] == {"shift_mm": 0.3, "tilt_deg": 0.02}


@pytest.mark.parametrize(
    ("content", "what", "line"),
    [
        ("tolerance: {length_mm: 0.1}\ngravity_dg: 0.1\n", "unknown key 'gravity_dg'", 2),
        ("tolerance:\n  length_mm: -1\n", "out of range", 2),
        ("tool_sigma: {mm: 0}\n", "out of range", 1),
        ("tolerance: [1\n", "YAML", 2),
    ],
)
def test_a_file_that_cannot_be_used_is_one_error(
    tmp_path: Path, plant: Path, content: str, what: str, line: int
) -> None:
    plant.write_text(content, encoding="utf-8")
    with pytest.raises(BadInput, match=what) as caught:
        read_header(header_file(tmp_path))
    assert (caught.value.file, caught.value.line) == (str(plant), line)
    assert TOLERANCES in (caught.value.remedy or "")


def test_a_file_that_is_not_there_is_said_where_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(TOLERANCES, str(tmp_path / "nowhere.yaml"))
    with pytest.raises(BadInput, match="no such file") as caught:
        read_header(header_file(tmp_path))
    assert caught.value.file == str(tmp_path / "nowhere.yaml")
    path = header_file(tmp_path, "geometry:\n  tolerances: other.yaml\n")
    with pytest.raises(BadInput, match="no such file") as caught:
        read_header(path)
    assert (caught.value.file, caught.value.line, caught.value.found) == (str(path), 5, "other.yaml")


def test_the_app_uses_the_plants_file_and_none_that_a_header_names_outside(
    tmp_path: Path, plant: Path
) -> None:
    """Negative control: the same file, named by a header, is outside the app's folder."""
    folder = tmp_path / "app"
    folder.mkdir()
    with confined(folder):
        assert read_header(header_file(folder)).arm.gravity_deg == 0.02
        with pytest.raises(BadInput, match="not below the app's folder"):
            read_header(header_file(folder, "geometry: {tolerances: ../plant.yaml}\n"))
