"""What a plan measures again at its end: stored, checked, carried out, and what a run makes of it."""

import functools
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, header, irb1600
from command_line import zerobeam
from deviating_arms import Arms
from messages_so_far import message_so_far
from plan_requests import plan_request

from zerobeam.analysis.diagnostics.diagnosis import Explanation, diagnose, undecided
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability.changes import RepeatsApart, repeated, repeats_differ
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.analysis.observability.power import powers
from zerobeam.analysis.solution import Solution
from zerobeam.experiments.makers.generic.joint_logs import CsvLayout, import_csv
from zerobeam.experiments.makers.import_jobs import ImportJob
from zerobeam.experiments.makers.plan_programs import ProgramMotion, program_texts
from zerobeam.experiments.plans.make import make_plan
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan, first_in_turn, read_plan
from zerobeam.model.files.run import read_run
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.misfit_words import cause_sentence

TARGET = np.array([900.0, 0.0, 0.0])


@functools.cache
def planned(**changes: Any) -> tuple[Plan, str]:
    """A plan and the text of its file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plan.yaml"
        plan = make_plan(plan_request(**changes), file, lambda stage, share: None).plan
        assert plan is not None
        return plan, file.read_text(encoding="utf-8")


def made(file: Path | None = None, **changes: Any) -> Plan:
    plan, text = planned(**changes)
    if file is not None:
        file.write_text(text, encoding="utf-8")
    return plan


@pytest.mark.one_in(2)
@pytest.mark.parametrize("kind", ["x", "optimal"])
def test_a_plan_ends_with_its_first_postures_again(kind: str, tmp_path: Path) -> None:
    plan = made(tmp_path / "plan.yaml", kind=kind, repeat=2)
    assert [shot.again for shot in plan.shots] == [None] * 7 + [0, 1]
    np.testing.assert_array_equal(plan.postures[7:], plan.postures[:2])
    read = read_plan(tmp_path / "plan.yaml")
    assert [shot.again for shot in read.shots] == [shot.again for shot in plan.shots]
    # Those that are new are written as they always were.
    rows = (tmp_path / "plan.yaml").read_text().partition("postures_deg:")[2].strip().splitlines()
    assert all(row.strip().startswith("- [") for row in rows[:7])
    assert all("again:" in row for row in rows[7:])
    assert len(made(kind=kind, repeat=0).shots) == 7


@pytest.mark.long
def test_a_table_and_trajectories_name_repeats_and_are_read_back(tmp_path: Path) -> None:
    plan = made(tmp_path / "plan.yaml", repeat=2)
    text = program_texts("csv", plan, ProgramMotion(), tmp_path / "plan.csv")[tmp_path / "plan.csv"]
    heads, *rows = (line.split(",") for line in text.splitlines())
    assert heads[:3] == ["posture", "target", "again"]
    assert [row[2] for row in rows] == [""] * 7 + ["0", "1"]
    measured = [
        [*row[:3], *(f"{float(value) + 0.01 + 0.001 * i:.4f}" for value in row[3:])]
        for i, row in enumerate(rows)
    ]
    (tmp_path / "measured.csv").write_text("\n".join(map(",".join, [heads, *measured])) + "\n")
    job = ImportJob.begin([tmp_path / "measured.csv"], plan, tmp_path / "run.jsonl")
    layout = CsvLayout("deg", header_row=True, columns=tuple(heads[3:]), target_column="target")
    assert [shot.target for shot in import_csv(job, layout).shots] == ["psd"] * 9
    (new,) = program_texts("csv", made(repeat=0), ProgramMotion(), tmp_path / "new.csv").values()
    assert "again" not in new.splitlines()[0]
    (ros,) = program_texts("ros", plan, ProgramMotion(), tmp_path / "plan.yaml").values()
    assert '# posture 8, target "psd", posture 1 again\n' in ros


def test_of_several_targets_the_first_of_each_comes_first() -> None:
    assert first_in_turn(["a", "a", "a", "b", "b", "c"], 2) == [0, 3]
    assert first_in_turn(["a", "a", "a", "b", "b", "c"], 4) == [0, 1, 3, 5]
    assert first_in_turn(["a"], 3) == [0]


@pytest.mark.parametrize(
    ("again", "what"),
    [
        (7, "repeats what is no posture of its own"),
        (9, "repeats what is no posture of its own"),
        (3, "repeats 3, but has other joints"),
    ],
)
def test_a_repeat_of_something_else_is_refused(again: int, what: str, tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    made(file, repeat=2)
    text = file.read_text()
    file.write_text(text.replace("again: 1", f"again: {again}"))
    with pytest.raises(BadInput, match=what) as refused:
        read_plan(file)
    assert refused.value.line == text.count("\n", 0, text.index("again: 1")) + 1


@pytest.mark.parametrize(("joint", "by", "refused"), [(2, 3.0, False), (2, 30.0, True)])
def test_a_measurement_of_other_joints_is_no_repeat(
    joint: int, by: float, refused: bool, tmp_path: Path
) -> None:
    plan = made(repeat=2)
    rows: list[dict[str, Any]] = [
        {"shot": shot.shot, "target": shot.target, "joints_deg": [*shot.joints_deg]}
        | ({} if shot.again is None else {"again": shot.again})
        for shot in plan.shots
    ]
    rows[8]["joints_deg"][joint] += by
    first = {"schema": "zerobeam/run/1", "robot": "irb1600", "tool": LASER}
    lines = map(json.dumps, [first | {"noise": {"joint_deg": 0.01, "spot_mm": 0.05}}, *rows])
    file = tmp_path / "run.jsonl"
    file.write_text("\n".join(lines) + "\n")
    if not refused:
        assert {shot.shot: shot.again for shot in read_run(file).shots}[8] == 1
        return
    with pytest.raises(BadInput, match="measurement 8 repeats 1, but has other joints") as error:
        read_run(file)
    assert error.value.line == 10
    assert error.value.found == "joint 3 differs by 30 deg"


def test_a_run_carries_the_repeats_out_and_knows_them(tmp_path: Path) -> None:
    made(tmp_path / "plan.yaml", repeat=2)
    ended = zerobeam("run", tmp_path / "plan.yaml", "--rig", "simulated", "-o", tmp_path / "run.jsonl")
    assert ended.status == 0, ended.err
    shots = [json.loads(line) for line in (tmp_path / "run.jsonl").read_text().splitlines()[1:]]
    assert [shot.get("again") for shot in shots] == [None] * 7 + [0, 1]


@pytest.mark.long
def test_an_adaptive_run_ends_with_what_it_measured_first(tmp_path: Path) -> None:
    made(tmp_path / "plan.yaml", shots=10, repeat=2)
    ended = zerobeam(
        "run", tmp_path / "plan.yaml", "--rig", "simulated", "--adaptive", "-o", tmp_path / "run.jsonl"
    )
    assert ended.status == 0, ended.err
    shots = [json.loads(line) for line in (tmp_path / "run.jsonl").read_text().splitlines()[1:]]
    first = [shot["shot"] for shot in shots[:2]]
    assert [shot["again"] for shot in shots[-2:]] == first
    assert [shot["shot"] for shot in shots[-2:]] == [number + 12 for number in first]
    assert all("again" not in shot for shot in shots[:-2])
    refused = zerobeam(
        "run", tmp_path / "plan.yaml", "--rig", "simulated", "--repeat", "1", "-o", tmp_path / "b"
    )
    assert "--repeat is for an adaptive run" in refused.err


def test_what_was_measured_again_is_measured_once_more(tmp_path: Path) -> None:
    """The command of the remedy for repeats that do not agree: twice is enough, and it ends."""
    made(tmp_path / "plan.yaml", repeat=2)
    run = ("run", tmp_path / "plan.yaml", "--rig", "simulated", "-o", tmp_path / "run.jsonl")
    assert zerobeam(*run).status == 0
    for _ in range(2):
        ended = zerobeam(*run, "--resume", "--once-more")
        assert ended.status == 0, ended.err
        shots = read_run(tmp_path / "run.jsonl").shots
        assert [(shot.shot, shot.again) for shot in shots[7:]] == [(7, 0), (8, 1), (9, 0), (10, 1)]
    assert "--once-more goes on with a run" in zerobeam(*run[:-1], tmp_path / "b", "--once-more").err


@pytest.mark.long
def test_the_remedy_for_repeats_that_differ_is_that_command() -> None:
    rng = np.random.default_rng(3)
    plan = typical(repeat=2)
    joints, _ = Arms.at_random(1, rng).recorded(plan.postures, TARGET, rng)
    own = plan.header.model_copy(update={"provenance": {"plan sha256": "0"}})

    def after(jump_deg: float, again: int) -> Solution:
        """As if the zero of J4 had jumped before the repeats."""
        rows = np.concatenate([joints[0], joints[0][7:]])[: 7 + again]
        rows[7:, 3] += np.radians(jump_deg)
        return solve_run(Problem.build(own, irb1600(), rows, ["psd"] * len(rows)), own)

    def doubted(solution: Solution) -> bool:
        return solution.misfit is None and repeats_differ(solution.problem, solution.fit.x) is not None

    for again in (2, 4):  # once, twice
        solution = next(one for k in range(60) if doubted(one := after(0.02 * k, again)))
        action = message_so_far(solution, "run.jsonl", own).action
        once = again == 2
        typed = "zerobeam run PLAN -o run.jsonl --rig RIG --resume --once-more"  # nothing says how
        assert action.command == (typed if once else None)
        for origin, rig in (
            ({"origin": "by hand"}, "--rig=manual"),
            ({"origin": "simulated", "seed": 7}, "--seed=7"),
        ):
            header = own.model_copy(update={"provenance": {**own.provenance, **origin}})
            command = message_so_far(solution, "run.jsonl", header).action.command
            assert command == (typed.replace("--rig RIG", rig) if once else None)
        assert ("once more" in action.text) == once
        assert "ook for what changed the zero of" in action.text


# What a run makes of it


def outcome(plan: Plan, jump_deg: float, count: int, seed: int) -> tuple[int, int, int]:
    """Of arms as they are, whose zero of one joint jumps halfway: how many pass, how many of these have an
    offset that is wrong by more than 4 u for the arm at the end, and how many the repeats alone doubt."""
    rng = np.random.default_rng(seed)
    arms = Arms.at_random(count, rng)
    joint = rng.integers(1, 5, size=count)
    after = arms.offsets.copy()
    after[np.arange(count), joint] += np.radians(jump_deg)
    half = len(plan.postures) // 2
    parts = [
        replace(arms, offsets=offsets).recorded(postures, TARGET, rng)
        for offsets, postures in ((arms.offsets, plan.postures[:half]), (after, plan.postures[half:]))
    ]
    joints, hit = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    passes = wrong = doubted = 0
    with one_blas_thread():
        for k in range(count):
            rows = joints[k][hit[k]]
            solution = solve_run(
                Problem.build(plan.header, irb1600(), rows, ["psd"] * len(rows)), plan.header
            )
            if solution.misfit is not None:
                continue
            if repeats_differ(solution.problem, solution.fit.x) is not None:
                doubted += 1
                continue
            passes += 1
            z = (solution.fit.x[1:6] - after[k, 1:]) / solution.std[1:6]
            wrong += bool(np.abs(z[:4]).max() > 4)
    return passes, wrong, doubted


@functools.cache
def typical(repeat: int) -> Plan:
    request = plan_request(header=header(LASER, target=None, geometry=None), repeat=repeat)
    plan = make_plan(request, None, lambda stage, share: None).plan
    assert plan is not None
    return plan


def test_a_zero_that_jumps_is_found_by_what_is_measured_again() -> None:
    passes, wrong, _ = outcome(typical(repeat=2), 0.4, 4, 1)
    assert (passes, wrong) == (0, 0)
    # The control: without repeats such arms pass, and are wrong.
    passes, wrong, _ = outcome(typical(repeat=0), 0.4, 8, 1)
    assert wrong >= 2


@pytest.mark.long
@pytest.mark.parametrize("jump_deg", [0.05, 0.1, 0.2, 0.4])
def test_no_jump_of_seven_measurements_hides(jump_deg: float) -> None:
    _, wrong, _ = outcome(typical(repeat=2), jump_deg, 200, 2)
    assert wrong <= 0.02 * 200  # of all arms: most of them do not pass, and few passes prove little


@pytest.mark.long
def test_steady_arms_are_seldom_doubted() -> None:
    _, wrong, doubted = outcome(typical(repeat=2), 0.0, 400, 3)
    assert wrong <= 4
    assert 1 <= doubted <= 12  # one in a hundred by its level; Bonferroni's bound makes it rarer


def test_repeats_lower_the_risk() -> None:
    plans = [typical(repeat=repeat) for repeat in (0, 2)]
    risks = []
    for plan in plans:
        problem = Problem.from_plan(plan)
        x = problem.nominal()
        problem = problem.at_predicted(x)
        identified = identify(problem, x)
        risks.append({row.wrong: row for row in powers(problem, x, identified)})
        assert len(repeated(problem)) == len(plan.shots) - 7
    assert {row.again for row in risks[0].values()} == {0.0}
    assert {row.again for row in risks[1].values()} == {2 / 7}
    for wrong in ("jump", "drift", "moved"):
        assert risks[1][wrong].risk < 0.2 < 0.9 < risks[0][wrong].risk
        assert risks[1][wrong].hidden_tcp_mm < risks[0][wrong].hidden_tcp_mm / 2


@pytest.mark.parametrize("arm", range(4))
@pytest.mark.one_in(4)
def test_repeats_that_are_elsewhere_are_said_before_any_noise(arm: int) -> None:
    """Readings of both repeats, or of one, 5 mm off: that they disagree is said first, and nothing that is
    wrong all along is called its cause."""
    rng = np.random.default_rng(5)
    plan = typical(repeat=2)
    arms = Arms.at_random(4, rng)
    joints, hit = arms.recorded(plan.postures, TARGET, rng)
    assert hit.all()
    problem = Problem.build(plan.header, irb1600(), joints[arm], ["psd"] * len(joints[arm]))
    for off in ([[0.0, 5.0], [5.0, 0.0]], [[5.0, 0.0], [0.0, 0.0]]):
        spots = problem.spots.copy()
        spots[7:] += off
        solution = solve_run(replace(problem, spots=spots), plan.header)
        apart = solution.contradictions[0]
        assert isinstance(apart, RepeatsApart)
        assert apart.again == (7, 8)
        assert apart.size_mm == pytest.approx(np.hypot(*off[0]) / (1 if off[1][0] else 2**0.5), rel=0.4)
        causes = {one.cause for one in diagnose(solution)}
        assert causes <= {"repeats", "measurements", "moved_target", "jump", "drift", "backlash", "noise"}
        assert causes & {"repeats", "measurements"}
    # The control: readings that are wrong all along are the same when they are repeated.
    solution = solve_run(problem.moved(problem.joints[:, [0, 2, 1, 3, 4, 5]]), plan.header)
    assert solution.misfit is not None
    assert not any(isinstance(one, RepeatsApart) for one in solution.contradictions)


def test_what_differs_by_noise_alone_is_said_so_last() -> None:
    repeats, noise = (
        Explanation(cause, (), (), (7, 8), 10.0, 0.9, 7.0, 1.0, 1.0, 0.0, 1e-5, True, odds=odds)
        for cause, odds in (("repeats", 0.4), ("noise", 1.0))
    )
    assert undecided((noise, repeats)) == (repeats, noise)
    assert undecided((noise, replace(repeats, cause="jump")))[0] is noise
    assert "repeats that differ from the first measurements (without the repeats 7 and 8), or noise" in (
        cause_sentence((noise, repeats))
    )
