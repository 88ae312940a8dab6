"""Calls that make no sense: each has one error that names the argument and says what to do."""

import numpy as np
import pandas as pd
import pytest
from analysed_once import analysed_once
from exact_runs import demo_runs
from matplotlib.figure import Figure as PlainFigure

import zerobeam as zb
from zerobeam.face.predicted import DoubtfulJoints

TOOL, NOISE = zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)), zb.Noise(joint_deg=0.01, spot_mm=0.05)
HEADER = {"robot": "irb1600", "tool": TOOL, "noise": NOISE}
POSTURE = [10, -20, 30, 5, 40, 0]


@pytest.fixture(scope="module")
def plan(good: zb.Analysed) -> zb.Plan:
    priors = {"psd": {"guess_mm": (950, 150, 100)}}
    return zb.Plan.from_arrays(**HEADER, postures=good.run.joints, unit="rad", target_priors=priors)


@pytest.mark.parametrize(("kind", "rows"), [(zb.Run, "joints"), (zb.Plan, "postures")])
def test_an_argument_that_is_none_is_compared_with_those_of_the_call(kind: type, rows: str) -> None:
    with pytest.raises(zb.BadInput, match="did you mean 'unit'") as caught:
        kind.from_arrays(**HEADER, **{rows: [POSTURE]}, units="deg")
    assert caught.value.argument == "units"
    allowed = caught.value.allowed.split(", ")
    assert {rows, "unit", "target_priors", "held"} <= set(allowed)
    assert "schema" not in allowed


@pytest.mark.parametrize(("kind", "rows"), [(zb.Run, "joints"), (zb.Plan, "postures")])
def test_degrees_that_are_stated_to_be_radians_are_said_as_given(kind: type, rows: str) -> None:
    for limits in ("error", "warn"):
        with pytest.raises(zb.BadInput, match=r"unit='rad' is stated(.|\n)*state unit='deg'") as caught:
            kind.from_arrays(**HEADER, **{rows: [[0, 0, 0, 0, -69.5, 0]]}, unit="rad", limits=limits)
        assert caught.value.argument == rows
        assert caught.value.found == "-69.5 rad"


@pytest.mark.parametrize(("unit", "value"), [("rad", 4.0), ("deg", 200.0)])
def test_a_joint_outside_its_limits_is_said_in_the_unit_of_the_call(unit: str, value: float) -> None:
    with pytest.raises(zb.BadInput, match="limits='warn'") as caught:
        zb.Run.from_arrays(**HEADER, joints=[[value, 0, 0, 0, 0, 0]], unit=unit)
    assert caught.value.found == f"{value:g} {unit}"
    assert "header" not in str(caught.value)


def test_a_doubt_about_the_unit_is_in_the_repr() -> None:
    joints = np.radians([POSTURE, POSTURE])
    assert "radians?" in repr(zb.Run.from_arrays(**HEADER, joints=joints, unit="deg"))
    assert "radians?" in repr(zb.Plan.from_arrays(**HEADER, postures=joints, unit="deg"))
    assert "warning" not in repr(zb.Run.from_arrays(**HEADER, joints=joints, unit="rad"))
    assert "1 measurement of" in repr(zb.Run.from_arrays(**HEADER, joints=joints[:1], unit="rad"))


def test_a_prediction_has_the_same_doubts(good: zb.Analysed) -> None:
    with pytest.warns(DoubtfulJoints, match="radians"):
        good.predict(np.radians(POSTURE), "deg")
    with pytest.warns(DoubtfulJoints, match="outside its limits"):
        good.predict([200, 0, 0, 0, 0, 0], "deg")
    with pytest.raises(zb.BadInput, match="unit='deg'"):
        good.predict(POSTURE, "rad")


CALLS = {
    "covariance of one": (lambda good, plan: good.covariance["J2"], None, '"J2", "J2"'),
    "drop a mask": (lambda good, plan: good.refit(drop=np.arange(7) == 3), "drop", r"index\[mask\]"),
    "drop True": (lambda good, plan: good.refit(drop=[True]), "drop", "whole numbers"),
    "drop one": (lambda good, plan: good.refit(drop=3), "drop", "whole numbers"),
    "drop a name": (lambda good, plan: good.refit(drop="3"), "drop", "whole numbers"),
    "hold a list": (lambda good, plan: good.refit(hold=["J6"]), "hold", '"J6": 0'),
    "hold a name": (lambda good, plan: good.refit(hold="J6"), "hold", '"J6": 0'),
    "hold a target": (lambda good, plan: good.refit(hold={"psd.x": 951}), "hold", "guess_mm"),
    "hold a link": (lambda good, plan: good.refit(hold={"link2.beta": 1}), "hold", "solution.profile"),
    "offsets in a list": (lambda good, plan: zb.simulate(plan, [0, 1]), "offsets", '"J2": 0.3'),
    "level of text": (lambda good, plan: good["J2"].interval("0.9"), "level", "between 0 and 1"),
    "no level": (lambda good, plan: good["J2"].interval(None), "level", "between 0 and 1"),
    "level of a contour": (lambda good, plan: good.contour("J2", "J3", level="a"), "level", "between 0"),
    "axes": (lambda good, plan: good.plot.offsets(ax=3), "ax", "matplotlib"),
    "axes of a profile": (lambda good, plan: good.profile("J2", size=3).plot(ax=3), "ax", "matplotlib"),
    "progress": (lambda good, plan: zb.analyse(good.run, progress=1), "progress", "a function"),
    "offsets by name": (lambda good, plan: good.run.robot.with_offsets(good.enter), "delta", "radians"),
    "too few offsets": (lambda good, plan: good.run.robot.with_offsets([1, 2]), "delta", "6 numbers"),
    "an array": (lambda good, plan: zb.analyse(good.run.joints), "run", "Run.from_arrays"),
    "a robot's name": (lambda good, plan: zb.optimal_plan("ur5e"), "header", '"robot": "ur5e"'),
    "small letter": (lambda good, plan: good["j2"], None, "did you mean 'J2'"),
    "number": (lambda good, plan: good[2], None, "did you mean 'J2'"),
    "held": (lambda good, plan: good.contour("J2", "J1"), "second", "J1 (.|\n)*base frame"),
    "profile of a held one": (lambda good, plan: good.profile("J1"), "name", "J1 (.|\n)*base frame"),
}


@pytest.mark.parametrize("name", CALLS)
def test_it_is_refused_by_name(good: zb.Analysed, plan: zb.Plan, name: str) -> None:
    call, argument, words = CALLS[name]
    with pytest.raises(zb.BadInput, match=words) as caught:
        call(good, plan)
    assert caught.value.argument == argument


@pytest.mark.one_in(4)
@pytest.mark.parametrize("drop", [np.array([3]), pd.Index([3]), (3,), {3}])
def test_what_holds_numbers_is_as_good_as_a_list(good: zb.Analysed, drop: object) -> None:
    assert list(good.refit(drop=drop, ess=100).data.index) == [0, 1, 2, 4, 5, 6]


def test_an_optimal_plan_says_where_its_plan_is(best: zb.OptimalPlan) -> None:
    for call in (zb.check, zb.simulate):
        with pytest.raises(zb.BadInput, match="its attribute `plan`"):
            call(best)


def test_names_of_joints_and_lists_are_taken(good: zb.Analysed, plan: zb.Plan) -> None:
    assert zb.simulate(plan, {"J2": 0.3}, seed=1) == zb.simulate(plan, {"delta2": 0.3}, seed=1)
    assert good.covariance.select("J2").names == ("delta2",)
    pose, _ = good.run.robot.pose_and_jacobian([0.0] * 6)
    np.testing.assert_array_equal(pose, good.run.robot.fk([0.0] * 6, "deg"))


@pytest.mark.long
def test_solutions_are_compared_by_their_runs(good: zb.Analysed) -> None:
    solutions = [good, analysed_once(zb.read_run(demo_runs()[1].path), ess=100)]
    assert zb.compare(solutions) == zb.compare([solution.run for solution in solutions])


def test_a_misfit_names_first_what_was_held(good: zb.Analysed) -> None:
    held = good.refit(hold={"J2": 0}, ess=100)
    message = held.to_json()["message"]
    assert message["cause"].startswith("J2 (δ2) is held")
    assert message["action"]["text"].startswith("Enter nothing. Estimate J2 (δ2) too.")
    assert "is held" not in str(good.to_json()["message"])


def test_commands_for_a_run_in_memory_begin_with_writing_it(
    good: zb.Analysed, plan: zb.Plan, tmp_path
) -> None:
    solution = zb.analyse(zb.simulate(plan, {"J2": 0.3}), ess=100)
    action = solution.to_json()["message"]["action"]
    assert 'solution.run.write("simulated.jsonl")' in action["text"]
    assert "simulated.jsonl" in action["command"]
    assert "run.write" not in good.to_json()["message"]["action"]["text"]
    file = solution.run.write(tmp_path / "simulated.jsonl")
    assert "run.write" not in repr(zb.analyse(zb.read_run(file), ess=100))


def test_runs_and_plans_are_written_and_nothing_is_lost(good: zb.Analysed, plan: zb.Plan, tmp_path) -> None:
    run = zb.simulate(plan, {"J2": 0.3})
    assert zb.read_run(run.write(tmp_path / "run.jsonl")) == run
    again = zb.read_plan(plan.write(tmp_path / "plan.yaml"))
    np.testing.assert_allclose(again.postures, plan.postures, atol=2e-11)
    assert zb.read_plan(again.write(tmp_path / "again.yaml")) == again
    for thing, name in ((run, "run.jsonl"), (plan, "plan.yaml")):
        before = (tmp_path / name).read_bytes()
        with pytest.raises(zb.BadInput, match="exists already"):
            thing.write(tmp_path / name)
        assert (tmp_path / name).read_bytes() == before
        assert thing.write(tmp_path / name, force=True) == tmp_path / name
    other = good.run.robot.with_offsets([0, 0.01, 0, 0, 0, 0])
    moved = zb.Run.from_arrays(**{**HEADER, "robot": other}, joints=good.run.joints, unit="rad")
    with pytest.raises(zb.BadInput, match="another one"):
        moved.write(tmp_path / "moved.jsonl")
    assert not (tmp_path / "moved.jsonl").exists()


def test_axes_of_matplotlib_are_taken(good: zb.Analysed) -> None:
    axes = PlainFigure().subplots()
    assert good.plot.residuals(ax=axes) is axes
