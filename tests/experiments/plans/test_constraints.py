"""Constraints of a plan: kept in its file, judged by `check`, and refused where a robot would be moved."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, PROBE, good_plan, header, irb1600, plan_of
from command_line import zerobeam
from plan_requests import plan_request
from ruamel.yaml import YAML

from zerobeam.analysis.observability.aim import aim_plan
from zerobeam.analysis.observability.check import Violation
from zerobeam.experiments.plans.candidates import candidates
from zerobeam.experiments.plans.constraints import View, check_plan, require_constraints, violations
from zerobeam.experiments.plans.make import make_plan
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import (
    UNCONSTRAINED,
    Box,
    Obstacles,
    Plan,
    StatedConstraints,
    read_plan,
    write_plan,
)
from zerobeam.words.message import headline

TARGET = (900.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan as `plan optimal` writes it."""
    file = tmp_path_factory.mktemp("plans") / "plan.yaml"
    request = plan_request(acceptance_deg=55.0, beam_mm=(250.0, 1800.0), margin_deg=4.0)
    make_plan(request, file, lambda stage, share: None)
    return file


def edited(made: Path, folder: Path, edit: Any) -> Path:
    """The plan after an edit of its content, as another file."""
    yaml = YAML(typ="safe", pure=True)
    content = yaml.load(made.read_text(encoding="utf-8"))
    edit(content)
    path = folder / "edited.yaml"
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(content, file)
    return path


def stating(**stated: Any) -> Any:
    return lambda content: content.update(constraints=stated)


def broken(plan: Plan) -> tuple[Violation, ...]:
    return violations(aim_plan(plan))


def test_what_a_plan_was_made_for_is_in_its_file_and_kept(made: Path) -> None:
    plan = read_plan(made)
    assert plan.constraints.model_dump(exclude_unset=True) == {
        "facing": (0.0, 0.0, 1.0),
        "acceptance_deg": 55.0,
        "beam_mm": (250.0, 1800.0),
        "margin_deg": 4.0,
        "obstacles": {},
    }
    assert broken(plan) == ()
    assert zerobeam("check", made).status == 0


def test_a_plan_keeps_its_constraints_when_it_is_written_again(made: Path, tmp_path: Path) -> None:
    plan = read_plan(made)
    path = tmp_path / "again.yaml"
    display = plan.robot.display
    write_plan(path, plan.header, plan.postures * display, plan.targets, constraints=plan.constraints)
    assert read_plan(path).constraints == plan.constraints
    floorless = StatedConstraints(obstacles=Obstacles(floor_mm=None))
    path = tmp_path / "floorless.yaml"
    write_plan(path, plan.header, plan.postures * display, plan.targets, constraints=floorless)
    assert read_plan(path).constraints.obstacles == Obstacles(floor_mm=None)


def test_a_beam_from_behind_is_no_pass(made: Path, tmp_path: Path) -> None:
    """The target of a floor is hung above the arm: some beams now come from behind its face."""
    path = edited(made, tmp_path, lambda content: content["targets"]["psd"].update(guess_mm=[900, 0, 1500]))
    answer = zerobeam("check", path, "--json")
    assert answer.status == 1
    found = json.loads(answer.out)
    assert found["verdict"] == "violated"
    plan = read_plan(path)
    turned = aim_plan(plan)
    origin, _ = turned.aimed.problem.beams(turned.x)
    every = [each for posture in found["postures"] for each in posture["violations"]]
    for each in every:
        if each["condition"] != "facing":
            continue
        down = np.array([900, 0, 1500]) - origin[each["posture"]]
        angle = np.degrees(np.arccos(-down[2] / np.linalg.norm(down)))
        assert each["at"] == pytest.approx(angle, abs=1e-6)
        assert angle > 55
    assert any(each["condition"] == "facing" and each["at"] > 90 for each in every)
    assert "from behind" in " ".join(found["notes"])
    said = zerobeam("check", path)
    assert said.status == 1
    assert "Constraints violated" in said.out


CONTROLS: list[tuple[dict[str, Any], set[str]]] = [
    ({"facing": [0, 0, 1]}, set()),
    ({"facing": [0, 0, -2.0]}, {"facing"}),
    ({"facing": [0, 0, 1], "acceptance_deg": 5}, {"facing"}),
    ({"beam_mm": [0, 100]}, {"beam_mm"}),
    ({"beam_mm": [3000, 4000]}, {"beam_mm"}),
    ({"margin_deg": 4}, set()),
    ({"margin_deg": 60}, {"limits"}),
    ({"obstacles": {}}, set()),
    ({"obstacles": {"floor_mm": 900}}, {"cell"}),
    ({"obstacles": {"thickness_mm": 220, "floor_mm": None}}, {"itself"}),
    (
        {"obstacles": {"boxes": [{"name": "lid", "min_mm": [600, -300, 50], "max_mm": [1200, 300, 60]}]}},
        {"beam"},
    ),
]


@pytest.mark.parametrize(("stated", "expected"), CONTROLS)
def test_each_constraint_is_judged(
    stated: dict[str, Any], expected: set[str], made: Path, tmp_path: Path
) -> None:
    found = broken(read_plan(edited(made, tmp_path, stating(**stated))))
    assert expected <= {each.condition for each in found}
    assert bool(found) == bool(expected)


def test_the_numbers_of_a_violation_are_those_of_the_arm(made: Path, tmp_path: Path) -> None:
    plan = read_plan(edited(made, tmp_path, stating(margin_deg=60, beam_mm=[0, 100])))
    turned = aim_plan(plan)
    origin, _ = turned.aimed.problem.beams(turned.x)
    joints = np.degrees(turned.aimed.problem.joints)
    for each in violations(turned):
        if each.condition == "beam_mm":
            assert each.at == pytest.approx(np.linalg.norm(TARGET - origin[each.posture]), abs=1e-6)
        else:
            assert each.joint is not None
            assert each.at == pytest.approx(joints[each.posture, each.joint - 1], abs=1e-9)
            joint = plan.robot.joints[each.joint - 1]
            assert each.lowest == pytest.approx(np.degrees(joint.lower) + 60)
            assert each.highest == pytest.approx(np.degrees(joint.upper) - 60)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.at_length(r"^[12]")
def test_what_chooses_postures_judges_them_too(seed: int) -> None:
    """A candidate that is chosen breaks nothing; those that another constraint would remove do."""
    stated = StatedConstraints(
        facing=(-1.0, 0.0, 1.0),
        acceptance_deg=40.0,
        beam_mm=(400.0, 1500.0),
        margin_deg=10.0,
        obstacles=Obstacles(boxes=[Box(name="table", min_mm=(600, -400, -50), max_mm=(1300, 400, -10))]),
    )
    own = header(LASER, target=TARGET)

    def planned(view: StatedConstraints) -> Plan:
        found = candidates(
            own,
            irb1600(),
            np.array(TARGET),
            40,
            view=View.of(view),
            obstacles=view.obstacles,
            seed=seed,
        )
        rows = np.round(np.degrees(found.postures), 6)
        return Plan.of_postures(own, irb1600(), rows, ["psd"] * len(rows), "chosen", stated)

    assert broken(planned(stated)) == ()
    free = StatedConstraints(beam_mm=(0.0, 1e5))
    conditions = {each.condition for each in broken(planned(free))}
    assert {"facing", "beam_mm", "limits", "cell"} <= conditions


def test_intermediate_postures_and_postures_as_written_keep_clear_of_obstacles(
    made: Path, tmp_path: Path
) -> None:
    folded = [0, 120, 50, 0, 0, 0]  # into the floor

    def edit(content: dict[str, Any]) -> None:
        first = content["postures_deg"][0]
        content["postures_deg"][0] = {"joints_deg": first, "target": "psd", "via_deg": [folded]}

    found = broken(read_plan(edited(made, tmp_path, edit)))
    assert {(each.posture, each.via) for each in found} == {(0, 0)}
    assert "cell" in {each.condition for each in found}


def test_a_posture_that_cannot_see_its_target_is_no_measurement(made: Path, tmp_path: Path) -> None:
    """What the others determine is what a plan of them determines; without others the lines are judged."""
    plan = read_plan(edited(made, tmp_path, stating(facing=[0, 0, 1], acceptance_deg=52)))
    unseen = {each.posture for each in broken(plan)}
    seen = [i for i in range(7) if i not in unseen]
    assert 2 < len(seen) < 7

    def rest(content: dict[str, Any]) -> None:
        del content["constraints"]
        content["postures_deg"] = [content["postures_deg"][i] for i in seen]

    alone = check_plan(read_plan(edited(made, tmp_path, rest)))
    found = check_plan(plan)
    assert [row.std for row in found.parameters] == [row.std for row in alone.parameters]
    assert [row.status for row in found.parameters] == [row.status for row in alone.parameters]
    for facing, degrees in (([0, 0, -1], 60), ([0, 1, 0], 30)):
        stated = stating(facing=facing, acceptance_deg=degrees)
        found = check_plan(read_plan(edited(made, tmp_path, stated)))
        assert found.verdict == "violated"
        if all(posture.violations for posture in found.postures):
            assert "No posture gives a measurement" in headline(found)


def test_without_constraints_nothing_is_judged(made: Path, tmp_path: Path) -> None:
    plan = read_plan(edited(made, tmp_path, lambda content: content.pop("constraints")))
    assert plan.constraints == UNCONSTRAINED
    assert check_plan(plan).verdict == "pass"


@pytest.mark.parametrize(
    ("stated", "part"),
    [
        ({"facing": [0, 0, 0]}, "facing has no length"),
        ({"acceptance_deg": 40}, "without the direction"),
        ({"facing": [0, 0, 1], "acceptance_deg": 120}, "acceptance_deg"),
        ({"beam_mm": [500, 400]}, "out of order"),
        ({"beam": [200, 400]}, "beam_mm"),
        ({"margin_deg": -1}, "margin_deg"),
        ({"obstacles": {"boxes": [{"name": "b", "min_mm": [0, 0, 0], "max_mm": [0, 1, 1]}]}}, "is empty"),
    ],
)
def test_constraints_that_cannot_be_meant_are_refused_with_their_line(
    stated: dict[str, Any], part: str, made: Path, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match=part) as refused:
        read_plan(edited(made, tmp_path, stating(**stated)))
    assert refused.value.line is not None


def test_a_probe_has_no_beam(tmp_path: Path) -> None:
    own = header(PROBE, target=TARGET)
    path = tmp_path / "plan.yaml"
    write_plan(path, own, [[0, 10, 20, 0, 30, 0]], ["psd"], constraints=StatedConstraints(margin_deg=5.0))
    assert read_plan(path).constraints.margin_deg == 5
    text = path.read_text(encoding="utf-8").replace("margin_deg: 5.0", "beam_mm: [200, 2000]")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput, match="a probe, which has no beam"):
        read_plan(path)


@pytest.mark.long
def test_arrays_state_constraints_too(refused: Any) -> None:
    import zerobeam as zb

    def plan(**stated: Any) -> Plan:
        return zb.Plan.from_arrays(
            robot="irb1600",
            tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
            postures=[[0, 10, 20 - k, 0, 50 - 5 * k, k] for k in range(5)],
            unit="deg",
            noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
            target_priors={"psd": {"guess_mm": TARGET}},
            constraints=stated,
        )

    assert zb.check(plan(facing=[0, 0, -1])).verdict == "violated"
    assert zb.check(plan(facing=np.array([0, 0, 1.0]))).violations == ()
    assert "beam_mm" in str(refused(plan, beam_mm=(3, 2)))


def test_patterns_take_no_constraints(tmp_path: Path) -> None:
    (tmp_path / "header.yaml").write_text(
        "robot: irb1600\ntool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\n",
        encoding="utf-8",
    )
    stated = ("--header", tmp_path / "header.yaml", "--target", "900,0,0", "-o", tmp_path / "plan.yaml")
    assert "--margin" in zerobeam("plan", "x", *stated, "--margin", "3").refused()
    assert "it takes no --width" in zerobeam("plan", "optimal", *stated, "--width", "900").refused()
    assert zerobeam("plan", "x", *stated).status == 1  # degenerate, as X-Patterns are
    assert "constraints" not in (tmp_path / "plan.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "command",
    [
        ("run", "{plan}", "--rig", "abb", "--host", "127.0.0.1", "--user", "u", "--password", "p", "--yes"),
        ("run", "{plan}", "--rig", "manual"),
        ("export", "plan", "rapid", "{plan}"),
        ("export", "plan", "csv", "{plan}"),
        ("export", "plan", "pdf", "{plan}"),
    ],
)
def test_no_robot_is_moved_by_a_plan_that_breaks_its_constraints(
    command: tuple[str, ...], made: Path, tmp_path: Path
) -> None:
    path = edited(made, tmp_path, stating(facing=[0, 0, -1]))
    out = tmp_path / "out"
    answer = zerobeam(*(word.format(plan=path) for word in command), "-o", out)
    assert "breaks its own constraints" in answer.refused()
    assert "acceptance_deg" in answer.err
    assert not out.exists()


def test_a_rehearsal_says_that_the_plan_breaks_its_constraints(made: Path, tmp_path: Path) -> None:
    path = edited(made, tmp_path, stating(margin_deg=60))
    answer = zerobeam("run", path, "-o", tmp_path / "run.jsonl", "--no-camera")
    assert answer.status == 0
    assert "with the margin its limits are" in answer.out


TRACKER = {
    "kind": "tracker",
    "guess_mm": [3000, 500, 800],
    "reflectors": {"R1": {"guess_mm": [0, 0, 150]}},
    "sigma_mm": 0.03,
}
LID = {"name": "lid", "min_mm": [600, -300, 50], "max_mm": [1200, 300, 60]}
WALL = {"name": "wall", "min_mm": [1500, -3000, -500], "max_mm": [1600, 3000, 3000]}


def mix(folder: Path, constraints: dict[str, Any], direction: float, *, apart: bool) -> Plan:
    """A laser and a tracker at seven postures: both at each, or `apart`, one after the other."""
    plan = good_plan(7)
    rows = (plan.postures * plan.robot.display).tolist()
    beams = [{"joints_deg": row, "target": "psd", "instrument": "tool"} for row in rows]
    others = [{"joints_deg": row, "instrument": "leica", "reflector": "R1"} for row in rows]
    every = [
        each if apart else {**each, "posture": i}
        for i, both in enumerate(zip(beams, others, strict=True))
        for each in both
    ]
    content = {
        "schema": "zerobeam/plan/1",
        "robot": "irb1600",
        "geometry": "exact",
        "tool": {**LASER, "direction": [direction, 0, 0]},
        "instruments": {"leica": TRACKER},
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
        "targets": {"psd": {"guess_mm": [900, 0, 0]}},
        "constraints": constraints,
        "postures_deg": every,
    }
    path = folder / "mix.yaml"
    with path.open("w", encoding="utf-8") as file:
        YAML(typ="safe", pure=True).dump(content, file)
    return read_plan(path)


@pytest.mark.one_in(2)
@pytest.mark.one_in(4)
@pytest.mark.parametrize("apart", [True, False], ids=["apart", "together"])
@pytest.mark.parametrize(
    ("constraints", "direction", "expected"),
    [
        ({"facing": [0, 0, 1], "acceptance_deg": 85}, 1.0, None),
        ({"facing": [0, 0, -1]}, 1.0, "facing"),
        ({"beam_mm": [0, 100]}, 1.0, "beam_mm"),
        ({"facing": [0, 0, 1]}, -1.0, "behind"),
        ({"obstacles": {"floor_mm": None, "boxes": [LID]}}, 1.0, "beam"),
        ({"obstacles": {"floor_mm": None, "boxes": [WALL]}}, 1.0, "sight"),
    ],
)
def test_in_a_mix_the_beam_is_judged_where_the_laser_measures(
    tmp_path: Path, constraints: dict[str, Any], direction: float, expected: str | None, apart: bool
) -> None:
    """And the sight where the tracker measures; no real arm is moved by a plan that breaks it."""
    plan = mix(tmp_path, constraints, direction, apart=apart)
    checked = check_plan(plan)
    broken_postures = [posture.posture for posture in checked.postures if posture.violations]
    if expected is None:
        assert broken_postures == []
        require_constraints(plan)
        return
    laser, tracker = (range(0, 14, 2), range(1, 14, 2)) if apart else (range(7), range(7))
    assert broken_postures == list(tracker if expected == "sight" else laser)
    assert {each.condition for each in checked.violations} == {expected}
    assert checked.verdict == "violated"
    with pytest.raises(BadInput, match="no robot is moved by it"):
        require_constraints(plan)


def test_a_posture_at_which_two_instruments_measure_is_named_by_its_number(tmp_path: Path) -> None:
    """Not by the row of one of its measurements; its arm is judged once."""
    plan = mix(tmp_path, {"obstacles": {"floor_mm": 700}, "margin_deg": 60}, 1.0, apart=False)
    checked = check_plan(plan)
    assert len(checked.postures) == 7
    assert {posture.target for posture in checked.postures} == {"psd"}
    facts = [(each.posture, each.condition, each.joint, each.via) for each in checked.violations]
    assert facts
    assert len({*facts}) == len(facts)


def test_a_target_behind_the_laser_is_refused_without_other_instruments_too() -> None:
    plan = plan_of(header({**LASER, "direction": [-1, 0, 0]}), good_plan(7).postures)
    assert violations(aim_plan(plan)) == ()  # without constraints it is a finding
    stated = replace(plan, constraints=StatedConstraints(facing=(0.0, 0.0, 1.0)))
    assert {each.condition for each in violations(aim_plan(stated))} == {"behind"}
