"""`zerobeam import points`: tables of trackers and measuring machines, with the joints beside them."""

import numpy as np
import pytest
from command_line import zerobeam

from zerobeam.experiments.makers.generic.points import found_order, rotations
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.kinematics.robot import rotation_about

HEADER = """\
robot: irb1600
instruments:
  tracker: {kind: tracker, sigma_mm: 0.05, reflectors: {r1: {}, r2: {}}}
  mac: {kind: pose, sigma_mm: 0.05, sigma_deg: 0.01}
noise: {joint_deg: 0.01}
"""
JOINTS = np.array([[10, -20, 30, 5, 40, 0], [-15, -25, 35, 0, 35, 20], [60, 5, -10, 80, 35, 20.0]])
POINTS = np.array([[1000.5, 20.25, 300], [900, -50, 310], [800, 10, 320.125]])
# As SpatialAnalyzer writes: each posture with two reflectors, numbered from 1, the postures in another order.
SA = """\
// SpatialAnalyzer point export
// Units: Millimeters
// Group, Point, n, X, Y, Z, Date, U-x, U-y, U-z
r1, p2, 1, 900, -50, 310, 07/14/2020 16:39:14, 0.02, 0.02, 0.02
r1, p1, 2, 1000.5, 20.25, 300, 07/14/2020 16:39:04, 0.02, 0.02, 0.02
r2, p1, 3, 1010.5, 20.25, 300, 07/14/2020 16:39:04, 0.04, 0.02, 0.02
r1, p3, 4, 800, 10, 320.125, 07/14/2020 16:39:24, 0.02, 0.02, 0.02
"""
SA_OPTIONS = ["--instrument", "tracker", "--reflector-column", "Group", "--uncertainty", "95"]
COLUMNS = ["--joint-columns", "j1,j2,j3,j4,j5,j6", "--joint-units", "deg"]


@pytest.fixture
def imported(tmp_path):
    """Import a table with options, and the joints of JOINTS numbered and timed beside it."""
    (tmp_path / "header.yaml").write_text(HEADER)
    rows = [f"{i + 1},{i * 10.0 + 4.2}," + ",".join(map(str, row)) for i, row in enumerate(JOINTS)]
    (tmp_path / "joints.csv").write_text("\n".join(["n,t,j1,j2,j3,j4,j5,j6", *rows]))
    (tmp_path / "dates.csv").write_text(
        "\n".join(
            ["t,j1,j2,j3,j4,j5,j6"]
            + [f"2020-07-14T16:39:{4 + 10 * i:02}.25," + row.split(",", 2)[2] for i, row in enumerate(rows)]
        )
    )

    def call(text, *options):
        (tmp_path / "points.txt").write_text(text, encoding="utf-8")
        run = tmp_path / "run.jsonl"
        files = ["--header", tmp_path / "header.yaml", "-o", run]
        options = [tmp_path / option if str(option).endswith(".csv") else option for option in options]
        answer = zerobeam("import", "points", tmp_path / "points.txt", *files, *COLUMNS, *options)
        if answer.status:
            assert not run.exists()
            return answer, None
        return answer, read_run(run)

    return call


NUMBERED = [
    "--joints",
    "joints.csv",
    "--match",
    "number",
    "--number-column",
    "Point",
    "--joints-number-column",
    "n",
]


def test_spatial_analyzer_by_number(imported):
    answer, run = imported(SA, *NUMBERED, *SA_OPTIONS)
    assert "mm, as the file says" in answer.out
    assert "divided by 1.96 (95 %, normal)" in answer.out
    np.testing.assert_allclose([shot.joints_deg for shot in run.shots], JOINTS[[1, 0, 0, 2]])
    np.testing.assert_allclose([shot.measured_mm for shot in run.shots[:2]], POINTS[[1, 0]])
    assert [shot.reflector for shot in run.shots] == ["r1", "r1", "r2", "r1"]
    assert run.shots[1].posture == run.shots[2].posture is not None
    assert run.shots[0].posture is None
    assert run.shots[0].sigma_mm == pytest.approx(0.02 / 1.959964)
    assert run.shots[2].sigma_mm == pytest.approx(np.sqrt(np.mean([0.04**2, 0.02**2, 0.02**2])) / 1.959964)


TIMED = ["--joints", "dates.csv", "--match", "time", "--time-column", "Date", "--joints-time-column", "t"]
TIMED += ["--time-units", "%m/%d/%Y %H:%M:%S", "--joints-time-units", "iso"]


def test_spatial_analyzer_by_time(imported):
    answer, run = imported(SA, *TIMED, "--within-s", "0.5", *SA_OPTIONS)
    assert "matched by time, 0.25 s apart at most" in answer.out
    np.testing.assert_allclose([shot.joints_deg for shot in run.shots], JOINTS[[1, 0, 0, 2]])


def test_a_point_without_joints_at_its_time(imported):
    answer, _ = imported(SA, *TIMED, "--within-s", "0.2", *SA_OPTIONS)
    assert "the nearest are 0.25 s away; 4 such points" in answer.err


# As Leica and others write: no remarks, decimal commas, semicolons, joints in the same table, metres.
COMMAS = "Name;X [m];Y [m];Z [m];j1;j2;j3;j4;j5;j6\n" + "".join(
    ";".join([f"P{i}", *(str(v).replace(".", ",") for v in (*point / 1000, *joints))]) + "\n"
    for i, (point, joints) in enumerate(zip(POINTS, JOINTS, strict=True))
)


def test_decimal_commas_and_joints_in_the_same_table(imported):
    answer, run = imported(COMMAS, "--decimal", ",", "--instrument", "tracker", "--reflector", "r1")
    assert "in m, as the file says" in answer.out
    np.testing.assert_allclose([shot.measured_mm for shot in run.shots], POINTS, atol=1e-9)
    np.testing.assert_allclose([shot.joints_deg for shot in run.shots], JOINTS)
    assert run.shots[0].sigma_mm is None


def poses(order, angles):
    """A table of POINTS with three angles, degrees."""
    rows = [",".join(map(repr, [*p, *a, *j])) for p, a, j in zip(POINTS, angles, JOINTS, strict=True)]
    return "X,Y,Z,a,b,c,j1,j2,j3,j4,j5,j6\n" + "\n".join(rows).replace("np.float64(", "").replace(")", "")


POSES = ["--instrument", "mac", "--units", "mm", "--rotation-columns", "a,b,c", "--rotation-units", "deg"]


def test_poses_by_a_stated_order(imported):
    angles = [[10, 20, 30], [0, 0, 90], [90, 0, 0]]
    _, run = imported(poses("", angles), *POSES, "--euler", "XYZ-fixed")
    half = np.sqrt(0.5)
    np.testing.assert_allclose(run.shots[1].measured_quat, [half, 0, 0, half], atol=1e-12)
    np.testing.assert_allclose(run.shots[2].measured_quat, [half, half, 0, 0], atol=1e-12)


def test_orders_are_those_of_the_axes():
    a, b, c = 0.3, -0.7, 1.1
    x, y, z = (rotation_about(axis, angle)[:3, :3] for axis, angle in zip("xyz", (a, b, c), strict=True))
    angles = np.array([[a, b, c]])
    np.testing.assert_allclose(rotations(angles, "XYZ-fixed")[0], z @ y @ x, atol=1e-15)
    np.testing.assert_allclose(rotations(angles, "XYZ-moving")[0], x @ y @ z, atol=1e-15)
    np.testing.assert_allclose(rotations(angles[:, ::-1], "ZYX-moving")[0], z @ y @ x, atol=1e-15)


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        (
            SA.replace("// Units: Millimeters\n", ""),
            [*NUMBERED, *SA_OPTIONS],
            "the unit of the coordinates is not stated",
        ),
        (SA, [*NUMBERED, *SA_OPTIONS, "--units", "inch"], "the units contradict each other"),
        (SA, [*NUMBERED, *SA_OPTIONS[:4]], "the level of the uncertainty columns is not stated"),
        (SA, ["--joints", "joints.csv", *SA_OPTIONS], "--match number or --match time"),
        (SA, [*NUMBERED[:4], *SA_OPTIONS], "4 points, 3 rows of joints"),
        (SA, [*NUMBERED[:6], *SA_OPTIONS], "only one of the tables has numbers"),
        (SA.replace("p3", "p9"), [*NUMBERED, *SA_OPTIONS], "a point has a number that no joints have"),
        (SA.replace("r2, p1", "r1, p1"), [*NUMBERED, *SA_OPTIONS], "are of the same instrument"),
        (SA.replace("r2, p1", "r5, p1"), [*NUMBERED, *SA_OPTIONS], "no such reflector of tracker"),
        (SA.replace("-50,", "lost,"), [*NUMBERED, *SA_OPTIONS], "is not a number"),
        (SA, [*TIMED, *SA_OPTIONS], "no --within-s"),
        (
            SA,
            ["--instrument", "tracker", "--reflector", "r1", "--uncertainty", "none"],
            "no column of this name",
        ),
        (poses("", [[0, 0, 0]] * 3), [*POSES], "--euler is missing"),
        (poses("", [[0, 0, 0]] * 3), [*POSES, "--euler", "XYY-fixed"], "no such order of Euler angles"),
        (poses("", [[0, 0, 0]] * 3), [*POSES, "--euler", "find"], "too few poses"),
        (poses("", [[0, 0, 0]] * 3), ["--instrument", "mac", "--units", "mm"], "'measured_quat' is missing"),
    ],
)
def test_what_is_not_stated_or_does_not_fit_is_refused_once(content, options, words, imported):
    answer, _ = imported(content, *options)
    assert answer.status == 2
    assert words in answer.err
    assert answer.err.count("error:") == 1


def made_poses(count, rng):
    """Angles, rad, about fixed x, y, z of a body on the flange, and the rotations of the flange."""
    robot = load_robot("irb1600")
    flange = robot.fk(rng.uniform(-70, 70, (count, robot.n)), "deg")[:, :3, :3]
    turn = rotations(rng.uniform(-1, 1, (2, 3)), "XYZ-fixed")
    measured = turn[0] @ flange @ turn[1]
    # R = Rz(c) Ry(b) Rx(a): the angles about fixed x, y, z.
    b = np.arcsin(-measured[:, 2, 0])
    a, c = np.arctan2(measured[:, 2, 1], measured[:, 2, 2]), np.arctan2(measured[:, 1, 0], measured[:, 0, 0])
    return np.stack([a, b, c], axis=1), flange


def test_the_order_is_that_which_fits():
    angles, flange = made_poses(40, np.random.default_rng(1))
    angles[:4] += 0.5  # wrong rows
    turned, sentence = found_order(angles, ["rx", "ry", "rz"], flange)
    np.testing.assert_allclose(turned, rotations(angles, "XYZ-fixed"))
    assert "XYZ-fixed of rx, ry, rz to" in sentence


def test_control_no_order_fits_what_does_not_belong_together(refused):
    angles, flange = made_poses(40, np.random.default_rng(1))
    assert "no order of the angles fits" in refused(found_order, angles, ["a", "b", "c"], flange[::-1]).what


UR10 = """\
schema: zerobeam/robot/1
name: ur10
convention: standard
joints:
  - {a_mm: 0, alpha_deg: 90, d_mm: 127.3, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {a_mm: -612, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {a_mm: -572.3, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {a_mm: 0, alpha_deg: 90, d_mm: 163.941, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {a_mm: 0, alpha_deg: -90, d_mm: 115.7, theta_deg: 0, lower_deg: -360, upper_deg: 360}
  - {a_mm: 0, alpha_deg: 0, d_mm: 92.2, theta_deg: 0, lower_deg: -360, upper_deg: 360}
"""


@pytest.mark.long
@pytest.mark.parametrize(("series", "count"), [("joint_configurations", 1495), ("grid_every_eighth", 1489)])
@pytest.mark.one_in(2)
def test_poses_of_a_tracker_at_a_ur10(series, count, shared_data, tmp_path):
    if not (shared_data / "ipa").is_dir():
        pytest.skip("no recordings of the UR10")
    (tmp_path / "ur10.yaml").write_text(UR10)
    tracker = "instruments: {tmac: {kind: pose, sigma_mm: 0.1, sigma_deg: 0.02}}"
    (tmp_path / "header.yaml").write_text(f"robot: ur10.yaml\n{tracker}\nnoise: {{joint_deg: 0.01}}\n")
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    joints = ",".join(f"{name}_joint" for name in names)
    position, angles = (",".join(f"measurement_{kind}{axis}" for axis in "xyz") for kind in ("", "r"))
    options = ["--joint-columns", joints, "--joint-units", "rad", "--columns", position, "--units", "mm"]
    options += ["--rotation-columns", angles, "--rotation-units", "deg", "--euler", "find", "--decimal", ","]
    files = ["--header", tmp_path / "header.yaml", "-o", tmp_path / "run.jsonl"]
    table = shared_data / "ipa" / f"{series}.csv"
    answer = zerobeam("import", "points", table, *files, *options, "--uncertainty", "none")
    assert (answer.status, answer.err) == (0, "")
    assert "the order that fits: XYZ-moving" in answer.out
    assert len(read_run(tmp_path / "run.jsonl").shots) == count


def test_copied_rows_are_one_measurement_and_said(imported):
    rows = SA.splitlines()
    answer, run = imported("\n".join([*rows, *rows[3:6]]), *SA_OPTIONS, *NUMBERED)
    assert len(run.shots) == 4
    (said,) = [line for line in answer.out.splitlines() if "copies" in line]
    assert said.startswith("note: 3 of 7 measurements are copies, such as row 8 of points.txt of row 4 of")
