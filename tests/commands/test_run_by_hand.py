"""`zerobeam run PLAN --rig manual`: a person is led, or a file is watched."""

import io
import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from cells import good_plan
from command_line import Answer, plan_file, zerobeam

from zerobeam.experiments.recording import Answers, RunRequest, record
from zerobeam.experiments.rigs.manual.line_sources import WatchedLines
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.plan import read_plan
from zerobeam.model.files.robot_file import BUILT_IN
from zerobeam.model.files.run import read_run

POSTURES = [
    [-69.348, -18.862, 49.270, 136.545, -39.529, -82.750],
    [70.583, -18.738, 43.354, -137.022, -72.592, 75.127],
    [48.951, 71.922, -72.708, 44.776, 95.417, -51.190],
    [48.228, -33.230, 40.231, 47.941, -67.007, -65.266],
    [-17.603, 77.423, -75.731, -39.334, 80.942, 49.244],
]
TYPED = [" ".join(map(str, posture)) for posture in POSTURES]
IN_RADIANS = ", ".join(map(str, np.radians(POSTURES[1]).round(9)))


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "plan.yaml"
    path.write_text(
        "schema: zerobeam/plan/1\nrobot: irb1600\ngeometry: exact\n"
        "tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0],"
        " sigma: {tilt_deg: 0.00001, shift_mm: 0.00001}}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\ntargets: {psd: {guess_mm: [900, 0, 0], sigma_mm: 200}}\n"
        "postures_deg:\n" + "".join(f"  - {posture}\n" for posture in POSTURES),
        encoding="utf-8",
    )
    return path


def led(plan: Path, monkeypatch: pytest.MonkeyPatch, *lines: str, asked: tuple[str, ...] = ()) -> Answer:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))
    return zerobeam("run", plan, "--rig", "manual", "-o", plan.parent / "run.jsonl", *asked)


def joints_of(plan: Path) -> dict[int, list[float]]:
    return {shot.shot: list(shot.joints_deg) for shot in read_run(plan.parent / "run.jsonl").shots}


WHOLE = dict(enumerate(POSTURES))


def test_a_person_is_led_through_the_plan(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = led(plan, monkeypatch, *TYPED)
    assert answer.status == 0, answer.err
    assert joints_of(plan) == WHOLE
    assert "Measurement 0 (0 of 5 done), target psd" in answer.err
    assert "u, ° or mm: J2" in answer.err
    assert "→" in answer.err
    assert "Pass" in answer.out


def test_a_run_that_is_paused_at_any_point_goes_on(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert led(plan, monkeypatch, *TYPED[:2], "pause", *TYPED[2:]).status == 1  # too few to pass
    assert list(joints_of(plan)) == [0, 1]
    led(plan, monkeypatch, TYPED[2], asked=("--resume",))  # the input ends
    answer = led(plan, monkeypatch, *TYPED[3:], asked=("--resume",))
    assert answer.status == 0
    assert "3 measurements recorded already" in answer.err
    assert joints_of(plan) == WHOLE


def test_any_common_form_over_several_lines_and_radians(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pendant = [f"J{i}= {value} deg" for i, value in enumerate(POSTURES[0], start=1)]
    lines = [
        *pendant,
        f"[{IN_RADIANS}] rad",
        TYPED[2].replace(" ", "\t"),
        f"[{TYPED[3].replace(' ', ', ')}]",
        TYPED[4],
    ]
    assert led(plan, monkeypatch, *lines).status == 0
    for number, joints in joints_of(plan).items():
        np.testing.assert_allclose(joints, POSTURES[number], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([IN_RADIANS, "rad"], "these look like radians"),
        (["1 2 3", TYPED[1]], "(3 numbers)"),
        (["1.2 70 degrees 0.5 rad 4 5 6 7", TYPED[1]], "these are not the joint values"),
        (["X 100 Y 200 Z 300 A 0 B 90 C 0", TYPED[1]], "Cartesian"),
        ([TYPED[0], TYPED[1]], "those of measurement 0: has the arm moved?"),
        (["70 -18 43 -137 -72 4750", "yes", TYPED[1]], "joint 6 is at 4750 deg, beyond its limits"),
        (
            ["20 -18.738 43.354 -137.022 -72.592 75.127", TYPED[1]],
            "the other joints are as planned: is it a typing error?",
        ),
        (["20 8.7 43.354 -137.022 -72.592 75.127", TYPED[1]], "joint 1 is at 20 deg and the plan has"),
        (["yes", TYPED[1]], "no question"),
        (["redo 7", TYPED[1]], "no measurement 7 to repeat"),
        (["help", TYPED[1]], "redo [measurement]"),
    ],
)
@pytest.mark.one_in(4)
def test_what_is_doubtful_is_said_and_not_recorded(
    lines: list[str], said: str, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = led(plan, monkeypatch, TYPED[0], *lines, *TYPED[2:])
    assert said in answer.err
    assert answer.status == 0
    for number, joints in joints_of(plan).items():
        np.testing.assert_allclose(joints, POSTURES[number], rtol=0, atol=1e-6)
    assert list(joints_of(plan)) == [0, 1, 2, 3, 4]


def test_skip_redo_comment_and_another_posture(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = "-69.4 -18.862 49.270 136.545 -39.529 -82.750"
    lines = [other, TYPED[1], "redo 0", "comment beam flickers \x1b[31m", TYPED[0]]  # 0 once more
    lines += [TYPED[3], "as 3", "skip the fence", TYPED[4]]  # posture 3 where 2 was asked, then 2 skipped
    answer = led(plan, monkeypatch, *lines)
    assert joints_of(plan) == {number: POSTURES[number] for number in (1, 0, 3, 4)}
    shots = {shot.shot: shot for shot in read_run(plan.parent / "run.jsonl").shots}
    assert shots[0].comment == "beam flickers [31m"
    assert shots[1].comment is None
    assert "Measurement 0 is removed" in answer.err
    assert "skipped" in answer.out
    # A resumed run asks for what was skipped.
    assert "Measurement 2 (4 of 5 done)" in led(plan, monkeypatch, TYPED[2], asked=("--resume",)).err
    assert set(joints_of(plan)) == {0, 1, 2, 3, 4}


def test_a_posture_that_is_missing_in_a_pipe_stops_no_other(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program writes the joints of all postures but one: those are recorded, and the one is named."""
    answer = led(plan, monkeypatch, TYPED[0], *TYPED[2:])
    assert list(joints_of(plan)) == [0, 2, 3, 4]
    assert answer.status == 1
    assert "Not complete: measurement 1 of the plan is missing" in answer.out
    assert "not recorded: 1" in answer.out
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{TYPED[1]}\n"))
    assert zerobeam(*to_go_on(answer)).status == 0
    assert set(joints_of(plan)) == set(WHOLE)


def to_go_on(answer: Answer) -> list[str]:
    """The words of the command that is printed to go on."""
    command = answer.err.partition("To go on:\n")[2].partition("stopped")[0]
    return shlex.split(command.replace("\\\n", " "))[1:]


def test_ctrl_c_says_what_is_missing_and_what_to_type(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupted(io.StringIO):
        def readline(self, *size: int) -> str:  # type: ignore[override]
            line = super().readline(*size)
            if not line:
                raise KeyboardInterrupt
            return line

    monkeypatch.setattr("sys.stdin", Interrupted(f"{TYPED[0]}\n{TYPED[1]}\n"))
    run = plan.parent / "my run.jsonl"
    answer = zerobeam("run", plan, "--rig", "manual", "--units", "deg", "-o", run)
    assert answer.status == 130
    assert "measurements 2, 3 and 4 of the plan are missing." in answer.err
    words = to_go_on(answer)
    assert words[-1] == "--resume"
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in TYPED[2:])))
    assert zerobeam(*words).status == 0
    assert len(read_run(run).shots) == 5


def test_a_measurement_after_which_nothing_agrees_is_offered_again(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Too few measurements to say which one is wrong: the last is offered, since all before it agreed."""
    wrong = [*POSTURES[4][:4], POSTURES[4][4] + 3, POSTURES[4][5]]
    answer = led(plan, monkeypatch, *TYPED[:4], " ".join(map(str, wrong)))
    text = " ".join(answer.err.split())
    assert "Measurement 3 is recorded" in text
    assert text.count("They agreed before measurement 4: 'redo 4' repeats it.") == 1, text
    plan.with_name("run.jsonl").unlink()
    answer = led(plan, monkeypatch, *TYPED)
    assert "redo" not in answer.err.partition("Measurement 0")[2]
    assert answer.status == 0


def test_what_is_not_recorded_is_in_the_last_event(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A person who reads the questions is asked; what follows an unanswered question is not recorded."""
    asked = ("--json-lines", "--scene")
    answer = led(plan, monkeypatch, TYPED[0], *TYPED[2:], asked=asked)
    events = [json.loads(line) for line in answer.out.splitlines()]
    assert list(joints_of(plan)) == [0]
    assert [event["answers"] for event in events if event["event"] == "doubt"] == [
        ["yes", "as 2"],
        ["yes", "as 3"],
        ["yes", "as 4"],
    ]
    assert (events[-1]["event"], events[-1]["missing"]) == ("end", [1, 2, 3, 4])
    assert answer.status == 1


def test_a_posture_that_was_skipped_is_not_missing(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = led(plan, monkeypatch, TYPED[0], "skip fence", *TYPED[2:], asked=("--json",))
    assert (answer.status, answer.json["missing"]) == (0, [])
    assert [own["shot"] for own in answer.json["refused"]] == [1]


def test_closing_measurements_and_an_adaptive_run_can_be_incomplete(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = led(plan, monkeypatch, *TYPED, asked=("--closing", "--json"))
    assert (answer.status, answer.json["missing"]) == (1, [5])
    (plan.parent / "run.jsonl").unlink()
    asked = ("--adaptive", "--tolerance", "0.0001", "--json")
    answer = led(plan, monkeypatch, *TYPED[:2], asked=asked)
    assert answer.json["missing"] == [2, 3, 4, 5, 6]  # two are made again
    assert answer.json["saved"] in (None, 0)


# The wrist of posture 1 as planned, and what the person typed: (joint from 1, degrees, whether it is asked).
WRIST = [(4, -137.022, False), (5, -22.6, True), (4, -87.022, True), (6, 25.1, True), (5, -67.0, False)]


@pytest.mark.parametrize(("joint", "at", "asked"), WRIST)
@pytest.mark.one_in(2)
def test_a_joint_that_aims_is_asked_about_beyond_what_aiming_needs(
    joint: int, at: float, asked: bool, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed = list(POSTURES[1])
    typed[joint - 1] = at
    line = " ".join(map(str, typed))
    answer = led(plan, monkeypatch, TYPED[0], line, *(["yes"] if asked else []), *TYPED[2:])
    assert (f"joint {joint} is at {at:.6g} deg" in answer.err) == asked
    assert ("to aim the laser" in answer.err) == asked
    assert joints_of(plan)[1] == typed  # who is sure of it says yes


def test_a_minus_sign_in_the_wrist_is_asked_about(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = good_plan(7)
    path = plan_file(tmp_path / "plan.yaml", plan)
    rows = np.degrees(plan.postures)
    lines = [" ".join(map(str, row)) for row in rows]
    for joint in (3, 4, 5):
        (tmp_path / "run.jsonl").unlink(missing_ok=True)
        wrong = rows[2].copy()
        wrong[joint] += 50 if wrong[joint] < 0 else -50
        answer = led(path, monkeypatch, *lines[:2], " ".join(map(str, wrong)), "pause")
        assert f"joint {joint + 1} is at" in answer.err
        assert [shot.shot for shot in read_run(tmp_path / "run.jsonl").shots] == [0, 1]


def test_the_measurement_that_contradicts_the_others_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = good_plan(7)
    drawn = np.random.default_rng(3)
    shots = list(simulated_shots(Truth.drawn(plan, drawn), drawn))
    path = plan_file(tmp_path / "plan.yaml", plan)

    def suspects(off_deg: float) -> set[int]:
        lines = []
        for shot in shots:
            joints = np.array(shot.joints_deg)
            joints[4] += off_deg if shot.shot == 3 else 0.0
            lines.append(" ".join(map(str, joints)))
        (tmp_path / "run.jsonl").unlink(missing_ok=True)
        events = led(path, monkeypatch, *lines, asked=("--json-lines",)).out.splitlines()
        return {each["shot"] for each in map(json.loads, events) if each["event"] == "suspect"}

    assert suspects(0.0) == set()
    assert suspects(1.0) == {3}


def test_a_fanuc_is_asked_what_joint_3_is_counted_from(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = plan.parent / "mine.yaml"
    m10ia = (BUILT_IN / "m10ia.yaml").read_text(encoding="utf-8")
    plan.write_text(
        plan.read_text(encoding="utf-8")
        .replace("irb1600", "mine.yaml")
        .replace("targets", "limits: warn\ntargets"),
        encoding="utf-8",
    )
    mine.write_text(re.sub(r"^(pendant|limits):.*\n", "", m10ia, flags=re.MULTILINE), encoding="utf-8")
    assert "counted from" in led(plan, monkeypatch, TYPED[0]).refused()
    ground = np.array(POSTURES[0]) - [0, 0, POSTURES[0][1], 0, 0, 0]
    led(plan, monkeypatch, " ".join(map(str, ground)), "pause", asked=("--j3", "ground"))
    np.testing.assert_allclose(joints_of(plan)[0], POSTURES[0], rtol=0, atol=1e-9)
    # A robot file that says so needs no option, and the person is asked for what the pendant will show.
    plan.with_name("run.jsonl").unlink()
    mine.write_text(m10ia, encoding="utf-8")
    answer = led(plan, monkeypatch, " ".join(map(str, ground)), "pause")
    np.testing.assert_allclose(joints_of(plan)[0], POSTURES[0], rtol=0, atol=1e-9)
    assert f"J3 {ground[2]:.2f}".replace("-", "−") in answer.out + answer.err


def test_values_after_an_incomplete_paste_are_not_lost(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = led(plan, monkeypatch, "J1= 1 deg, J2= 3 deg", "J3= 4 deg", "", TYPED[0], "pause")
    assert "some joints have no value" in answer.err
    assert "none for joint 4, 5, 6" in answer.err
    assert joints_of(plan) == {0: POSTURES[0]}


@pytest.mark.parametrize("names", ["", "SLURBT"])
def test_an_axis_a_line(plan: Path, monkeypatch: pytest.MonkeyPatch, names: str) -> None:
    """With the letters of a Yaskawa, and without names; one that breaks off is not mixed with the next."""
    lines = [f"{name} {value}".strip() for name, value in zip(names or [""] * 6, POSTURES[0], strict=True)]
    led(plan, monkeypatch, *lines, *lines[:3], TYPED[1], "pause")
    assert joints_of(plan) == {0: POSTURES[0], 1: POSTURES[1]}


def test_a_pause_before_the_first_measurement(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = led(plan, monkeypatch, "pause")
    assert (answer.status, answer.err.splitlines()[-1]) == (
        3,
        "error: no measurement is recorded yet: --resume goes on with run.jsonl",
    )
    led(plan, monkeypatch, TYPED[0], asked=("--resume",))
    assert joints_of(plan) == {0: POSTURES[0]}


def test_joint_3_from_the_ground_is_refused_before_there_is_a_run_file(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = "{a_mm: 400, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_deg: -170, upper_deg: 170}"
    robot = f"schema: zerobeam/robot/1\nname: two\nconvention: standard\njoints: [{row}, {row}]\n"
    (plan.parent / "two.yaml").write_text(robot, encoding="utf-8")
    head = plan.read_text(encoding="utf-8").replace("irb1600", "two.yaml").partition("postures_deg")[0]
    plan.write_text(f"{head}postures_deg: [[10, 20]]\n", encoding="utf-8")
    answer = led(plan, monkeypatch, "10 30", asked=("--j3", "ground"))
    assert "not counted from the ground" in answer.refused()
    assert not (plan.parent / "run.jsonl").exists()


@pytest.mark.parametrize("option", [("--watch", "x"), ("--cell", "x")])
def test_options_of_other_rigs(option: tuple[str, str], plan: Path) -> None:
    rig = "simulated" if option[0] == "--watch" else "manual"
    answer = zerobeam("run", plan, "--rig", rig, "-o", plan.parent / "run.jsonl", *option)
    assert option[0] in answer.refused()


def test_a_watched_file_truncated_and_half_written(plan: Path) -> None:
    """A robot writes 2 before 1, repeats itself, breaks off in a line, and the file is emptied between."""
    log, file = plan.parent / "log.txt", plan.parent / "run.jsonl"
    half, rest = TYPED[3][:13], TYPED[3][13:]
    contents = [
        "header line\n" + TYPED[0] + "\n",
        "header line\n" + TYPED[0] + "\n" + TYPED[2] + "\n" + TYPED[2] + "\n" + half,
        "header line\n" + TYPED[0] + "\n" + TYPED[2] + "\n" + TYPED[2] + "\n" + half + rest + "\n",
        "",
        "1 2\n" + TYPED[1] + "\n" + IN_RADIANS + "\n",
        "1 2\n" + TYPED[1] + "\n" + IN_RADIANS + "\n" + TYPED[4] + "\n",
    ]

    def wait(seconds: float) -> bool:
        if not contents:
            return False
        log.write_text(contents.pop(0), encoding="utf-8")
        return True

    events = []
    request = RunRequest("manual", answers=Answers(WatchedLines(log, wait)))
    record(read_plan(plan), file, request, events.append)
    assert {shot.shot: list(shot.joints_deg) for shot in read_run(file).shots} == WHOLE
    kinds = [event.kind for event in events if event.event == "doubt"]
    assert set(kinds) == {"unreadable", "repeated", "radians"}


def test_a_resumed_watch_takes_nothing_twice(plan: Path) -> None:
    log, file = plan.parent / "log.txt", plan.parent / "run.jsonl"
    log.write_text("\n".join(TYPED[:3]) + "\n", encoding="utf-8")
    request = RunRequest("manual", answers=Answers(WatchedLines(log, lambda seconds: False)))
    record(read_plan(plan), file, request, lambda event: None)
    log.write_text("\n".join(TYPED) + "\n", encoding="utf-8")
    again = RunRequest("manual", resume=True, answers=Answers(WatchedLines(log, lambda seconds: False)))
    record(read_plan(plan), file, again, lambda event: None)
    assert {shot.shot: list(shot.joints_deg) for shot in read_run(file).shots} == WHOLE


@pytest.mark.parametrize(
    "form", ["zerobeam posture {} deg {}", "14:02:07 zerobeam posture {} microdegrees [{}]"]
)
def test_the_log_of_a_plan_s_program_is_watched(plan: Path, form: str) -> None:
    """Lines of `zerobeam export plan`, which name their posture; those of a rehearsal are not recorded."""
    log, file = plan.parent / "zb_plan.log", plan.parent / "run.jsonl"
    micro = "micro" in form
    rows = [
        form.format(
            shot, (", " if micro else " ").join(str(round(v * 1e6)) if micro else str(v) for v in row)
        )
        for shot, row in reversed(WHOLE.items())
    ]
    rehearsed = rows[0].replace("posture", "rehearsal")
    log.write_text("\n".join(["zerobeam plan 0123456789ab", rehearsed, *rows]) + "\n", encoding="utf-8")
    events = []
    request = RunRequest("manual", answers=Answers(WatchedLines(log, lambda seconds: False)))
    record(read_plan(plan), file, request, events.append)
    assert {shot.shot: list(shot.joints_deg) for shot in read_run(file).shots} == WHOLE
    assert [event.kind for event in events if event.event == "doubt"] == ["unreadable", "unreadable"]
