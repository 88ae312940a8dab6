import numpy as np
import pytest
from cells import LASER, good_plan, header, irb1600, plan_of, random_robot, varied_postures

from zerobeam.analysis.observability.aim import aim, at_rest, moving_joints, servo_joints
from zerobeam.model.files.header import Header
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.instruments.kind import Measurement
from zerobeam.model.likelihood.problem import Problem

AWAY = {"kind": "laser", "calibrated": True, "point_mm": [10, -20, 65], "direction": [1, 0.2, -0.1]}


def near(tool=AWAY, count=6, off_deg=5.0):
    """Postures some degrees off the target, at parameters with offsets, and those parameters."""
    own = header(tool)
    robot = irb1600()
    joints = varied_postures(own, robot, (900.0, 0.0, 0.0), count, 3)
    rng = np.random.default_rng(4)
    joints = joints + np.radians(off_deg) * rng.uniform(-1, 1, joints.shape)
    problem = Problem.from_plan(plan_of(own, joints))
    x = problem.parameters.prior_mean.copy()
    x[:6] = np.radians(rng.normal(size=6))
    return problem, x


def test_the_wrist_brings_every_beam_onto_the_target():
    problem, x = near()
    aimed = aim(problem, x, servo_joints(problem))
    miss, _ = aimed.problem.linearise(x)
    assert aimed.hit.all()
    assert np.linalg.norm(miss, axis=1).max() < 1e-6
    before, _ = problem.linearise(x)
    np.testing.assert_allclose(aimed.off_mm, np.linalg.norm(before, axis=1))
    assert aimed.off_mm.min() > 1.0


def test_only_joints_with_a_weight_move():
    problem, x = near()
    aimed = aim(problem, x, servo_joints(problem))
    np.testing.assert_array_equal(aimed.problem.joints[:, :3], problem.joints[:, :3])
    assert (np.abs(aimed.problem.joints[:, 3:] - problem.joints[:, 3:]).max(axis=1) > 1e-3).all()


def test_the_turn_is_small():
    """Not just any hit: from postures a degree off, no joint turns by more than some degrees."""
    problem, x = near(off_deg=0.5)
    aimed = aim(problem, x, servo_joints(problem))
    assert np.degrees(np.abs(aimed.problem.joints - problem.joints)).max() < 15


def test_what_cannot_be_hit_is_told_and_left_best():
    problem, x = near()
    x = x.copy()
    x[6:9] = [50_000.0, 0.0, 0.0]  # no beam from behind can be turned there by joint 6 alone
    only_last = np.array([0, 0, 0, 0, 0, 1.0])
    aimed = aim(problem, x, only_last)
    assert not aimed.hit.any()
    miss, _ = aimed.problem.linearise(x)
    assert (np.linalg.norm(miss, axis=1) <= aimed.off_mm).all()


def test_a_shot_that_hits_stays_where_it_is():
    problem, x = near()
    there = aim(problem, x, servo_joints(problem)).problem
    again = aim(there, x, np.ones(6))
    np.testing.assert_allclose(again.problem.joints, there.joints, atol=1e-9)


def test_the_given_problem_is_not_changed():
    problem, x = near()
    before = problem.joints.copy()
    aim(problem, x, np.ones(6))
    np.testing.assert_array_equal(problem.joints, before)


def test_a_constant_joint_may_not_move():
    problem, _ = near()
    joints = np.random.default_rng(1).normal(size=(5, 6))
    joints[:, 1] = 0.3
    weights = moving_joints(problem.moved(joints))
    assert weights[1] == 0
    np.testing.assert_allclose(weights[[0, 2, 3, 4, 5]], joints[:, [0, 2, 3, 4, 5]].var(axis=0))


@pytest.mark.parametrize(("noises", "rest"), [(1.0, True), (4.0, False)])
def test_a_joint_that_only_its_noise_moves_is_at_rest(noises, rest):
    """Negative control: one that varies by four times its noise is not."""
    problem = Problem.from_plan(good_plan(8))
    joints = problem.joints.copy()
    jitter = np.random.default_rng(1).normal(size=len(joints))
    joints[:, 0] = 0.3 + noises * problem.noise.joint[0] * jitter / jitter.std()
    result = at_rest(problem.moved(joints))
    assert result[0] == rest
    assert not result[1:].any()


@pytest.mark.parametrize("kinds", ["rprrr", "pprrr", "rrrp"])
def test_prismatic_joints_help_too(kinds):
    robot = random_robot(kinds, 8)
    own = header({"kind": "probe", "calibrated": True, "point_mm": [10, 20, 150]}, noise={"joint_mm": 0.02})
    rng = np.random.default_rng(2)
    joints = rng.uniform(-0.5, 0.5, (4, robot.n)) * np.where(robot.display > 1, 1.0, 200.0)
    problem = Problem.build(own, robot, joints, ["psd"] * 4)
    x = problem.parameters.prior_mean.copy()
    # A place that the tip reaches from the first posture; some of the others can get there as well.
    x[robot.n : robot.n + 3] = problem.moved(joints[:1]).beams(x)[0][0]
    aimed = aim(problem, x, np.ones(robot.n))
    assert aimed.off_mm[0] == pytest.approx(0, abs=1e-9)
    assert aimed.hit.sum() >= 2
    slides = robot.display == 1
    moved = np.abs(aimed.problem.joints - joints)[aimed.hit][:, slides]
    assert moved.max() > 1.0


MIX = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "instruments": {
        "leica": {
            "kind": "tracker",
            "guess_mm": [3000, 500, 800],
            "reflectors": {"R1": {}},
            "sigma_mm": 0.03,
        },
        "bar": {"kind": "ballbar", "sigma_mm": 0.01, "tip_mm": [0, 0, 60]},
    },
    "noise": {"joint_deg": 0.005, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": [900, 0, 0]}, "socket": {"guess_mm": [700, 200, 100]}},
}


def mixed(parts, postures):
    measured = [[Measurement(*part, {})] for part in parts]
    header = Header.model_validate(MIX)
    return Problem.of_measured(header, load_robot("irb1600"), postures, measured, planned=True)


def test_in_a_mix_each_shot_is_turned_as_its_instrument_alone_turns_it():
    """The laser's by the wrist, although other instruments are in the run; a tracker's, which reads anywhere,
    by nothing."""
    rng = np.random.default_rng(0)
    beam = varied_postures(header(LASER, target=(900, 0, 0)), load_robot("irb1600"), (900, 0, 0), 5, 0)
    beam = beam + rng.normal(size=beam.shape) * 0.02
    others = rng.uniform(-0.5, 0.5, (3, 6))
    laser, tracker = ("tool", "", "psd"), ("leica", "R1", None)
    mix = mixed([laser] * 5 + [tracker] * 3, np.concatenate([beam, others]))
    alone = mixed([laser] * 5, beam)
    both, one = (aim(each, each.nominal(), servo_joints(each)) for each in (mix, alone))
    assert both.hit.all()
    assert one.hit.all()
    turned = np.abs(both.problem.joints - mix.joints)
    assert turned[:5, :3].max() == 0
    assert turned[:5, 3:].max() > 1e-3
    assert turned[5:].max() == 0
    np.testing.assert_allclose(both.problem.joints[:5], one.problem.joints, atol=1e-12)


def test_beside_a_laser_what_touches_is_led_by_the_whole_arm():
    weights = servo_joints(mixed([("tool", "", "psd"), ("bar", "", "socket")], np.zeros((2, 6))))
    np.testing.assert_array_equal(weights, [[0, 0, 0, 1, 1, 1], [1, 1, 1, 1, 1, 1]])
