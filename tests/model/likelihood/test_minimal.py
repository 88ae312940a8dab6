"""The geometry is minimal: with all of it free, the data leave nothing open but the gauges that are held."""

import numpy as np
import pytest

from zerobeam.analysis.observability.aim import aim
from zerobeam.model.files.header import Header
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.geometry import Geometry
from zerobeam.model.likelihood.problem import Problem

TARGETS, SHOTS = 3, 30  # of each target
LASER = {"kind": "laser", "calibrated": False, "point_mm": [5, -3, 65], "direction": [1, 0.2, 0.1]}
PROBE = {"kind": "probe", "calibrated": False, "point_mm": [15, -10, 120]}
NULL, FULL = 1e-11, 1e-8  # of singular values, columns of unit length: what is null, what is not
KINDS = {"r": "revolute", "p": "prismatic"}


def robot_of(seed, kinds):
    rng = np.random.default_rng(seed)
    turns = rng.uniform(30, 150, len(kinds)) * rng.choice([-1, 1], len(kinds))
    rows = [
        DHRow(rng.uniform(50, 400), np.radians(twist), rng.uniform(-200, 400), rng.uniform(-2, 2))
        for twist in turns
    ]
    fixed, flange = dh_chain(rows, "standard")
    limits = {"r": (-np.pi, np.pi), "p": (-500.0, 500.0)}
    joints = [
        Joint(f"j{i}", KINDS[kind], fixed[i], np.array([0.0, 0, 1]), *limits[kind])
        for i, kind in enumerate(kinds)
    ]
    return Robot(f"random{seed}", tuple(joints), flange)


def problem_of(robot, tool, distances=True):
    """Measurements that hit at parameters x near the nominal ones, links deviating too."""
    rng = np.random.default_rng(11)
    content = {"robot": "x", "tool": tool, "geometry": {"gravity": False, "harmonics": False}}
    content["noise"] = {"joint_deg": 0.01, "joint_mm": 0.01, "spot_mm": 0.05}
    if distances:
        content["distances"] = [{"between": ["t0", "t1"], "mm": 500, "sigma_mm": 0.01}]
    names = [f"t{k}" for k in range(TARGETS)]
    observed = [name for name in names for _ in range(8 * SHOTS)]
    start = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper, (len(observed), robot.n))
    problem = Problem.build(Header.model_validate(content), robot, start, observed)
    x = problem.parameters.prior_mean.copy()
    columns = np.flatnonzero(problem.parameters.group("geometry"))
    x[columns] = rng.normal(size=len(columns)) * problem.parameters.prior_std[columns]
    origin, along = problem.beams(x)
    for k in range(TARGETS):
        i = k * 8 * SHOTS
        x[problem.parameters.block("target", k)] = origin[i] + 700 * along[i]
    result = aim(problem, x, np.ones(robot.n))
    rows = [np.flatnonzero(result.hit & (problem.target_index == k))[:SHOTS] for k in range(TARGETS)]
    assert all(len(columns) == SHOTS for columns in rows)
    return result.problem.select(np.concatenate(rows)), x


def singular_values(problem, x, free):
    jacobian = problem.whiten(x).jacobian[:, free]
    length = np.linalg.norm(jacobian, axis=0)
    return np.linalg.svd(jacobian / np.where(length > 0, length, 1.0), compute_uv=False)


def nulls(problem, x, free):
    """How many directions of the parameters `free` (p,) the data leave open; none may be in between."""
    values = singular_values(problem, x, free)
    assert not ((values > NULL * values[0]) & (values < FULL * values[0])).any(), values
    return int((values <= NULL * values[0]).sum())


@pytest.mark.parametrize("tool", [LASER, PROBE], ids=["laser", "probe"])
@pytest.mark.parametrize(("seed", "kinds"), [(1, "rrrrr"), (2, "rrrrrr"), (3, "rrrrrrr")])
@pytest.mark.one_in(3)
def test_nothing_is_left_open_and_each_gauge_that_is_held_is_one(seed, kinds, tool):
    """Of 4 r numbers those are held that move base or tool: each of them, freed, is one more direction."""
    problem, x = problem_of(robot_of(seed, kinds), tool)
    parameters, n = problem.parameters, len(kinds)
    # Of a free probe tip the last offset is a gauge that the method frees: the tip turns with it.
    expected = int(tool["kind"] == "probe")
    assert nulls(problem, x, parameters.free) == expected
    held = {item.name: item.held_by for item in parameters.items if item.held}
    last = {f"link{n}.{axis}": "free tool" for axis in ("a", "b", "d", "alpha", "beta")}
    values = {"delta1": "base frame", "link1.d": "first link", **last}
    if not expected:
        values[f"delta{n}"] = "tool rotation"
    assert held == values
    for name in held:
        free = parameters.free.copy()
        free[parameters.index(name)] = True
        assert nulls(problem, x, free) == expected + 1, name
    # All at once they are as many.
    assert nulls(problem, x, np.ones(len(parameters), dtype=bool)) == expected + len(held)
    geometry = [item.name for item in parameters.items if item.group == "geometry"]
    assert len(geometry) == 3 * n + 2  # the last link is whole


@pytest.mark.long
def test_without_a_distance_the_data_leave_the_scale_open():
    """All lengths longer by one factor, the targets' places and the tip's too: the tolerances alone tell."""
    for tool, expected in ((LASER, 0), (PROBE, 1)):
        problem, x = problem_of(robot_of(1, "rrrrr"), tool, distances=False)
        assert nulls(problem, x, problem.parameters.free) == expected + 1
    transforms = [*(joint.fixed for joint in problem.robot.joints[1:]), problem.robot.flange]
    longer = np.zeros(len(x))
    for k, item in enumerate(problem.parameters.items):
        if item.group in ("target", "tool") or item.axis == "b":
            longer[k] = x[k]
        elif item.axis in ("a", "d"):
            fixed = transforms[int(item.of.removeprefix("link")) - 1]
            # Rz Tz(d) Tx(a) Rx: the nominal lengths are those of the transform; a of the rows is positive.
            longer[k] = x[k] + (np.hypot(*fixed[:2, 3]) if item.axis == "a" else fixed[2, 3])
    jacobian = problem.whiten(x).jacobian / problem.parameters.prior_std
    assert np.abs(jacobian @ longer).max() < 1e-6
    longer[problem.parameters.index("link2.a")] *= 1.001  # negative control
    assert np.abs(jacobian @ longer).max() > 1e-2


def test_what_moves_with_the_targets_is_held_behind_a_slide_too():
    """A first joint that slides has no place, only a direction: what shifts or turns about it is a gauge."""
    for seed, kinds, held in (
        (4, "prrrr", {"link1.a", "link1.theta", "link2.d"}),
        (5, "pprrrr", {"link1.theta", "link2.a", "link3.d"}),
    ):
        problem, x = problem_of(robot_of(seed, kinds), LASER)
        parameters = problem.parameters
        base = {i.name for i in parameters.items if i.group == "geometry" and i.held_by == "first link"}
        assert base == held
        # The second slide's offset moves with the targets: it is free, and told to be a gauge.
        expected = kinds.count("p") - 1
        assert nulls(problem, x, parameters.free) == expected
        for name in held:
            free = parameters.free.copy()
            free[parameters.index(name)] = True
            assert nulls(problem, x, free) == expected + 1, name


def test_slides_further_on_leave_nothing_open():
    problem, x = problem_of(robot_of(6, "rrprrr"), LASER)
    assert nulls(problem, x, problem.parameters.free) == 0
    assert len(Geometry.of_links(problem.robot, 0.3, 0.1).names) == 3 + 1 + 3 + 3 * 3 + 2


@pytest.mark.parametrize("tool", [LASER, PROBE], ids=["laser", "probe"])
@pytest.mark.at_length(r"^probe")
def test_a_whole_last_link_and_a_calibrated_tool_are_redundant_within_their_tolerances(tool):
    """The last link and its offset are all six motions of the flange, of which a beam sees four and a point
    three: what the tool has is seen twice. The redundancy is of what has a prior: none of it is held, and
    with the priors nothing is left open. Without the tool's parameters a shift along the beam remains."""
    problem, x = problem_of(robot_of(2, "rrrrrr"), {**tool, "calibrated": True})
    parameters = problem.parameters
    last = [f"link6.{axis}" for axis in ("a", "b", "d", "alpha", "beta")]
    of_tool = [item.name for item in parameters.items if item.group == "tool"]
    assert len(of_tool) == (4 if tool["kind"] == "laser" else 3)
    assert [name for name in last if not parameters.free[parameters.index(name)]] == []
    assert parameters.tolerated[[parameters.index(name) for name in (*last, *of_tool)]].all()
    every = parameters.free.copy()
    assert nulls(problem, x, every) == 6
    for names, expected in ((of_tool, 6 - len(of_tool)), ([*last, "delta6"], 0)):
        free = every.copy()
        free[[parameters.index(name) for name in names]] = False
        assert nulls(problem, x, free) == expected
    jacobian = problem.whiten(x).jacobian[:, every]  # in prior stds
    prior = np.eye(every.sum())[parameters.tolerated[every]]
    assert np.linalg.matrix_rank(np.vstack([jacobian, prior])) == every.sum()
    assert np.linalg.matrix_rank(jacobian) < every.sum()  # negative control
