"""An ABB robot as a rig: state, readings and RAPID by Robot Web Services, small moves by EGM.

Far moves are MoveAbsJ of the RAPID module `zerobeam_egm` (experiments/rapid), near ones are guided by EGM;
its data and the hand-shake are described in docs/abb.md. The arm moves only in automatic mode, with the
motors on, inside the robot file's limits, and once a person has said yes.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput, RigFault
from ....model.files.plan import Plan
from ....model.files.shot import Shot
from ....words.numbers import percent
from ...sensors.detectors import Image, Sensors
from .egm_client import Guidance
from .rws_client import Caution, ControllerAccess, RwsSession, require_six_axes

T = TypeVar("T")

MODULE = "zerobeam_egm"
_MOVE, _GUIDE, _NOTHING = 1, 2, 0
_NONE_YET = -1  # main replaces it by 0: then it has begun
_GUIDED_DEG = 5.0  # moves of no joint beyond it are guided
_GUIDED_SPEED = 15.0  # deg/s, below MaxSpeedDeviation in the RAPID module
_TOP_SPEED = np.radians(60.0)  # rad/s, where the robot file states none
_BEGIN_S, _STALL_S, _STALL_DEG = 3.0, 5.0, 0.001
_SAME_DEG = 0.1  # between the reading by RWS and that by EGM
_TASK = "T_ROB1"

_STATES = {
    "motoroff": "the motors are off: switch them on",
    "guardstop": "the safety chain is open (guard stop): close the cell, then switch the motors on",
    "emergencystop": "an emergency stop is pressed: find out why, release it, then switch the motors on",
    "emergencystopreset": "an emergency stop was released: confirm it by switching the motors on",
    "init": "the controller is starting: wait until it has",
    "sysfail": "the controller reports a system failure: look at its event log",
}


class AbbRig:
    """The plan's arm behind an IRC5. Before `begin` it is asked what it is; nothing moves before `move`."""

    steerable = True

    def __init__(self, plan: Plan, access: ControllerAccess, sensors: Sensors, caution: Caution) -> None:
        require_six_axes(plan.robot, "the ABB rig", "record this arm by hand and import the joints")
        absent = [target for target in plan.target_names if target not in sensors.psds]
        if absent:
            raise BadInput(
                "a target of the plan has no PSD",
                found=", ".join(absent),
                allowed=", ".join(sensors.psds),
                remedy="state its PSD among the sensors",
            )
        self._robot, self._access, self._sensors, self._caution = plan.robot, access, sensors, caution
        self.psds, self.camera = sensors.psds, sensors.camera
        speeds = np.array([joint.speed or _TOP_SPEED for joint in plan.robot.joints])
        self._speed = np.minimum(np.degrees(speeds) * caution.share, _GUIDED_SPEED)
        self._session = RwsSession(access)
        self._guidance: Guidance | None = None
        self._target = plan.called[0]
        self._done = 0.0  # commands that had ended when guidance began
        self._started: float | None = None
        self._confirmed = self._running = self._lit = self._faulty = False

    def provenance(self) -> dict[str, str | int | float]:
        """For the run's header: no address and no name of anyone. A virtual controller's arm is simulated."""
        kind = self._request(
            "reading what the controller is",
            lambda rws: rws._do_get("ctrl/identity")["_embedded"]["_state"][0]["ctrl-type"],
        )
        virtual = "virtual" in str(kind).lower()
        return {"origin": f"{'simulated, virtual' if virtual else 'measured,'} ABB controller"}

    # The rig

    def now(self) -> float:
        return 0.0 if self._started is None else time.monotonic() - self._started

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)
        self._require_guided()

    def begin(self, shot: int, target: str, last: Shot | None) -> None:
        if self._started is None:  # a resumed run goes on where its clock was
            self._started = time.monotonic() - ((last and last.time_s) or 0.0)
        self._target = target
        self._require_guided()
        self._require_ready()

    def move(self, joints: Matrix) -> None:
        robot = self._robot
        inside = (joints >= robot.lower) & (joints <= robot.upper)
        if not inside.all():
            joint = int(np.flatnonzero(~inside)[0])
            raise self._failed(
                f"the move is not made: it would take joint {joint + 1} beyond the soft limits of "
                f"{robot.name} "
                f"({np.degrees(robot.lower[joint]):.1f} to {np.degrees(robot.upper[joint]):.1f} deg)"
            )
        self._require_guided()
        goal, at = joints * robot.display, self.joints() * robot.display
        try:
            if not self._confirmed:
                self._ask(at, goal)
            if not self._running:
                self._start_program()
                self._drive(goal)  # after a start of the controller the first motion may not be EGM's
            elif np.abs(goal - at).max() > _GUIDED_DEG:
                self._end_guidance()
                self._drive(goal)
            else:
                self._guide(goal)
        except RigFault as fault:
            raise self._failed(str(fault)) from None

    def joints(self) -> Matrix:
        self._require_guided()
        read = self._request("reading the joints", lambda rws: rws.get_jointtarget().robax)
        if not np.isfinite(read).all():
            raise self._failed("reading the joints: the answer has a joint that is no number")
        return np.asarray(read / self._robot.display)

    def currents(self, samples: int) -> Matrix:
        read = self._sensors.currents(self._target, samples)
        self._require_guided()
        return read

    def image(self) -> Image:
        image = self._sensors.image(self._target)
        self._require_guided()
        return image

    def laser(self, on: bool) -> None:
        self._require_guided()
        self._lit = True  # whatever becomes of the request
        self._request(
            f"switching the laser (digital output {self._caution.laser})", lambda rws: self._switch(rws, on)
        )
        self._lit = on

    def stop(self) -> None:
        """RAPID stops, the laser goes off, nothing more is sent by EGM; RigFault if that could not be sent
        and no other fault has been."""
        if self._guidance is not None:
            self._guidance.close()
            self._guidance = None
        failed: list[str] = []
        if self._running:
            failed += self._try("stopping RAPID", lambda rws: rws.stop())
            self._running = bool(failed)
        if self._lit:
            dark = self._try("laser off", lambda rws: self._switch(rws, False))
            self._lit = bool(dark)
            failed += dark
        if not failed:
            self._session.close()
        elif not self._faulty:
            self._faulty = True
            raise RigFault(
                f"{'; '.join(failed)}. The arm may move and the laser may shine: press the emergency stop"
            )

    # What has to be so

    def _request(self, what: str, call: Callable[[Any], T]) -> T:
        try:
            return self._session.ask(what, call)
        except RigFault as fault:
            # Guidance is the first to notice that the cable is out.
            why = self._guidance.fault if self._guidance is not None else ""
            raise self._failed(why or str(fault)) from None

    def _require_ready(self) -> None:
        """Automatic, motors on, no emergency stop; RigFault that says which is not."""
        self._require_motors()
        manual = self._manual()
        if manual:
            raise self._failed(manual)

    def _require_motors(self) -> None:
        why = self._motors_off()
        if why:
            raise self._failed(why)

    def _motors_off(self) -> str:
        """Why the motors are off, and what to do; "" where they are on."""
        state = self._request("reading the controller's state", lambda rws: rws.get_controller_state())
        if state == "motoron":
            return ""
        # The key takes the motors off, and to switch them on before it is turned back does not help.
        by_key = self._manual() if state == "motoroff" else ""
        return by_key or _STATES.get(state, f"the controller is in the state {state}")

    def _manual(self) -> str:
        """What to do about the operating mode; "" where it is automatic."""
        mode = self._request("reading the operating mode", lambda rws: rws.get_operation_mode())
        if mode == "AUTO":
            return ""
        return (
            f"the controller is not in automatic mode ({mode}): turn the key to automatic and confirm on the "
            "FlexPendant"
        )

    def _require_running(self) -> None:
        if self._execution() != "running":
            self._require_motors()
            self._require_no_error()
            raise self._failed("RAPID has stopped by itself: look at the event log of the FlexPendant")

    def _require_guided(self) -> None:
        """RigFault, and a stop, if guidance has met a fault in the meantime."""
        if self._guidance is not None and self._guidance.fault:
            raise self._failed(self._guidance.fault)

    def _failed(self, why: str) -> RigFault:
        """The fault to raise; the arm is stopped first."""
        if self._faulty:
            return RigFault(why)
        self._faulty = True
        guided = self._guidance is not None and bool(self._guidance.fault)
        self.stop()
        if self._running:
            shines = ", and the laser may shine" if self._lit else ""
            return RigFault(
                f"{why}. The command to stop RAPID did not arrive{shines}: press the emergency stop"
            )
        if guided:
            # EGM reports that the motors are off; the panel knows why.
            with contextlib.suppress(RigFault):
                why = self._motors_off() or why
            self._session.close()
        return RigFault(why)

    def _ask(self, at: Matrix, goal: Matrix) -> None:
        self._require_ready()
        text = (
            f"{self._robot.name} is about to move, at {percent(self._caution.share)} of its joints' top"
            f" speeds, within the soft limits of its robot file.\n"
            f"First from {_listed(at)} deg\n      to   {_listed(goal)} deg, all joints at once.\n"
            "Nobody may be in the cell, and an emergency stop must be at hand."
        )
        if not self._caution.confirm(text):
            raise RigFault("the motion was not confirmed; nothing has moved")
        self._confirmed = True

    # RAPID

    def _start_program(self) -> None:
        self._require_ready()
        if self._execution() == "running":
            raise RigFault("a RAPID program is running already: stop it on the FlexPendant first")
        ask = self._request
        tasks = ask("reading the RAPID tasks", lambda rws: rws.get_tasks())
        others = [name for name, task in tasks.items() if task.motiontask and task.active and name != _TASK]
        if others:  # MultiMove: the library's `start` would deactivate them without a word
            raise RigFault(
                f"other motion tasks are active ({', '.join(others)}), this rig drives the arm of {_TASK} "
                "alone: deselect them in the FlexPendant's task selection panel"
            )
        self._write("zb_command", str(_NONE_YET))
        ask("setting the program pointer to main", lambda rws: rws.resetpp())
        self._running, self._faulty = True, False  # from here on a stop is due, whatever comes back
        ask("starting RAPID", lambda rws: rws.start(cycle="forever"))
        ends = time.monotonic() + _BEGIN_S
        while self._number("zb_command") != _NOTHING:
            if time.monotonic() > ends:
                self._require_running()
                raise RigFault(f"RAPID runs, but not main of {MODULE}: it must be the only main of T_ROB1")
        self._write("zb_speed", f"{100 * self._caution.share:g}")

    def _drive(self, goal: Matrix) -> None:
        """MoveAbsJ to the joints (n,) deg."""
        done = self._number("zb_done")
        axes = ",".join(f"{value:.6f}" for value in goal)
        self._write("zb_target", f"[[{axes}],[{','.join(['9E9'] * 6)}]]")
        self._command(_MOVE)
        progress = _Progress()
        looks: Iterator[Callable[[], None]] = itertools.cycle(
            (self._require_motors, self._require_running, lambda: progress.look(self._read_deg()))
        )
        while self._number("zb_done") == done:
            next(looks)()
            self._write("zb_command", str(_MOVE))  # the beat: RAPID stops the arm where it fails to come
        self._require_no_error()

    def _guide(self, goal: Matrix) -> None:
        """Lead the arm to the joints (n,) deg by EGM, which stays on afterwards."""
        if self._guidance is None:
            caution, access = self._caution, self._access
            self._done = self._number("zb_done")
            self._guidance = Guidance(access.here, caution.egm_port, access.address, self._speed)
            self._command(_GUIDE)
            try:
                at = self._guidance.first()
            except RigFault:
                self._require_running()  # what stopped the program explains more
                raise
            read = self._read_deg()
            if np.abs(at - read).max() > _SAME_DEG:
                raise RigFault(
                    f"EGM says that the joints are at {_listed(at)} deg, Robot Web Services "
                    f"{_listed(read)} deg: is --egm-port that of this robot?"
                )
        self._guidance.go(goal)

    def _end_guidance(self) -> None:
        if self._guidance is None:
            return
        self._write("zb_command", str(_NOTHING))
        ends = time.monotonic() + _BEGIN_S
        while self._number("zb_done") == self._done:
            if time.monotonic() > ends:
                self._require_motors()
                self._require_running()
                raise RigFault("the guidance by EGM does not end; look at the event log")
        self._guidance.close()
        self._guidance = None
        self._require_no_error()

    def _command(self, command: int) -> None:
        self._write("zb_command", str(command))
        self._write("zb_start", "TRUE")

    def _require_no_error(self) -> None:
        if self._number("zb_error") != 0:
            raise self._failed(
                "the controller heard nothing of this computer for too long and stopped the arm. Look at the "
                "cable, and at what else this computer is doing; then go on with --resume"
            )

    def _execution(self) -> str:
        state = self._request("reading RAPID's state", lambda rws: rws.get_execution_state())
        return str(state.ctrlexecstate)

    def _read_deg(self) -> Matrix:
        return self.joints() * self._robot.display

    def _switch(self, rws: Any, on: bool) -> None:
        laser = self._caution.laser
        rws.set_digital_io(laser.name, on, laser.network, laser.unit)

    def _number(self, name: str) -> float:
        value: float = self._request(
            f"reading {name} of the RAPID module {MODULE}",
            lambda rws: rws.get_rapid_variable_num(f"{MODULE}/{name}"),
        )
        return value

    def _write(self, name: str, value: str) -> None:
        self._request(
            f"writing {name} of the RAPID module {MODULE}",
            lambda rws: rws.set_rapid_variable(f"{MODULE}/{name}", value),
        )

    def _try(self, what: str, call: Callable[[Any], None]) -> list[str]:
        """The fault of a request, if it meets one."""
        try:
            self._session.ask(what, call)
        except RigFault as fault:
            return [str(fault)]
        return []


class _Progress:
    """RigFault once joints have been at rest for too long on their way."""

    def __init__(self) -> None:
        self._at: Matrix | None = None
        self._since = time.monotonic()

    def look(self, at: Matrix) -> None:
        now = time.monotonic()
        if self._at is None or np.abs(at - self._at).max() > _STALL_DEG:
            self._at, self._since = at, now
        elif now - self._since > _STALL_S:
            raise RigFault(
                f"the arm has been at rest on its way for {_STALL_S:g} s: is the speed on the FlexPendant 0"
                " %?"
            )


def _listed(joints_deg: Matrix) -> str:
    return ", ".join(f"{value:.2f}" for value in joints_deg)
