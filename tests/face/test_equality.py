"""What is equal: a run, a robot, a plan by value; an answer by what it was made from."""

import copy
import pickle
from dataclasses import replace

import pytest
from analysed_once import analysed_once
from exact_runs import demo_runs

import zerobeam as zb
from zerobeam.model.files.plan import planned

HEADER = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
}
TRACKER = {"leica": {"kind": "tracker", "frame": "free", "sigma_mm": 0.05, "reflectors": {"a": {}}}}


@pytest.fixture(scope="module")
def run() -> zb.Run:
    return zb.read_run(demo_runs()[0].path)


@pytest.fixture(scope="module")
def solution(run: zb.Run) -> zb.Analysed:
    return analysed_once(run, ess=100)


def tracked() -> zb.Run:
    return zb.Run.from_arrays(
        robot="irb1600",
        noise=zb.Noise(joint_deg=0.01),
        instruments=TRACKER,
        joints=[[0, 0, 0, 0, 40, 0], [10, 0, 0, 0, 40, 0]],
        unit="deg",
        measured={"measured_mm": [[1, 2, 3], [4, 5, 6]]},
    )


THINGS = {
    "run": lambda run, solution: run,
    "run of a tracker": lambda run, solution: tracked(),
    "robot": lambda run, solution: run.robot,
    "plan": lambda run, solution: zb.Plan.from_arrays(**HEADER, postures=run.joints, unit="rad"),
    "solution": lambda run, solution: solution,
    "covariance": lambda run, solution: solution.covariance,
    "profile": lambda run, solution: solution.profile("J2", size=5),
    "contour": lambda run, solution: solution.contour("J2", "J3", size=8),
}


@pytest.mark.parametrize("name", THINGS)
def test_a_copy_is_equal_and_has_the_same_hash(run, solution, name: str) -> None:
    thing = THINGS[name](run, solution)
    for other in (copy.deepcopy(thing), pickle.loads(pickle.dumps(thing))):
        assert other == thing
        assert hash(other) == hash(thing)
    assert thing != name


def test_another_number_makes_another_thing(run: zb.Run, solution: zb.Analysed) -> None:
    assert run != replace(run, shots=run.shots[1:])
    joint = replace(run.robot.joints[1], upper=1.0)
    assert run.robot != replace(run.robot, joints=(run.robot.joints[0], joint, *run.robot.joints[2:]))
    plan = zb.Plan.from_arrays(**HEADER, postures=run.joints, unit="rad")
    assert plan != replace(plan, shots=planned(run.joints, plan.targets))
    assert solution.profile("J2", size=5) != solution.profile("J3", size=5)


@pytest.mark.long
def test_a_solution_is_equal_if_run_options_and_versions_are(run: zb.Run, solution: zb.Analysed) -> None:
    assert zb.analyse(run, ess=100) == solution
    other = zb.analyse(run, ess=100, seed=1, robust="huber")
    assert (other.options.seed, other.options.robust) == (1, "huber")
    for changed in ({"seed": 1}, {"robust": "huber"}):
        assert replace(solution, options=replace(solution.options, **changed)) != solution
    assert analysed_once(zb.read_run(demo_runs()[1].path), ess=100) != solution
    # The last digits of a fit depend on what was compiled before it.
    row = solution["J2"]
    moved = [
        replace(one, estimate=one.estimate + 1e-14) if one is row else one for one in solution.parameters
    ]
    result = replace(solution.result, parameters=type(solution.result.parameters)(moved))
    assert replace(solution, result=result) == solution
    inputs = replace(solution.result.inputs, versions={"numpy": "0"})
    assert replace(solution, result=replace(solution.result, inputs=inputs)) != solution
