"""What goes wrong on purpose: each fault's outcome, in the table of docs/faults.md, and no wrong record taken
for a good one."""

import functools
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import good_plan, plan_of
from command_line import plan_file
from run_events import as_json

from zerobeam.analysis.observability.changes import displacement
from zerobeam.experiments.procedure.beam_ports import BeamPorts
from zerobeam.experiments.procedure.events import RunEvent
from zerobeam.experiments.procedure.session import InTurn, Session, SessionResult
from zerobeam.experiments.rigs.simulated.cell_file import (
    FAULT_KINDS,
    CellFile,
    EncoderGlitch,
    Faults,
    ProcessKilled,
    PsdDropout,
    RobotStop,
)
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.model.errors import RigFault
from zerobeam.model.files.journal import RunJournal
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import read_run

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")

TABLE = Path(__file__).resolve().parents[4] / "docs" / "faults.md"
WRITES = "ZEROBEAM_WRITE_GOLDEN"
SEED = 3
# The run's noise of a shot's spot, and how many of its stds a record may be off: beyond 5 there is one in
# 270,000 of the two-dimensional normals (exp(-12.5)), and there are some 200 here.
SPOT_MM, STDS = 0.05, 5.0
FEW, ENOUGH = 4, 7  # shots; where the statistics play a part, enough of them


def fault(kind: str, shot: int = 2, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "shot": shot, **more}


@dataclass(frozen=True)
class Case:
    """One row of the table. `outcome` is a word that its outcome must have, `off_mm` how far off a
    record may be (by default what its noise makes)."""

    what: str
    faults: tuple[dict[str, Any], ...]
    outcome: str
    shots: int = FEW
    camera: bool = False
    joint_deg: float = 0.01
    noticed: bool = False
    off_mm: float = STDS * SPOT_MM

    @property
    def plan(self) -> Plan:
        whole = good_plan(ENOUGH, joint_deg=self.joint_deg, spot_mm=SPOT_MM)
        return plan_of(whole.header, whole.postures[: self.shots])

    @property
    def cell(self) -> dict[str, Any]:
        faults = {"schema": "zerobeam/cell/1", "faults": list(self.faults)}
        return faults if self.camera else {**faults, "camera": None}


CONTROL, WITH_CAMERA = "no fault", "no fault, with a camera"
BUMP = (fault("psd-bump", 3, shift_mm=[0.6, 0.8, 0.0]),)
CASES = [
    Case(CONTROL, (), "recorded"),
    Case("no fault, and more measurements", (), "recorded", shots=ENOUGH),
    Case("the PSD's link is down for a moment", (fault("psd-dropout", lasts=3),), "recorded"),
    Case("the PSD's link is down", (fault("psd-dropout"),), "refused"),
    Case("a reflection for a moment", (fault("reflection", 3, lasts=3),), "retried"),
    Case("a reflection, the beam is off the face", (fault("reflection"),), "refused"),
    Case("a reflection, the beam is on the face", (fault("reflection", 3),), "refused"),
    Case(
        "a reflection too faint to be distinguished from a brighter laser",
        (fault("reflection", 6, light=0.09, at_mm=[8.0, -6.0]),),
        "recorded",
        shots=ENOUGH,
        # The spot is read where the centre of both lights is: 0.09 / 1.09 of the 10 mm to the reflection.
        off_mm=10 * 0.09 / 1.09 + STDS * SPOT_MM,
    ),
    Case("a joint is read wrong once", (fault("encoder-glitch", joint=3, deg=0.5, lasts=1),), "retried"),
    Case("a joint is read wrong", (fault("encoder-glitch", joint=3, deg=0.1),), "refused"),
    Case("the robot stops by itself", (fault("robot-stop"),), "stopped"),
    Case("the program is killed", (fault("process-killed", call=9),), "stopped"),
    Case("someone bumps the PSD by 1 mm", BUMP, "recorded", ENOUGH, joint_deg=0.002, noticed=True),
    Case("the same where the joints are five times as noisy", BUMP, "recorded", ENOUGH),
    Case(
        "someone bumps it by 3 mm",
        (fault("psd-bump", 3, shift_mm=[1.8, 2.4, 0.0]),),
        "recorded",
        shots=ENOUGH,
        noticed=True,
    ),
    Case(WITH_CAMERA, (), "recorded", camera=True),
    Case("two black pictures", (fault("camera-black", lasts=2),), "recorded", camera=True),
    Case("all pictures are black", (fault("camera-black"),), "recorded", camera=True),
    Case("a LED is hidden in two pictures", (fault("led-occluded", lasts=2),), "recorded", camera=True),
    Case("a LED is hidden", (fault("led-occluded"),), "recorded", camera=True),
    Case("a reflection in the pictures too", (fault("reflection"),), "refused", camera=True),
]


@dataclass
class Seen:
    """What was seen of one run: `off_mm` by shot is how far from the true target the true beam was when it
    was recorded, `joints_off` (rad) how far the recorded joints were from the controller's counts."""

    file: Path
    carried: SessionResult | None = None
    events: list[dict[str, Any]] = field(default_factory=list)
    off_mm: dict[int, float] = field(default_factory=dict)
    joints_off: float = 0.0

    def of(self, event: str) -> list[dict[str, Any]]:
        return [told for told in self.events if told["event"] == event]


def session(plan: Plan, cell: CellFile, file: Path, *, resumed: bool = False) -> Seen:
    """Carry the plan out, watched from where the truth is known."""
    rig = SimulatedRig(plan, cell, SEED, resumed=resumed)
    seen = Seen(file)

    def told(happened: RunEvent) -> None:
        event = as_json(happened)
        seen.events.append(event)
        if event["event"] == "recorded":
            shot = read_run(file).shots[-1]
            link = rig._arm.link()
            (target,) = rig._functions.kernel("seen")(link, np.zeros_like(link), rig._centre())
            point, _, across = rig._parts.truth.problem.tool.nominal_beam()
            off = (target[0] - point) @ across - np.array(shot.spot_mm)
            seen.off_mm[shot.shot] = float(np.linalg.norm(off))
            joints = np.radians(shot.joints_deg) - rig._arm.read()
            seen.joints_off = max(seen.joints_off, float(np.abs(joints).max()))

    open_journal = RunJournal.resumed if resumed else RunJournal
    with open_journal(file, plan.header) as journal:
        try:
            ports = BeamPorts(plan, rig, told)
            seen.carried = Session(ports, journal, InTurn(len(plan.postures))).carry_out()
        except RigFault:
            assert seen.of("stopped")
    return seen


KILLED = """
import sys
from zerobeam.experiments.procedure.session import InTurn
from zerobeam.experiments.procedure.beam_ports import BeamPorts
from zerobeam.experiments.procedure.session import Session
from zerobeam.experiments.rigs.simulated.cell_file import read_cell
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.model.files.journal import RunJournal
from zerobeam.model.files.plan import read_plan

plan, cell, seed = read_plan(sys.argv[1]), read_cell(sys.argv[2]), int(sys.argv[4])
with RunJournal(sys.argv[3], plan.header) as journal:
    rig = SimulatedRig(plan, cell, seed)
    Session(BeamPorts(plan, rig, lambda event: None), journal, InTurn(len(plan.postures))).carry_out()
"""


def killed(plan: Plan, cell: dict[str, Any], folder: Path) -> Seen:
    """The same in a process of its own, which does not live to its end."""
    written, cell_file, file = folder / "plan.yaml", folder / "cell.yaml", folder / "run.jsonl"
    plan_file(written, plan)
    cell_file.write_text(json.dumps(cell))
    command = [sys.executable, "-c", KILLED, *map(str, (written, cell_file, file, SEED))]
    child = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert child.returncode == -signal.SIGKILL, child.stderr
    return Seen(file)


Sessions = Callable[[str], list[Seen]]


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> Sessions:
    """By case: the session, and the one that went on where it was stopped; carried out when first asked for,
    since several processes share the cases."""

    @functools.cache
    def of(what: str) -> list[Seen]:
        case = next(case for case in CASES if case.what == what)
        folder, plan, cell = tmp_path_factory.mktemp("fault"), case.plan, case.cell
        file = folder / "run.jsonl"
        if case.faults and case.faults[0]["kind"] == "process-killed":
            first = killed(plan, cell, folder)
        else:
            first = session(plan, CellFile.model_validate(cell), file)
        if first.carried is not None:
            return [first]
        return [first, session(plan, CellFile.model_validate(cell), file, resumed=True)]

    return of


def outcome(case: Case, sessions: Sessions) -> str:
    """What became of the faulty shot, in words."""
    first, *resumed = sessions(case.what)
    if resumed:
        why = first.of("stopped")[0]["why"] if first.events else "by the system"
        return f"stopped ({why}); resumed: as without a fault"
    refused = first.of("refused")
    if refused:
        return f"refused ({refused[0]['reason']})"
    retries = [event["reason"] for event in first.of("retry")]
    text = f"retried ({', '.join(retries)}), then recorded" if retries else "recorded"
    if case.shots != FEW or not case.faults:
        return text
    (shot,) = {fault["shot"] for fault in case.faults}
    own, other = (
        seen.of("recorded")[shot]["seconds"]
        for seen in (first, sessions(WITH_CAMERA if case.camera else CONTROL)[0])
    )
    return f"{text}, {own - other:.0f} s later" if own - other > 0.5 else text


def noticed(case: Case, sessions: Sessions) -> str:
    """What the statistics of the whole run say."""
    carried = sessions(case.what)[-1].carried
    moved = carried.state.moved_target
    if moved is not None:
        points = " or ".join(f"{p.after_shot} and {p.before_shot}" for p in (moved, *moved.elsewhere))
        told = f"a displacement between measurements {points}"
        return told if moved.alone is None else f"{told}, or measurement {moved.alone} off alone"
    return "nothing" if carried.state.consistent else "the residuals are larger than the noise"


def line(*cells: str) -> str:
    return f"| {' | '.join(cells)} |\n"


HEAD = line(
    "what happens", "`faults` in the cell file", "the measurement", "recorded", "the statistics notice"
) + line(*("---",) * 5)


def table() -> tuple[str, list[str]]:
    """The page before its table, and the table's lines."""
    text = TABLE.read_text(encoding="utf-8")
    start = text.index("| what happens")
    return text[:start], text[start:].splitlines(keepends=True)


def row(case: Case, sessions: Sessions) -> str:
    stated = ", ".join(f"`{{{', '.join(f'{k}: {v}' for k, v in fault.items())}}}`" for fault in case.faults)
    recorded = f"{len(read_run(sessions(case.what)[-1].file).shots)} of {len(case.plan.postures)}"
    return line(case.what, stated, outcome(case, sessions), recorded, noticed(case, sessions))


def test_every_kind_of_fault_is_in_the_table() -> None:
    assert {fault["kind"] for case in CASES for fault in case.faults} == set(FAULT_KINDS)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.what)
def test_the_outcome_is_as_stated_and_no_wrong_record_is_taken_for_a_good_one(
    case: Case, sessions: Sessions
) -> None:
    """In all records the true beam was at the true target, and the joints were those of the arm."""
    assert case.outcome in outcome(case, sessions)
    assert (noticed(case, sessions) != "nothing") == case.noticed
    whole = set(range(len(case.plan.postures)))
    recorded = {shot.shot for shot in read_run(sessions(case.what)[-1].file).shots}
    assert recorded == (whole - {case.faults[0]["shot"]} if case.outcome == "refused" else whole)
    for seen in sessions(case.what):
        assert all(off < case.off_mm for off in seen.off_mm.values())
        assert seen.joints_off < np.radians(1e-8)  # nine digits of a degree are recorded
    if not os.environ.get(WRITES):
        assert row(case, sessions) in table()[1], f"{WRITES}=1 writes {TABLE} anew"


def test_a_faint_reflection_would_be_caught_here(sessions: Sessions) -> None:
    """The control of the test above: a record that is wrong is seen to be, by more than its noise."""
    faint = next(case for case in CASES if "faint" in case.what)
    (seen,) = sessions(faint.what)
    assert seen.off_mm[6] > STDS * SPOT_MM
    assert max(off for shot, off in seen.off_mm.items() if shot != 6) < STDS * SPOT_MM


@pytest.mark.parametrize("what", ["the robot stops by itself", "the program is killed"])
def test_a_stopped_run_ends_as_an_unbroken_one(what: str, sessions: Sessions) -> None:
    first, second = sessions(what)
    (control,) = sessions(CONTROL)
    # Two shots were on the disk: the third was under way.
    assert [event["shot"] for event in second.of("recorded")] == [2, 3]
    assert first.file.read_bytes() == control.file.read_bytes()


def test_the_bump_is_found_where_it_was(sessions: Sessions) -> None:
    case = next(case for case in CASES if case.faults == BUMP and case.noticed)
    carried = sessions(case.what)[0].carried
    # Links within their tolerance explain as much, so that nothing is claimed; nominal geometry finds it.
    assert carried.state.moved_target is None
    moved = displacement(carried.state.fit)
    assert (moved.after_shot, moved.before_shot) == (2, 3)
    assert abs(moved.size_mm - 1.0) < 3 * moved.size_std_mm


def test_the_table_of_the_documentation_is_made_here(sessions: Sessions) -> None:
    """Each of its rows is held to what happened by the test of its case."""
    before, rows = table()
    if os.environ.get(WRITES):
        TABLE.write_text(before + HEAD + "".join(row(case, sessions) for case in CASES), encoding="utf-8")
        before, rows = table()
    assert "".join(rows[:2]) == HEAD
    assert [made.split(" | ")[0] for made in rows[2:]] == [f"| {case.what}" for case in CASES]


def met(schedule: Faults, kind: type, times: int) -> list[bool]:
    return [schedule.met(kind) is not None for _ in range(times)]


def test_a_fault_lasts_as_long_as_it_says_and_in_its_shot_only() -> None:
    short, whole = (
        PsdDropout(kind="psd-dropout", shot=1, lasts=2),
        EncoderGlitch(kind="encoder-glitch", shot=1, joint=1, deg=1.0),
    )
    faults = Faults([short, whole])
    faults.begin(0, None)
    assert not any(met(faults, PsdDropout, 3) + met(faults, EncoderGlitch, 3))
    faults.begin(1, 0)
    assert met(faults, PsdDropout, 4) == [True, True, False, False]
    assert all(met(faults, EncoderGlitch, 20))
    faults.begin(2, 1)
    assert not any(met(faults, PsdDropout, 3) + met(faults, EncoderGlitch, 3))


def test_faults_of_one_kind_follow_one_another() -> None:
    faults = Faults(
        [
            PsdDropout(kind="psd-dropout", shot=0, lasts=1),
            PsdDropout(kind="psd-dropout", shot=0, lasts=2),
        ]
    )
    faults.begin(0, None)
    assert met(faults, PsdDropout, 5) == [True, True, True, False, False]


def test_a_resumed_run_does_not_meet_again_what_stopped_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even after a shot that is refused once more; a stop that is still to come is met."""
    ended: list[int] = []
    monkeypatch.setattr(os, "kill", lambda pid, signal: ended.append(pid))
    schedule = [
        RobotStop(kind="robot-stop", shot=3),
        ProcessKilled(kind="process-killed", shot=3, call=1),
        RobotStop(kind="robot-stop", shot=5),
    ]

    def stops(resumed: bool) -> list[int]:
        faults, found = Faults(schedule, resumed=resumed), []
        for shot, last in ((2, 1), (3, 1), (4, 3), (5, 4)):
            faults.begin(shot, last)
            faults.called()
            if faults.met(RobotStop):
                found.append(shot)
        return found

    assert stops(resumed=True) == [5]
    assert ended == []
    assert stops(resumed=False) == [3, 5]
    assert ended == [os.getpid()]


def test_a_bump_stays(tmp_path: Path) -> None:
    faults = Faults(
        CellFile.model_validate({"faults": [*BUMP, fault("psd-bump", 5, shift_mm=[0, 0, 2.0])]}).faults
    )
    shifts: list[Sequence[float]] = []
    for shot in (0, 2, 3, 4, 5, 6):
        faults.begin(shot, None)
        shifts.append(faults.bumped().tolist())
    assert shifts == [[0, 0, 0]] * 2 + [[0.6, 0.8, 0]] * 2 + [[0.6, 0.8, 2]] * 2
