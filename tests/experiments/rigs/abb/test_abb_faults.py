"""What goes wrong with an ABB controller: each fault's outcome and message, in the table of
docs/abb-faults.md, and a journal that is intact in all.

Each row is a run of its own through the simulated controller, on loopback. Where a fault ends it, what was
wrong is put right and the run is resumed.
"""

from __future__ import annotations

import functools
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from abb_controller.egm_server import PacketFaults
from abb_controller.sensor_server import CellSensors
from abb_controller.service import SimulatedController
from cells import good_plan
from controllers import UNLIMITED, Watched, quick, unhurried
from run_events import as_json

from zerobeam.experiments.procedure.events import RunEvent
from zerobeam.experiments.recording import Controller, RunRequest, record
from zerobeam.experiments.rigs.abb import rws_client as abb_rws
from zerobeam.experiments.rigs.abb.driver import AbbRig
from zerobeam.experiments.rigs.abb.rws_client import PASSWORD, Caution, find_access
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.model.errors import RigFault
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import read_run
from zerobeam.model.files.shot import Shot

pytest.importorskip("abb_robot_client")

TABLE = Path(__file__).resolve().parents[4] / "docs" / "abb-faults.md"
HEAD = ("what happens", "outcome", "message", "measurements in the file", "corrected and resumed")
SEED, WORD, WRONG = 3, "robotics", "not this one"
FEW = 2  # shots, where one is to be recorded before the fault is met; else one
# The run's noise of a shot's spot, and how many of its stds a record may be off: beyond 5 there is one in
# 270,000 of the two-dimensional normals (exp(-12.5)), and there are some 40 here.
SPOT_MM, STDS = 0.05, 5.0
JOINTS_DEG = 1e-4  # of a joint the controller tells seven digits
FAST = 5  # the arm's cycles in one of real time
CELL = {
    "camera": None,
    "arm": {"offsets_deg": {"delta2": 0.1}},
    "psd": {"rate_hz": 20_000.0, "placed": {"psd": {"centre_mm": [900.0, 0.0, 0.0]}}},
}
# A machine that is late by itself may keep feedback from coming for longer than a break that is to be borne.
# Such a trial says nothing of the rig and is made again.
LATE_S, TRIALS = 0.09, 5


@functools.cache
def plan(shots: int) -> Plan:
    return good_plan(shots, spot_mm=SPOT_MM)


@dataclass
class Session:
    """One session of a run. `off_mm` is how far from the true target the true beam was when each shot was
    recorded, `control_mm` the same for a record that is 0.5 mm off, `joints_off_deg` how far the recorded
    joints were from the arm's; `stopped` is what was said where a fault ended it."""

    controller: SimulatedController
    plan: Plan
    file: Path
    shot: int = -1
    phase: str = ""
    recorded: list[int] = field(default_factory=list)
    off_mm: list[float] = field(default_factory=list)
    control_mm: list[float] = field(default_factory=list)
    joints_off_deg: list[float] = field(default_factory=list)
    stopped: str | None = None
    on_phase: Callable[[], None] = lambda: None
    late_s: float = 0.0  # the longest time that the controller kept feedback back
    _told_s: float | None = None

    def __post_init__(self) -> None:
        self.watched = Watched(self.controller)
        self.watched.lookers.append(self._measure)

    def _measure(self, now: float) -> None:
        egm, now = self.controller.irc5.egm, time.perf_counter()
        if egm.active and egm.plugged:
            self.late_s = max(self.late_s, now - (self._told_s or now))
            self._told_s = now
        elif not egm.active:
            self._told_s = None

    def carry_out(self, password: str = WORD) -> Session:
        controller = self.controller
        access = find_access({PASSWORD: password}, host="127.0.0.1", port=controller.port)
        caution = Caution(lambda text: True, share=1.0, egm_port=controller.egm_port)
        reached = Controller(access, CellSensors(controller.irc5), caution)
        request = RunRequest("abb", resume=self.file.exists(), controller=reached)
        try:
            record(self.plan, self.file, request, self.told)
        except RigFault as fault:
            self.stopped = str(fault)
        return self

    def told(self, happened: RunEvent) -> None:
        event = as_json(happened)
        self.shot = event.get("shot", self.shot)
        self.phase = event.get("phase", self.phase)
        if event["event"] == "phase":
            self.on_phase()
        elif event["event"] == "recorded":
            shot = read_run(self.file).shots[-1]
            self.recorded.append(shot.shot)
            x, y = shot.spot_mm or (np.nan, np.nan)
            wrong = shot.model_copy(update={"spot_mm": (x + 0.4, y - 0.3)})
            self.off_mm.append(off_mm(self.controller, shot))
            self.control_mm.append(off_mm(self.controller, wrong))
            off = np.abs(np.array(shot.joints_deg) - self.controller.irc5.joints_deg()).max()
            self.joints_off_deg.append(float(off))

    def is_in(self, phase: str) -> bool:
        """Of the last shot."""
        return self.shot == len(self.plan.postures) - 1 and self.phase == phase


def off_mm(controller: SimulatedController, shot: Shot) -> float:
    """From where a shot says that the target is across the beam to where it truly is."""
    cell = controller.irc5.cell
    with controller.irc5.lock:
        link = cell._arm.link()
        (target,) = cell._functions.kernel("seen")(link, np.zeros_like(link), cell._centre())
    point, _, across = cell._parts.truth.problem.tool.nominal_beam()
    return float(np.linalg.norm((target[0] - point) @ across - np.array(shot.spot_mm)))


# When a fault is met, always at the same place of the run, and what it is

Fault = Callable[[Session], None]
When = Callable[[Session, Callable[[], None], pytest.MonkeyPatch], None]


def at_once(session: Session, meet: Callable[[], None], patch: pytest.MonkeyPatch) -> None:
    meet()


def in_a_far_move(session: Session, meet: Callable[[], None], patch: pytest.MonkeyPatch) -> None:
    """On the way to the last posture, and just before a beat."""
    write, controller = AbbRig._write, session.controller

    def beat(rig: AbbRig, name: str, value: str) -> None:
        on_its_way = not controller.irc5.standing and session.stopped is None
        if on_its_way and session.is_in("move") and (name, value) == ("zb_command", "1"):
            controller.speed_up = 1
            meet()
        write(rig, name, value)

    patch.setattr(AbbRig, "_write", beat)


def in_guidance(session: Session, meet: Callable[[], None], patch: pytest.MonkeyPatch) -> None:
    """In a turn of the last servo in which the arm is moving."""
    there = session.controller.irc5
    before = there.joints_deg()

    def look(now: float) -> None:
        nonlocal before
        at, before = before, there.joints_deg()
        if session.is_in("servo") and there.egm.active and (at != before).any():
            meet()

    session.watched.lookers.append(look)


def while_it_reads(session: Session, meet: Callable[[], None], patch: pytest.MonkeyPatch) -> None:
    """Before the joints of the last shot are read. What is used up then stays so: no long waits."""
    patch.setattr(abb_rws, "_BUSY_S", (0.01, 0.01))
    session.on_phase = lambda: meet() if session.is_in("settle") else None


def nothing(session: Session) -> None:
    pass


def key_turned(session: Session) -> None:
    session.controller.irc5.turn_key("MANR")


def motors_off(session: Session) -> None:
    session.controller.irc5.state = "motoroff"


def emergency_stop(session: Session) -> None:
    session.controller.irc5.press_emergency_stop()


def mastership(session: Session) -> None:
    there = session.controller.irc5
    with there.lock:
        there.request(("rapid",), "another")


def no_requests_left(session: Session) -> None:
    session.controller._rws.gate._most = 0


def cable_out(session: Session) -> None:
    session.controller.pull_cable()


def cable_out_for(seconds: float) -> Fault:
    """By the controller's clock: no timer that is late makes a longer break of it."""

    def pull(session: Session) -> None:
        began = session.controller.irc5._now
        session.controller.pull_cable()

        def look(now: float) -> None:
            if now - began >= seconds:
                session.controller.put_cable()
                session.watched.lookers.remove(look)

        session.watched.lookers.append(look)

    return pull


def put_right(controller: SimulatedController) -> None:
    """What a person does: cable in, other clients off, emergency stop pressed and released, key to automatic,
    motors on."""
    controller.put_cable()
    controller._rws.gate._most = UNLIMITED
    there = controller.irc5
    with there.lock:
        there.masters.clear()
        there.press_emergency_stop()
        there.release_emergency_stop()
        there.turn_key("AUTO")
        there.set_state("motoron")


RECORDED, REFUSED, STOPPED = "recorded", "refused, nothing has moved", "stopped"


@dataclass(frozen=True)
class Case:
    """One row of the table. `says` is in its message; with `timed` the time-outs are as they are; with
    `turned_away` there are requests that are (503)."""

    what: str
    fault: Fault = nothing
    when: When = at_once
    outcome: str = RECORDED
    says: str = ""
    password: str = WORD
    timed: bool = False
    turned_away: bool = False
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def shots(self) -> int:
        return FEW if self.outcome == STOPPED or self.what == NO_FAULT else 1

    @property
    def recorded(self) -> int:
        """Before the fault."""
        return {RECORDED: self.shots, STOPPED: self.shots - 1, REFUSED: 0}[self.outcome]


def packets(**share: float) -> dict[str, Any]:
    return {"packet_faults": PacketFaults(**share)}


NO_FAULT = "no fault"
CASES = [
    Case(NO_FAULT),
    Case("the password is wrong", outcome=REFUSED, says="user and password", password=WRONG),
    Case("the key is at manual", key_turned, outcome=REFUSED, says="not in automatic mode (MANR)"),
    Case("the motors are off", motors_off, outcome=REFUSED, says="the motors are off"),
    Case("a second client holds the write access", mastership, outcome=REFUSED, says="another client holds"),
    Case(
        "a second client takes the write access during a far move",
        mastership,
        in_a_far_move,
        STOPPED,
        "another client holds",
    ),
    Case("emergency stop during a far move", emergency_stop, in_a_far_move, STOPPED, "stop is pressed"),
    Case("emergency stop during guidance", emergency_stop, in_guidance, STOPPED, "stop is pressed"),
    Case("the cable is out for 0.05 s during guidance", cable_out_for(0.05), in_guidance, timed=True),
    Case(
        "the cable is out for 0.5 s during guidance",
        cable_out_for(0.5),
        in_guidance,
        STOPPED,
        "no feedback by EGM for 100 ms",
        timed=True,
    ),
    Case("the cable is out for 0.5 s during a far move", cable_out_for(0.5), in_a_far_move, timed=True),
    Case(
        "the cable is out for good during guidance",
        cable_out,
        in_guidance,
        STOPPED,
        "The command to stop RAPID did not arrive, and the laser may shine: press the emergency stop",
        timed=True,
    ),
    Case(
        "the cable is out for good during a far move",
        cable_out,
        in_a_far_move,
        STOPPED,
        "The command to stop RAPID did not arrive: press the emergency stop",
        timed=True,
    ),
    Case(
        "the controller answers fewer requests a second than are made",
        turned_away=True,
        options={"requests_a_second": 20},
    ),
    Case(
        "other clients use up all requests that the controller answers",
        no_requests_left,
        while_it_reads,
        STOPPED,
        "too busy (503)",
        turned_away=True,
    ),
    Case("10 % of the EGM packets are lost", options=packets(lost=0.1)),
    Case("10 % of the EGM packets come behind the next", options=packets(reordered=0.1)),
    Case("10 % of the EGM packets come twice", options=packets(duplicated=0.1)),
]


@dataclass(frozen=True)
class Ran:
    """A case carried out: its session, what that `left` on the disk, whether the arm `moved`, how many
    requests were `turned_away`, and the session that went on (None: it was not stopped)."""

    first: Session
    left: bytes
    moved: bool
    turned_away: int
    resumed: Session | None

    @property
    def outcome(self) -> str:
        return RECORDED if self.first.stopped is None else STOPPED if self.moved else REFUSED


def trial(case: Case, file: Path) -> tuple[Ran, bool]:
    """The case once, and whether the machine let it be what it was to be."""
    options = {"speed_up": FAST, "requests_a_second": UNLIMITED, **case.options}
    with (
        pytest.MonkeyPatch.context() as patch,
        SimulatedController(plan(case.shots), CellFile.model_validate(CELL), SEED, **options) as controller,
    ):
        quick(patch)
        if not case.timed:
            unhurried(patch)
        first, turned_away = Session(controller, plan(case.shots), file), count_busy(controller)
        started, late_before = controller.irc5.joints_deg(), []

        def meet() -> None:
            if not late_before:
                late_before.append(first.late_s)
                case.fault(first)

        case.when(first, meet, patch)
        first.carry_out(case.password)
        left = file.read_bytes() if file.exists() else b""
        moved = bool(np.abs(controller.irc5.joints_deg() - started).max() > 0)
        late = first.late_s if case.outcome == RECORDED else late_before[0]
        resumed = None
        if first.stopped is not None:
            unhurried(patch)
            controller.speed_up = FAST
            put_right(controller)
            resumed = Session(controller, first.plan, file).carry_out()
        return Ran(first, left, moved, len(turned_away), resumed), not case.timed or late < LATE_S


def count_busy(controller: SimulatedController) -> list[float]:
    """Grows with each request that is answered by 503."""
    gate, found = controller._rws.gate, []
    busy = gate.busy

    def counted(now: float) -> bool:
        answer = busy(now)
        found.extend([now] * answer)
        return answer

    gate.busy = counted  # type: ignore[method-assign]
    return found


def carried_out(case: Case, folder: Path) -> Ran:
    """The case, until the machine has let it be what it was to be."""
    for number in range(TRIALS):
        ran, valid = trial(case, folder / f"run{number}.jsonl")
        if valid:
            break
    return ran


def row(case: Case, ran: Ran) -> str:
    said = "" if ran.first.stopped is None else ran.first.stopped
    shots = f"{len(ran.first.recorded)} of {case.shots}" if ran.left else "no file"
    again = "" if ran.resumed is None else f"{len(read_run(ran.first.file).shots)} of {case.shots}"
    return f"| {' | '.join((case.what, ran.outcome, said, shots, again))} |\n"


@pytest.mark.one_in(3)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.what)
@pytest.mark.one_in(6)
def test_a_fault_and_what_is_left_of_the_run(case: Case, tmp_path: Path) -> None:
    ran = carried_out(case, tmp_path)
    first, resumed = ran.first, ran.resumed
    assert ran.outcome == case.outcome, first.stopped
    assert case.says in (first.stopped or "")
    assert bool(case.says) == (case.outcome != RECORDED)
    assert (ran.turned_away > 0) == case.turned_away
    _require_intact(case, ran)
    for session in (first, *([] if resumed is None else [resumed])):
        _require_right(session)
    if not os.environ.get("ZEROBEAM_WRITE_GOLDEN"):
        wrong = "ZEROBEAM_WRITE_GOLDEN=1 writes it anew"
        assert row(case, ran) in TABLE.read_text(encoding="utf-8"), wrong


def _require_intact(case: Case, ran: Ran) -> None:
    """What was said to be recorded is on the disk, in whole lines, and stays there while the run goes on."""
    numbers = [json.loads(line).get("shot") for line in ran.left.splitlines()[1:]]
    assert numbers == ran.first.recorded == list(range(case.recorded))
    assert ran.left.endswith(b"\n") or not ran.left
    assert ran.first.file.read_bytes().startswith(ran.left)
    assert [shot.shot for shot in read_run(ran.first.file).shots] == list(range(case.shots))
    assert (ran.resumed is None) == (case.outcome == RECORDED)
    if ran.resumed is not None:
        assert ran.resumed.stopped is None
        assert ran.resumed.recorded == list(range(case.recorded, case.shots))


def _require_right(session: Session) -> None:
    """The true beam was at the true target, and the joints were those of the arm."""
    assert max(session.off_mm, default=0.0) < STDS * SPOT_MM < min(session.control_mm, default=np.inf)
    assert max(session.joints_off_deg, default=0.0) < JOINTS_DEG


def test_the_table_of_the_documentation_has_these_rows(tmp_path: Path) -> None:
    head = "".join(f"| {' | '.join(cells)} |\n" for cells in (HEAD, ("---",) * len(HEAD)))
    text = TABLE.read_text(encoding="utf-8")
    if os.environ.get("ZEROBEAM_WRITE_GOLDEN"):
        rows = "".join(row(case, carried_out(case, _folder(tmp_path, case))) for case in CASES)
        text = text[: text.index(f"| {HEAD[0]}")] + head + rows
        TABLE.write_text(text, encoding="utf-8")
    _, _, rows = text.partition(head)
    assert [line.split(" | ")[0].removeprefix("| ") for line in rows.splitlines()] == [c.what for c in CASES]


def _folder(parent: Path, case: Case) -> Path:
    folder = parent / str(CASES.index(case))
    folder.mkdir()
    return folder
