"""The parts of a simulated cell: the arm; what is stated is the truth, what is not suits the plan."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cells import OPEN_LASER, PROBE, good_plan, header, irb1600, plan_of
from plain_model import MODIFIED, arm
from scipy import stats

from zerobeam.analysis.observability.aim import aim, servo_joints
from zerobeam.experiments.rigs.simulated.assembly import CellParts, SimulatedArm, assemble, geometry_errors
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.robot import Robot, rotation_about, same_arm, shift
from zerobeam.model.likelihood.problem import Problem

HOME = np.radians([10.0, -20.0, 30.0, 40.0, -50.0, 60.0])
OFFSETS = np.radians([0.0, -1.2, -0.7, 0.1, 0.01, -0.04])


def simulated(
    robot: Robot | None = None,
    *,
    offsets: np.ndarray | None = None,
    backlash: float = 0.0,
    resolution: float = 0.0,
    repeatability: float = 0.0,
    speed: float = 0.25,
    acceleration: float = 5.0,
    redraw: float = np.radians(2.0),
    at: np.ndarray = HOME,
    seed: int = 0,
) -> SimulatedArm:
    robot = robot or irb1600()
    each = np.ones(robot.n)
    own = SimulatedArm(
        robot,
        np.zeros(robot.n) if offsets is None else offsets,
        backlash * each,
        resolution * each,
        repeatability * each,
        speed,
        acceleration * each,
        redraw,
    )
    own.begin(np.random.default_rng(seed), at)
    return own


def only(joint: int, by: float, n: int = 6) -> np.ndarray:
    return by * np.eye(n)[joint]


def test_without_error_the_links_are_off_by_the_offsets_alone() -> None:
    """True = recorded + delta, as in the run's model."""
    own = simulated(offsets=OFFSETS)
    for joints in np.random.default_rng(1).uniform(-1, 1, (20, 6)):
        own.move(joints)
        assert (own.read() == joints).all()
        assert (own.link() == own.read() + OFFSETS).all()


def test_the_arm_stands_on_counts_of_its_encoders() -> None:
    step = np.radians(0.01)
    own = simulated(resolution=step)
    off = []
    for joints in np.random.default_rng(2).uniform(-1, 1, (20, 6)):
        own.move(joints)
        np.testing.assert_allclose(own.read() / step, np.round(own.read() / step), atol=1e-9)
        assert (own.link() == own.read()).all()
        off.append(np.abs(own.read() - joints).max())
    assert 0.3 * step < max(off) <= 0.5 * step * (1 + 1e-9)
    # A command of less than half a step moves nothing, and takes no time.
    own.move(np.zeros(6))
    assert own.move(np.full(6, 0.4 * step)) == 0.0
    assert (own.read() == 0).all()


def test_backlash_shows_between_the_two_ways_of_coming() -> None:
    width = np.radians(0.02)
    own = simulated(offsets=OFFSETS, backlash=width)
    own.move(HOME - 0.01)
    own.move(HOME)
    below = own.link()
    own.move(HOME + 0.01)
    own.move(HOME)
    above = own.link()
    np.testing.assert_allclose(above - below, width, rtol=1e-9)
    # The link lags: it has not come as far as its count.
    np.testing.assert_allclose(below - own.read() - OFFSETS, -width / 2, rtol=1e-9)


def test_a_joint_that_stays_keeps_its_side_of_the_backlash() -> None:
    width = 1e-3
    own = simulated(backlash=width)
    own.move(HOME - 0.01)
    own.move(HOME - 0.01 + only(2, 0.005))
    np.testing.assert_allclose(own.link() - own.read(), width / 2 * np.array([1, 1, -1, 1, 1, 1]), atol=1e-12)


def test_the_static_error_stays_while_the_arm_moves_little() -> None:
    """Twenty moves of 0.09 degrees are within 2 degrees of travel; three more are not."""
    own = simulated(repeatability=1e-4)
    error = own.link() - own.read()
    assert (error != 0).all()
    step = np.radians(0.09)
    for i in range(20):
        # Joints take turns, and go to and fro: the travel counts, not the distance.
        own.move(own.read() + only(i % 6, step * (-1) ** i))
        np.testing.assert_allclose(own.link() - own.read(), error, atol=1e-15)
    for _ in range(3):
        own.move(own.read() + only(0, step))
    assert (np.abs(own.link() - own.read() - error) > 1e-12).all()


def test_the_joint_that_goes_farthest_counts_as_travel() -> None:
    """All six by 0.5 degrees are half a degree of travel, not three; a prismatic joint's mm is a degree."""
    own = simulated(repeatability=1e-4)
    error = own.link() - own.read()
    own.move(HOME + np.radians(0.5))
    np.testing.assert_allclose(own.link() - own.read(), error, atol=1e-15)
    gantry = arm("gantry", Path()).robot
    for way, stays in ((1.9, True), (2.1, False)):
        own = simulated(gantry, repeatability=1e-4, at=np.zeros(4))
        error = own.link() - own.read()
        own.move(only(0, way, 4))
        assert np.allclose(own.link() - own.read(), error, atol=1e-12) == stays


def test_static_errors_are_as_large_as_stated_and_independent() -> None:
    """2,000 draws of six joints: chi-squared, normal, and correlations within 4 / sqrt(2,000)."""
    size, draws = 2e-4, 2000
    own = simulated(repeatability=size)
    errors = np.empty((draws, 6))
    for i in range(draws):
        own.move(HOME + np.radians(5.0) * (i % 2))
        errors[i] = (own.link() - own.read()) / size
    low, high = stats.chi2.ppf([0.0005, 0.9995], draws)
    for joint in errors.T:
        assert low < (joint**2).sum() < high
        assert abs(np.corrcoef(joint[1:], joint[:-1])[0, 1]) < 4 / np.sqrt(draws)
    assert stats.kstest(errors.reshape(-1), "norm").pvalue > 1e-3
    between = np.corrcoef(errors.T) - np.eye(6)
    assert np.abs(between).max() < 4 / np.sqrt(draws)


def test_what_follows_a_beginning_depends_on_it_alone() -> None:
    def links(own: SimulatedArm, seed: int) -> np.ndarray:
        own.begin(np.random.default_rng(seed), HOME)
        found = [own.link()]
        for joints in np.random.default_rng(9).uniform(-0.02, 0.02, (12, 6)):
            own.move(HOME + joints)
            found.append(own.link())
        return np.array(found)

    fresh = simulated(backlash=1e-3, resolution=1e-6, repeatability=1e-4)
    used = simulated(backlash=1e-3, resolution=1e-6, repeatability=1e-4, seed=5)
    for i in range(7):
        used.move(HOME - 0.01 * i)
    assert (links(fresh, 3) == links(used, 3)).all()
    assert (links(fresh, 3) != links(fresh, 4)).any()


def test_a_reading_is_not_the_arm_itself() -> None:
    """A glitch that a rig puts on a reading does not move the arm."""
    own = simulated()
    own.read()[2] += 1.0
    assert (own.read() == HOME).all()


def test_the_profile_integrates_to_the_way() -> None:
    """Speed ramped up, held and ramped down over the time stated, summed numerically, covers the way."""
    own = simulated()
    for way in (0.003, 0.1, 2.0):
        seconds = own.duration(only(0, way))
        t = (np.arange(200_000) + 0.5) / 200_000 * seconds
        v = np.minimum(np.minimum(5.0 * t, 5.0 * (seconds - t)), 0.25 * np.radians(150))
        assert v.mean() * seconds == pytest.approx(way, rel=1e-6)


def test_the_slowest_joint_sets_the_time() -> None:
    own = simulated()
    way = np.array([0.5, -0.2, 0.9, 0.1, 1.4, -1.6])
    alone = [own.duration(only(i, way[i])) for i in range(6)]
    assert own.duration(way) == max(alone)
    # Joint 3 of 0.9 rad at 170 deg/s, not joint 6 of 1.6 rad at 460 deg/s.
    assert int(np.argmax(alone)) == 2


def test_top_speeds_that_the_robot_file_does_not_state() -> None:
    """1 rad/s for a revolute joint, 1000 mm/s for a prismatic one."""
    robot = arm("gantry", Path()).robot
    assert all(joint.speed is None for joint in robot.joints)
    own = simulated(robot, speed=0.5, acceleration=1e6, at=np.zeros(4))
    assert own.duration(only(0, 250.0, 4)) == pytest.approx(250 / 500, rel=2e-3)
    assert own.duration(only(1, 2.0, 4)) == pytest.approx(2.0 / 0.5, rel=1e-5)


def pose(robot: Robot, joints: np.ndarray) -> np.ndarray:
    theta = ca.SX.sym("theta", robot.n)
    rotation, translation = ca.Function("pose", [theta], list(robot.flange_pose(theta)))(joints)
    return np.hstack([np.array(rotation), np.array(translation)])


def modified(rows: Sequence[tuple[float, ...]]) -> Robot:
    given = arm("modified", Path()).robot
    rad = [DHRow(a, np.radians(alpha), d, np.radians(theta)) for a, alpha, d, theta in rows]
    fixed, flange = dh_chain(rad, "modified")
    joints = tuple(dataclasses.replace(j, fixed=f) for j, f in zip(given.joints, fixed, strict=True))
    return dataclasses.replace(given, joints=joints, flange=flange)


def test_an_error_of_a_link_is_one_of_its_dh_row() -> None:
    """Craig's row ends in Rz(theta) Tz(d): a turn and a shift along z behind it are errors of theta and d."""
    drawn = modified(MODIFIED)
    a, alpha, d, theta = MODIFIED[2]
    other = modified([*MODIFIED[:2], (a, alpha, d + 0.3, theta + 0.2), *MODIFIED[3:]])
    error = rotation_about("z", np.radians(0.2)) @ shift(z=0.3)
    joints = np.random.default_rng(3).uniform(-1, 1, 6)
    true = geometry_errors(drawn, {2: error})
    np.testing.assert_allclose(pose(true, joints), pose(other, joints), atol=1e-9)
    # The same error on another link is another arm, and the drawn one is as it was.
    assert np.abs(pose(geometry_errors(drawn, {3: error}), joints) - pose(other, joints)).max() > 0.01
    np.testing.assert_allclose(pose(drawn, joints), pose(modified(MODIFIED), joints), atol=0)
    assert np.abs(pose(drawn, joints) - pose(true, joints)).max() > 0.1


def parts(plan: Plan, seed: int = 0, **content: Any) -> CellParts:
    return assemble(plan, CellFile.model_validate(content), np.random.default_rng(seed))


def test_offsets_are_drawn_or_as_stated() -> None:
    plan = good_plan(3)
    drawn = parts(plan)
    assert (drawn.arm.offsets[1:] != 0).all()
    assert drawn.arm.offsets[0] == 0  # held: it is the base frame
    np.testing.assert_allclose(
        parts(plan, arm={"drawn_deg": 3}).arm.offsets, 3 * drawn.arm.offsets, rtol=1e-12
    )
    stated = parts(plan, arm={"offsets_deg": {"delta2": -1.2, "delta1": 0.5}})
    np.testing.assert_allclose(np.degrees(stated.arm.offsets), [0.5, -1.2, 0, 0, 0, 0])
    told = stated.provenance()
    assert told["true delta2 (deg)"] == -1.2
    assert told["true delta1 (deg)"] == 0.5
    assert told["true delta3 (deg)"] == 0.0


def test_what_is_stated_changes_nothing_of_what_is_drawn() -> None:
    """The cell of a seed is the same cell but for what is said of it."""
    plan = good_plan(3, tool=OPEN_LASER)
    drawn = parts(plan)
    offsets = parts(plan, arm={"offsets_deg": {}})
    np.testing.assert_array_equal(offsets.tool, drawn.tool)
    np.testing.assert_array_equal(offsets.centres["psd"], drawn.centres["psd"])
    tilted = parts(plan, laser={"tilt_deg": [0, 0]})
    np.testing.assert_array_equal(tilted.arm.offsets, drawn.arm.offsets)
    np.testing.assert_array_equal(tilted.tool[2:], drawn.tool[2:])


def test_a_calibrated_tool_is_as_stated_but_where_the_cell_says_otherwise() -> None:
    plan = good_plan(3)
    assert not parts(plan).tool.any()
    assert [name for name in parts(plan).provenance() if "tool" in name] == []
    off = parts(plan, laser={"tilt_deg": [0.1, -0.2], "shift_mm": [0.3, 0.4]})
    np.testing.assert_allclose(off.tool, [*np.radians([0.1, -0.2]), 0.3, 0.4])
    told = {name: value for name, value in off.provenance().items() if "tool" in name}
    assert told == {
        "true tool.tilt1 (deg)": 0.1,
        "true tool.tilt2 (deg)": -0.2,
        "true tool.shift1 (mm)": 0.3,
        "true tool.shift2 (mm)": 0.4,
    }


def test_the_provenance_of_an_uncalibrated_tool_is_what_the_beam_is() -> None:
    plan = good_plan(3, tool=OPEN_LASER)
    half = parts(plan, laser={"shift_mm": [0.3, 0.4]})
    told = half.provenance()
    assert (told["true tool.shift1 (mm)"], told["true tool.shift2 (mm)"]) == (0.3, 0.4)
    tilts = [told["true tool.tilt1 (deg)"], told["true tool.tilt2 (deg)"]]
    assert all(tilts)
    np.testing.assert_allclose(np.degrees(half.tool[:2]), tilts, atol=1e-9)


@pytest.mark.parametrize("geometry", ["exact", None])
def test_the_truth_is_where_the_true_beam_hits(geometry: str | None) -> None:
    """At the truth's own parameters the model's beams go through the cell's PSD: offsets, links, gravity,
    harmonics, tool and place."""
    plan = good_plan(3, tool=OPEN_LASER, geometry=geometry)
    made = parts(plan, laser={"shift_mm": [3, 4]}, psd={"placed": {"psd": {"centre_mm": [930, 20, -10]}}})
    aimed = aim(made.truth.problem, made.truth.x, servo_joints(made.truth.problem)).problem
    bent = np.array([made.arm.bent(count) for count in aimed.joints])
    still = np.zeros(6)

    def off(link: Matrix) -> float:
        origin, direction = made.functions.kernel("beam")(link, still, made.tool)
        return float(np.linalg.norm(np.cross(made.centres["psd"] - origin, direction), axis=1).max())

    assert off(aimed.joints + made.arm.offsets + bent) < 1e-5
    # Control: what bends the arm is seen.
    assert (off(aimed.joints + made.arm.offsets) > 0.05) == (geometry is None)
    np.testing.assert_array_equal(made.centres["psd"], [930, 20, -10])


def test_an_arm_deviates_as_the_header_says_or_as_the_cell_states() -> None:
    def links(made: CellParts) -> dict[str, float]:
        return {name: value for name, value in made.provenance().items() if "true link" in name}

    typical = good_plan(3, geometry=None)
    drawn = parts(typical)
    assert drawn.provenance()["true link2.a (mm)"] != 0
    assert drawn.provenance()["true joint3.gravity (deg)"] != 0
    assert parts(typical).provenance() == drawn.provenance()
    assert links(parts(typical, 1)) != links(drawn)
    # Of a tenth of the tolerances it is a tenth.
    small = good_plan(3, geometry={"tolerance": {"length_mm": 0.03, "angle_deg": 0.01}})
    assert [10 * value for value in links(parts(small)).values()] == pytest.approx(
        list(links(drawn).values())
    )
    for nominal in (parts(good_plan(3)), parts(typical, arm={"geometry": []})):
        assert links(nominal) == {}
        np.testing.assert_array_equal(nominal.arm.robot.flange, typical.robot.flange)
        np.testing.assert_array_equal(nominal.arm.bent(np.ones(6)), np.zeros(6))
    # The arm of another run is that arm.
    values = {name: item for name, item in drawn.truth.values().items() if name != "delta2"}
    same = assemble(typical, CellFile(), np.random.default_rng(5), values)
    np.testing.assert_allclose(same.arm.bent(np.ones(6)), drawn.arm.bent(np.ones(6)), atol=1e-9)
    assert links(same) == links(drawn)
    # One of which no links are known had none: it was recorded before there were any.
    assert links(assemble(typical, CellFile(), np.random.default_rng(5), {"delta2": 0.1})) == {}


def test_a_psd_stands_near_the_plans_guess_or_where_it_is_said_to() -> None:
    near = parts(good_plan(3)).centres["psd"]
    assert 0 < np.linalg.norm(near - [900, 0, 0]) < 100
    sure = plan_of(header(targets={"psd": {"guess_mm": [900, 0, 0], "sigma_mm": 0.5}}), good_plan(3).postures)
    np.testing.assert_allclose((parts(sure).centres["psd"] - [900, 0, 0]) * 40, near - [900, 0, 0])


def test_a_face_looks_at_its_beams_where_one_way_serves_them_all() -> None:
    plan = good_plan(5)
    problem = Problem.from_plan(plan)
    aimed = aim(problem, problem.nominal(), servo_joints(problem)).problem
    _, directions = aimed.beams(problem.nominal())
    normal = parts(plan).psds["psd"].normal
    assert normal is not None
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert (-directions @ normal >= np.cos(np.radians(70)) - 1e-12).all()
    # With the flange turned half round the beam comes from the other side: no face serves both.
    first = plan.postures[0]
    both = plan_of(
        plan.header, np.array([first, first - np.sign(first[5]) * np.array([0, 0, 0, 0, 0, np.pi])])
    )
    assert parts(both).psds["psd"].normal is None
    stated = parts(plan, psd={"placed": {"psd": {"normal": [0, 0, 5]}}}).psds["psd"].normal
    np.testing.assert_array_equal(stated, [0, 0, 1])
    assert parts(plan, psd={"placed": {"psd": {"normal": "beam"}}}).psds["psd"].normal is None


def test_arms_are_the_same_by_their_links_not_by_their_names() -> None:
    arm = irb1600()
    assert same_arm(arm, replace(arm, name="another"))
    assert not same_arm(arm, replace(arm, joints=arm.joints[:-1]))
    moved = arm.flange.copy()
    moved[2, 3] += 0.1
    assert not same_arm(arm, replace(arm, flange=moved))
    for change in (
        {"axis": np.array([1.0, 0, 0])},
        {"kind": "prismatic"},
        {"fixed": arm.joints[2].fixed @ moved},
    ):
        joints = (*arm.joints[:2], replace(arm.joints[2], **change), *arm.joints[3:])
        assert not same_arm(arm, replace(arm, joints=joints))


def test_a_probe_has_no_simulated_cell(refused: Callable[..., BadInput]) -> None:
    assert "tool is a probe" in str(refused(parts, good_plan(3, tool=PROBE)))
