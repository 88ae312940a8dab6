"""Beams and lines of sight that the arm itself blocks: in checks, plans and runs. Distances by sampling."""

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, OPEN_LASER, header, irb1600, plan_of
from command_line import zerobeam
from plan_requests import plan_request
from ruamel.yaml import YAML

from zerobeam.analysis.acceptance import choose
from zerobeam.analysis.diagnostics.values_to_enter import values_to_enter
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability.aim import AimedPlan, aim_plan
from zerobeam.analysis.observability.clearance import Clearance
from zerobeam.experiments.plans.candidates import candidates
from zerobeam.experiments.plans.constraints import check_plan, clear_postures, require_constraints, violations
from zerobeam.experiments.plans.make import PlanRequest, make_plan
from zerobeam.experiments.plans.new_calibration import PLACES, new_calibration, place_of
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Obstacles, Plan, read_plan
from zerobeam.model.files.robot_file import built_in_robots, load_robot
from zerobeam.model.files.run import read_run
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.plan_catalogue import check_notes

CASE = Path(__file__).parents[2] / "support" / "beam_through_arm.yaml"
BLOCKED = {3: (2, 0.7), 10: (4, 35.4), 18: (2, 22.8)}  # by posture: the link, and mm from its axis


def edited(folder: Path, edit: Any = lambda content: None) -> Path:
    yaml = YAML(typ="safe", pure=True)
    content = yaml.load(CASE.read_text(encoding="utf-8"))
    edit(content)
    path = folder / "plan.yaml"
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(content, file)
    return path


def arm_file(folder: Path, radius: float) -> str:
    """The built-in arm with a stated radius of its links."""
    from zerobeam.model.parsing.confinement import BUILT_IN

    text = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    (folder / "arm.yaml").write_text(f"{text}bodies: {{radius_mm: {radius:g}}}\n", encoding="utf-8")
    return "arm.yaml"


def to_segment(points: Matrix, a: Matrix, b: Matrix) -> float:
    share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return float(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1).min())


def links(robot: Robot, joints: Matrix) -> list[tuple[Matrix, Matrix]]:
    """Ends of the links of a posture, rad, by products of transforms: from the mounting face to joint 6."""
    pose, points = np.eye(4), [np.array([0.0, 0.0, -(robot.conventions.below_base or 0.0)]), np.zeros(3)]
    for joint, q in zip(robot.joints, joints, strict=True):
        pose = pose @ joint.fixed
        points.append(pose[:3, 3])
        turn = np.eye(4)
        x, y, z = joint.axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn[:3, :3] = np.eye(3) + np.sin(q) * cross + (1 - np.cos(q)) * cross @ cross
        pose = pose @ turn
    return [(a, b) for a, b in pairwise(points) if np.linalg.norm(b - a) > 1e-6]


def nearest(turned: AimedPlan, radius: float) -> list[float]:
    """Of each posture: how near its beam comes to the axis of a link, from two radii on from the laser."""
    problem = turned.aimed.problem
    origins, _ = problem.beams(turned.x)
    ends = problem.split(turned.x).targets[problem.target_index]
    result = []
    for joints, origin, end in zip(problem.joints, origins, ends, strict=True):
        way = end - origin
        along = np.linspace(2 * radius / np.linalg.norm(way), 1, 1000)[:, None] * way + origin
        result.append(min(to_segment(along, a, b) for a, b in links(problem.robot, joints)))
    return result


@pytest.mark.long
def test_a_beam_through_a_link_is_a_violation_with_its_distance(tmp_path: Path) -> None:
    """The case of a new calibration by all defaults: `check` passed it."""
    turned = aim_plan(read_plan(edited(tmp_path)))
    found = violations(turned)
    assert {each.posture: each.joint for each in found} == {i: link for i, (link, _) in BLOCKED.items()}
    sampled = nearest(turned, 68.25)
    for each in found:
        assert (each.condition, each.constraint, each.unit) == ("arm", "instrument", "mm")
        assert each.at == pytest.approx(BLOCKED[each.posture][1], abs=0.05)
        assert each.at == pytest.approx(sampled[each.posture], abs=2)
        assert each.lowest == pytest.approx(0.05 * 1365)
        assert each.assumed
    assert all(sampled[i] > 68 for i in range(19) if i not in BLOCKED)
    checked = check_plan(turned.plan, turned)
    assert checked.verdict == "violated"
    said = (
        "Posture 3: link 2 of the arm is in the way: the line to the target passes 1 mm from its axis"
        " (radius 68 mm, assumed: state it by `bodies` of the robot file): no measurement is counted there"
    )
    assert said in [note.replace("\u00a0", " ") for note in check_notes(checked)]


def test_what_is_judged_is_the_plan_without_the_blocked_postures(tmp_path: Path) -> None:
    kept = [i for i in range(19) if i not in BLOCKED]

    def rest(content: dict[str, Any]) -> None:
        content["postures_deg"] = [content["postures_deg"][i] for i in kept]

    with_blocked = check_plan(read_plan(edited(tmp_path)))
    without = check_plan(read_plan(edited(tmp_path, rest)))
    assert without.verdict == "pass"
    assert [row.std for row in with_blocked.parameters] == [row.std for row in without.parameters]


@pytest.mark.parametrize(("radius", "blocked"), [(0.5, set()), (30.0, {3, 18}), (68.0, {3, 10, 18})])
def test_the_radius_of_the_robot_file_decides(radius: float, blocked: set[int], tmp_path: Path) -> None:
    path = edited(tmp_path, lambda content: content.update(robot=arm_file(tmp_path, radius)))
    found = violations(aim_plan(read_plan(path)))
    assert {each.posture for each in found if each.condition == "arm"} == blocked
    assert not any(each.assumed for each in found)
    # A plan's own obstacles say more.
    path = edited(
        tmp_path,
        lambda content: (
            content.update(robot="arm.yaml"),
            content["constraints"].update(obstacles={"thickness_mm": 30.0}),
        ),
    )
    assert {each.posture for each in violations(aim_plan(read_plan(path)))} == {3, 18}


@pytest.mark.long
def test_without_constraints_it_is_judged_too_and_refused_for_a_real_arm(tmp_path: Path) -> None:
    path = edited(tmp_path, lambda content: content.pop("constraints"))
    plan = read_plan(path)
    assert {each.posture for each in violations(aim_plan(plan))} == set(BLOCKED)
    with pytest.raises(BadInput, match="no robot is moved by the plan") as refused:
        require_constraints(plan)
    assert "`bodies`" in str(refused.value)
    answer = zerobeam("export", "plan", "csv", path, "-o", tmp_path / "plan.csv")
    assert "no robot is moved" in answer.refused()
    said = zerobeam("run", path, "-o", tmp_path / "run.jsonl", "--no-camera")
    assert "Posture 3: link 2 of the arm is in the way" in " ".join(said.out.split())


def test_what_begins_with_the_laser_blocks_only_a_beam_that_comes_back() -> None:
    """A laser before a wrist whose housing is thicker than it is far: a turn of joint 5 folds the beam onto
    the forearm; one of joint 6 moves nothing but the beam, about the wrist."""
    robot = irb1600()
    clearance = Clearance(Problem.build(header(LASER), robot, np.zeros((1, 6)), ["psd"]), None)
    assert clearance._radius > 65  # mm from the wrist's centre to the laser
    for fifth in (-110.0, -100.0, -91.0, -80.0, 0.0, 60.0):
        joints = np.radians([[0.0, 0, 0, 0, fifth, 0]])
        problem = Problem.build(header(LASER), robot, joints, ["psd"])
        origins, directions = problem.beams(problem.nominal())
        found = clearance.in_the_way(joints, origins, (origins + 1000 * directions)[0], beam=True)
        forearm = links(robot, joints[0])[-1]
        along = origins + np.linspace(0, 600, 1000)[:, None] * directions
        back = directions[0] @ (forearm[0] - forearm[1]) > 0 and to_segment(along, *forearm) < 68
        assert found.blocked[0] == back, fifth


def test_an_arm_whose_axes_miss_each_other_by_tenths_is_judged_as_the_nominal_one(tmp_path: Path) -> None:
    """As an exported robot file of a calibrated arm is: its wrist still carries the laser, and parts that
    share a joint still do."""
    from zerobeam.model.parsing.confinement import BUILT_IN

    text = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    text = re.sub(r"\b(a_mm|d_mm): 0,", r"\1: 0.3,", text)
    (tmp_path / "calibrated.yaml").write_text(text, encoding="utf-8")
    calibrated = load_robot("calibrated.yaml", tmp_path)
    joints = np.random.default_rng(5).uniform(calibrated.lower, calibrated.upper, (2000, 6))

    def judged(robot: Robot, thickness: float) -> Matrix:
        problem = Problem.build(header(LASER), robot, joints, ["psd"])
        clearance = Clearance(problem, Obstacles(thickness_mm=thickness))
        origins, directions = problem.beams(problem.nominal())
        found = clearance.in_the_way(joints, origins, origins + 900 * directions, beam=True)
        return np.array([clearance.hits_itself(joints), found.blocked])

    thin, nominal, thick = (judged(irb1600(), 68.0 * share) for share in (0.97, 1.0, 1.03))
    clear = (thin == nominal) & (thick == nominal)
    assert (clear.mean(axis=1) > 0.9).all()
    assert ((clear & nominal).sum(axis=1) > 10).all()
    assert (judged(calibrated, 68.0)[clear] == nominal[clear]).all()


def test_candidates_are_free_and_those_that_are_not_are_counted() -> None:
    target = np.array([900.0, 0.0, 0.0])
    pool = candidates(header(target=tuple(target)), irb1600(), target, 300, obstacles=Obstacles(), seed=1)
    taken = pool.removed["have the arm itself in the way of the beam or the line of sight"]
    assert taken > 10
    own = header(target=tuple(target))
    turned = aim_plan(plan_of(own, pool.postures))
    assert min(nearest(turned, 68.25)) > 68
    with pytest.MonkeyPatch.context() as patch:  # a control: the rule is what keeps them free
        whole = Clearance.in_the_way
        patch.setattr(
            Clearance,
            "in_the_way",
            lambda *at, **by: whole(*at, **by)._replace(blocked=np.zeros(len(at[1]), dtype=bool)),
        )
        pool = candidates(own, irb1600(), target, 300, obstacles=Obstacles(), seed=1)
    assert min(nearest(aim_plan(plan_of(own, pool.postures)), 68.25)) < 40


@pytest.mark.parametrize("which", ["x", "y"])
def test_patterns_look_past_the_arm(which: Any) -> None:
    target = np.array([900.0, 0.0, 0.0])
    own = header(target=tuple(target))
    turned = aim_plan(plan_of(own, pattern(own, irb1600(), target, which)))
    assert violations(turned) == ()
    assert min(nearest(turned, 68.25)) > 68


def test_a_pattern_that_the_arm_blocks_is_made_from_elsewhere_or_refused(tmp_path: Path) -> None:
    """With an arm of which every beam meets a link there is none."""
    target = np.array([900.0, 0.0, 0.0])
    own = header(target=tuple(target))
    thick = load_robot(arm_file(tmp_path, 700), tmp_path)
    with pytest.raises(BadInput, match="past the arm itself"):
        pattern(own, thick, target, "x", 1)


def proposed(arm: str, place: str, **changes: Any) -> PlanRequest:
    """The plan of a new calibration with a laser, by all defaults."""
    robot, row = load_robot(arm, Path(".")), next(each for each in PLACES if each.kind == place)
    new = new_calibration("laser", robot, place_of(row.kind, robot, None), row.facing, None, {})
    stated = dict(option[2:].split("=") for option in new.options)
    return plan_request(
        header=Header.model_validate({"robot": arm, **new.header}),
        target=None,
        facing=tuple(map(float, stated["facing"].split(","))),
        beam_mm=tuple(map(float, stated["beam"].split(","))),
        **{
            "candidates": int(stated["candidates"]),
            "shots": None,
            "tolerance": float(stated["tolerance"]),
            "max_shots": int(stated["max-shots"]),
            **changes,
        },
    )


def plan_is_free(request: PlanRequest) -> None:
    plan: Plan | None = make_plan(request, None, lambda stage, share: None).plan
    assert plan is not None
    turned = aim_plan(plan)
    assert violations(turned) == ()
    radius = Clearance(turned.problem, None)._radius
    assert min(nearest(turned, radius)) > 0.99 * radius


@pytest.mark.long
@pytest.mark.parametrize("arm", ["irb1600", "lrmate_200id"])
@pytest.mark.one_in(2)
def test_few_measurements_of_a_new_calibration_have_free_beams(arm: str) -> None:
    plan_is_free(proposed(arm, "front", candidates=200, shots=8, tolerance=None))


@pytest.mark.long
@pytest.mark.parametrize("arm", built_in_robots())
def test_the_plan_of_a_new_calibration_has_free_beams(arm: str) -> None:
    for place in ("front", "floor"):
        plan_is_free(proposed(arm, place, candidates=1000, shots=12, tolerance=None))


@pytest.mark.long
def test_a_check_answers_what_is_in_the_way(tmp_path: Path) -> None:
    answer = zerobeam("check", edited(tmp_path), "--json")
    assert answer.status == 1
    found = json.loads(answer.out)
    each = found["postures"][3]["violations"][0]
    assert (each["condition"], each["joint"], each["assumed"]) == ("arm", 2, True)
    assert each["at"] == pytest.approx(0.716, abs=1e-3)


def test_an_uncalibrated_laser_is_judged_by_its_nominal_beam() -> None:
    target = (900.0, 0.0, 0.0)
    pool = candidates(header(OPEN_LASER, target=target), irb1600(), np.array(target), 50, seed=1)
    assert min(nearest(aim_plan(plan_of(header(target=target), pool.postures)), 68.25)) > 68


@pytest.mark.long
def test_what_to_do_about_blocked_postures_has_a_command_that_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edited(tmp_path)
    monkeypatch.chdir(tmp_path)
    said = " ".join(zerobeam("check", "plan.yaml").out.split())
    todo = (
        "To do: Change or remove postures 3, 10 and 18 (the plan's first posture is 0), or make another plan."
    )
    assert todo in said
    command = "zerobeam plan optimal --header plan.yaml --shots 19 -o new-plan.yaml"
    assert command in said
    made = zerobeam(*command.split()[1:], "--candidates", "200")
    assert made.status == 0, made.err
    assert violations(aim_plan(read_plan(tmp_path / "new-plan.yaml"))) == ()


@pytest.mark.long
def test_a_verification_has_no_posture_that_the_arm_blocks(tmp_path: Path) -> None:
    """A rehearsal measures at blocked postures too; a plan that moves a robot takes none of them again."""
    run = tmp_path / "run.jsonl"
    answer = zerobeam("run", edited(tmp_path), "-o", run, "--no-camera", "--seed", "1")
    assert run.is_file(), answer.err
    recorded = read_run(run)
    solution = solve_run(Problem.from_run(recorded), recorded.header)
    free = clear_postures(solution.problem, solution.fit.x, recorded)
    assert {*np.flatnonzero(~free).tolist()} == set(BLOCKED)
    tolerance = {"deg": 0.1, "mm": 1.0}
    plan = choose(solution, values_to_enter(solution), tolerance, 16, free)
    assert not {*plan.rows} & set(BLOCKED)


@pytest.mark.long
def test_of_several_instruments_each_has_its_own_line(tmp_path: Path) -> None:
    """A laser and a tracker at the same postures: where the arm blocks the beam alone the tracker sees on."""
    leica = {"kind": "tracker", "guess_mm": [3000, 500, 800], "reflectors": {"R1": {"guess_mm": [60, 0, 80]}}}

    def both(content: dict[str, Any]) -> None:
        postures = content["postures_deg"]
        content["instruments"] = {"leica": {**leica, "frame": "free", "sigma_mm": 0.05}}
        content["postures_deg"] = [
            *({"joints_deg": joints, "target": "psd", "instrument": "tool"} for joints in postures),
            *({"joints_deg": joints, "instrument": "leica", "reflector": "R1"} for joints in postures[:9]),
        ]

    plan = edited(tmp_path, both)
    found = {each.posture for each in violations(aim_plan(read_plan(plan))) if each.condition == "arm"}
    assert found >= set(BLOCKED)
    run = tmp_path / "run.jsonl"
    answer = zerobeam("run", plan, "-o", run, "--no-camera", "--seed", "1")
    assert run.is_file(), answer.err
    recorded = read_run(run)
    solution = solve_run(Problem.from_run(recorded), recorded.header)
    blocked = np.flatnonzero(~clear_postures(solution.problem, solution.fit.x, recorded))
    assert {*blocked.tolist()} == found
    assert len({*range(19, 28)} - found) > 2  # the tracker sees its reflector in others
