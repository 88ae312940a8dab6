"""The region of the TCP's error in a header: what may be stated, and postures of the user's own programs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from exact_runs import demo_runs

import zerobeam as zb
from zerobeam.analysis.tcp_region import region_of, region_postures
from zerobeam.model.errors import BadInput
from zerobeam.model.files.measurements import read_header
from zerobeam.model.files.plan import read_plan, write_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run, write_run
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.outlook_words import region_words

HEADER = """\
robot: {robot}
tool: {{kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}}
noise: {{joint_deg: 0.01, joint_mm: 0.01, spot_mm: 0.05}}
workspace: {workspace}
"""
ROWS = np.array([[10.0, 20, -30, 5, 60, 0], [-15, 25, -35, 0, 70, 90], [0, 5, 10, 20, 30, 40]])


def read(folder: Path, workspace: str, robot: str = "irb1600") -> zb.Header:
    path = folder / "header.yaml"
    text = HEADER.format(robot=robot, workspace=workspace)
    path.write_text(text.replace("joint_mm: 0.01, ", "" if robot == "irb1600" else "joint_mm: 0.01, "))
    return read_header(path)


def table(folder: Path, text: str, name: str = "cell.csv") -> None:
    (folder / name).write_text(text, encoding="utf-8")


def problem(header: zb.Header) -> Problem:
    return Problem.build(header, load_robot("irb1600", Path()), np.radians(ROWS), ["psd"] * len(ROWS))


@pytest.mark.parametrize(
    ("workspace", "words"),
    [
        ("{}", "in the central 70 % of the joints\u2019 ranges"),
        ("{joints: full}", "over the full joint ranges"),
        (
            "{box_mm: [[600, -300, 200], [1000, 300, 800.5]], joints: full}",
            "in the box x 600 to 1000, y \u2212300 to 300, z 200 to 800.5 mm, over the full joint ranges",
        ),
        ("{positions: cell.csv, units: deg}", "over the 3 postures of cell.csv"),
    ],
)
def test_each_region_has_a_name_and_its_postures(workspace: str, words: str, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "cell.csv", ROWS, delimiter=";")
    header = read(tmp_path, workspace)
    assert region_words(region_of(header.workspace)) == words
    own = problem(header)
    joints, robot = region_postures(own, 256), own.robot
    share = (joints - robot.lower) / (robot.upper - robot.lower)
    if "positions" in workspace:
        np.testing.assert_allclose(np.degrees(joints), ROWS)
        return
    assert len(joints) == 256
    least = 0.15 if "full" not in workspace else 0.0
    assert (share >= least).all()
    assert (share <= 1 - least).all()
    if "box" in workspace:
        tcp = robot.fk(joints, "rad") @ np.array([0, 0, 65, 1])
        assert (tcp[:, :3] >= [600, -300, 200]).all()
        assert (tcp[:, :3] <= [1000, 300, 800.5]).all()
    else:
        assert share[:, 1].max() > 0.99 - least
        assert np.abs(np.degrees(joints[:, 0])).max() > (89 if least else 175)
        assert np.abs(np.degrees(joints[:, 0])).max() <= (90 if least else 180)


def test_postures_are_the_same_in_each_form(tmp_path: Path) -> None:
    """Degrees, radians, with a header row, a plan and a run."""
    np.savetxt(tmp_path / "deg.csv", ROWS, delimiter=",")
    np.savetxt(tmp_path / "rad.csv", np.radians(ROWS), delimiter=",", header="a,b,c,d,e,f", comments="")
    plain = read(tmp_path, "{}").model_copy(update={"targets": {}})
    write_plan(tmp_path / "work.yaml", plain, ROWS, ["psd"] * 3)
    run = zb.Run.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        joints=ROWS,
        unit="deg",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        workspace={"positions": str(tmp_path / "deg.csv"), "units": "deg"},
    )
    run.write(tmp_path / "work.jsonl")
    for name in ("deg.csv, units: deg", "rad.csv, units: rad", "work.yaml", "work.jsonl"):
        found = read(tmp_path, f"{{positions: {name}}}").workspace
        np.testing.assert_allclose(found.postures_deg, ROWS, atol=1e-9)
    np.testing.assert_allclose(run.header.workspace.postures_deg, ROWS, atol=1e-9)


def test_a_plan_and_a_run_hold_the_postures_themselves(tmp_path: Path) -> None:
    """Written elsewhere, and the file gone: they mean the same."""
    np.savetxt(tmp_path / "cell.csv", ROWS, delimiter=",")
    header = read(tmp_path, "{positions: cell.csv, units: deg}")
    (tmp_path / "cell.csv").unlink()
    below = tmp_path / "below"
    below.mkdir()
    write_plan(below / "plan.yaml", header, ROWS, ["psd"] * 3)
    assert read_plan(below / "plan.yaml").header.workspace == header.workspace
    run = read_run(demo_runs()[0].path)
    own = run.header.model_copy(update={"workspace": header.workspace})
    write_run(below / "run.jsonl", own, run.shots)
    assert read_run(below / "run.jsonl").header.workspace == header.workspace
    # They are checked against the robot again.
    text = (below / "run.jsonl").read_text()
    first, _, rest = text.partition("\n")
    content = json.loads(first)
    content["workspace"]["postures_deg"][1][2] = 999.0
    (below / "run.jsonl").write_text(json.dumps(content) + "\n" + rest)
    with pytest.raises(BadInput, match="posture 1: joint 3 is outside its limits"):
        read_run(below / "run.jsonl")


@pytest.mark.parametrize(
    ("workspace", "text", "message"),
    [
        ("{positions: cell.csv}", "1,2,3,4,50,6", "the unit of the angles .* is not stated"),
        ("{positions: cell.csv, units: deg}", "1,2,3,4,50", "wrong number of values"),
        ("{positions: cell.csv, units: deg}", "a,b,c\n1,2,50", "not just the joints"),
        ("{positions: cell.csv, units: deg}", "1,2,300,4,50,6", "positions, row 1: joint 3 is outside"),
        ("{positions: cell.csv, units: deg}", "1,2,x,4,50,6", "column 3 is not a number"),
        ("{positions: cell.csv, units: deg}", "1,2,nan,4,50,6", "not a finite number"),
        ("{positions: cell.csv, units: deg}", "", "empty"),
        ("{positions: cell.csv, units: deg}", "a,b,c,d,e,f\n", "a header row only"),
        ("{positions: cell.csv, units: deg}", "0.1,0.2,0.3,0.4,0.5,0.6", "look like radians"),
        ("{positions: cell.csv, units: deg}", "1,2,3,4,50,6\n" * 1001, "not the right number of postures"),
        ("{positions: other.csv, units: deg}", "1,2,3,4,50,6", "there is no such file"),
        ("{positions: cell.yaml, units: deg}", "", "says its unit itself"),
        ("{positions: cell.csv, units: deg, joints: full}", "", "together with a file of positions"),
        ("{units: deg}", "", "without a file of positions"),
        ("{box_mm: [[1, 1, 1], [2, 1, 2]]}", "", "box_mm is empty"),
        ("{joints: all}", "", "workspace.joints"),
    ],
)
def test_bad_regions_are_refused_with_one_error(
    workspace: str, text: str, message: str, tmp_path: Path
) -> None:
    table(tmp_path, text)
    with pytest.raises(BadInput, match=message) as refused:
        read(tmp_path, workspace)
    assert refused.value.file is not None


def test_a_box_out_of_reach_is_refused(tmp_path: Path) -> None:
    header = read(tmp_path, "{box_mm: [[5000, 0, 0], [5100, 100, 100]]}")
    with pytest.raises(BadInput, match=r"hardly any posture whose TCP is in workspace\.box_mm"):
        region_postures(problem(header), 256)
