"""The state of the controller: panel, RAPID and its data, mastership, signals, and the arm that they move.

The codes of refused requests and their names are those of "Robot controller return codes" in the manual of
Robot Web Services (3HAC050973-001). Answers of RobotWare 6.16 have been published for a symbol, a resource or
a signal that there is not, an invalid argument, a start in the wrong state, mastership that another client
holds and a signal written in manual mode. Assumed, for want of anything public, are MODE_REJECT and NOT_HELD
with their status, and that HELD answers whatever needs what another client holds (it may be MASTER_REJECT,
-1073445859, as well: the rig knows both).
"""

import math
import re
import threading
from collections.abc import Generator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from abb_controller.cell_behind import CellBehind
from abb_controller.egm_server import Egm
from zerobeam.model.arrays import Matrix


@dataclass(frozen=True)
class Code:
    """`status` is HTTP's; the name that the manual gives to the number is beside each."""

    status: int
    number: int
    words: str


NO_SUCH_SYMBOL = Code(400, -1073414146, "Symbol not found")  # SYS_CTRL_E_FAIL
NO_SUCH_RESOURCE = Code(404, -1073414146, "Resource not found")  # SYS_CTRL_E_FAIL
NO_SUCH_SIGNAL = Code(404, -1073445866, "Invalid IO signal name")  # SYS_CTRL_E_UNRESOLVED_URL
INVALID_ARGUMENT = Code(400, -1073445879, "Invalid argument")  # SYS_CTRL_E_INVALIDARG
# SYS_CTRL_E_EXEC_STATE
EXECUTION_STATE = Code(400, -1073442809, "Operation not allowed for current PGM state")
# SYS_CTRL_E_MODE_REJECT
MODE_REJECT = Code(403, -1073445860, "Operation not allowed in this operation mode")
REJECTED = Code(403, -1073445881, "Rejected")  # SYS_CTRL_E_REJECT
# SYS_CTRL_E_RESOURCE_HELD
HELD = Code(403, -1073445862, "Requested resource is held by someone else")
NOT_HELD = Code(403, -1073445880, "Resource is not held")  # SYS_CTRL_E_RESOURCE_NOT_HELD


class RequestRefused(Exception):
    """A request that the controller does not carry out."""

    def __init__(self, code: Code, why: str = "") -> None:
        self.code = code
        # The real one puts the place in its source before the words, and the code behind them.
        words = f"{code.words}: {why}" if why else code.words
        self.message = f"{words} code:{code.number} icode:-1"
        super().__init__(self.message)


MODULE = "zerobeam_egm"
_NO_AXIS = 9e9  # what RAPID writes for an external axis that there is not

JointTarget = tuple[tuple[float, ...], tuple[float, ...]]
Value = bool | float | JointTarget

_INITIAL: dict[str, Value] = {
    "zb_target": ((0.0,) * 6, (_NO_AXIS,) * 6),
    "zb_speed": 10.0,
    "zb_command": 0.0,
    "zb_start": False,
    "zb_done": 0.0,
    "zb_error": 0.0,
}
_LIST = re.compile(r"\s*\[\s*\[([^\[\]]*)\]\s*,\s*\[([^\[\]]*)\]\s*\]\s*")


class RapidData:
    """PERS data by name; `written` and `text` speak RAPID."""

    def __init__(self) -> None:
        self._values = dict(_INITIAL)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._values)

    def type_of(self, name: str) -> str:
        value = self._values[name]
        return "bool" if isinstance(value, bool) else "num" if isinstance(value, float) else "jointtarget"

    def flag(self, name: str) -> bool:
        value = self._values[name]
        assert isinstance(value, bool)
        return value

    def number(self, name: str) -> float:
        value = self._values[name]
        assert isinstance(value, float)
        return value

    def joints_deg(self, name: str) -> tuple[float, ...]:
        """The six robot axes of a jointtarget, degrees."""
        value = self._values[name]
        assert isinstance(value, tuple)
        return value[0]

    def set(self, name: str, value: bool | float) -> None:
        assert type(value) is type(self._values[name])
        self._values[name] = value

    def text(self, name: str) -> str:
        """The value as RAPID writes it."""
        value = self._values[name]
        if isinstance(value, bool):
            return "TRUE" if value else "FALSE"
        if isinstance(value, float):
            return number_text(value)
        return "[" + ",".join(f"[{','.join(map(number_text, part))}]" for part in value) + "]"

    def written(self, name: str, text: str) -> None:
        """Take a value as RAPID writes it; RequestRefused where it is none of the type."""
        value: Value | None
        if isinstance(self._values[name], bool):
            value = {"TRUE": True, "FALSE": False}.get(text.strip().upper())
        elif isinstance(self._values[name], float):
            value = _number(text)
        else:
            parts = _LIST.fullmatch(text)
            lists = (
                [] if parts is None else [[_number(v) for v in part.split(",")] for part in parts.groups()]
            )
            whole = [tuple(v for v in part if v is not None) for part in lists]
            value = (whole[0], whole[1]) if [len(part) for part in whole] == [6, 6] else None
        if value is None:
            raise RequestRefused(INVALID_ARGUMENT, f"{text[:80]} is no {self.type_of(name)}")
        self._values[name] = value


def number_text(value: float, digits: int = 6) -> str:
    """A num is of single precision; as the value of a datum it is written in six digits (9E+09, 0.866025)."""
    return format(float(np.float32(value)), f".{digits}g").upper()


def _number(text: str) -> float | None:
    try:
        value = float(np.float32(float(text)))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


class Drive:
    """A setpoint on its way in steps of `step` seconds; all (n,) are rad, rad/s, rad/s^2.

    `top` and `acceleration` are what the joints can do. Every joint accelerates to its speed and brakes as
    late as it can: k steps of braking, the last of one step's speed change, go k (k + 1) / 2 a step^2 far.
    """

    def __init__(self, at: Matrix, top: Matrix, acceleration: Matrix, step: float) -> None:
        self.at, self.goal = at.copy(), at.copy()
        self._top, self._acceleration, self._step = top, acceleration, step
        self._velocity = np.zeros_like(at)
        self._limits = (top, acceleration)
        self._resting = False

    @property
    def standing(self) -> bool:
        return not self._velocity.any()

    @property
    def arrived(self) -> bool:
        return self.standing and bool((self.at == self.goal).all())

    def go(self, goal: Matrix, share: float) -> None:
        """All joints in step, on a line in joint space, the slowest at `share` of its top speed."""
        way = np.abs(goal - self.at)
        parts = np.divide(1.0, way, out=np.full_like(way, 1e300), where=way > 0)
        self.goal, self._resting = goal.copy(), False
        self._limits = (way * (share * self._top * parts).min(), way * (self._acceleration * parts).min())

    def follow(self, goal: Matrix, speed: float) -> None:
        """Each joint for itself, at `speed` rad/s at the most."""
        self.goal, self._resting = goal.copy(), False
        self._limits = (np.minimum(self._top, speed), self._acceleration)

    def rest(self) -> None:
        """Brake, and stay there: the goal is forgotten."""
        self._resting = True

    def advance(self, held: bool) -> None:
        """One step; `held` brakes on the way, and the goal stays what it is."""
        if self.standing and (held or self._resting or self.arrived):
            return
        speed, acceleration = self._limits
        step = self._step
        change = np.maximum(acceleration * step, 1e-300)  # a joint that has no way to go has none
        way = self.goal - self.at
        steps = np.sqrt(0.25 + 2 * np.abs(way) / (change * step)) - 0.5
        ideal = np.sign(way) * np.minimum(np.minimum(speed, steps * change), np.abs(way) / step)
        if held or self._resting:
            ideal = np.zeros_like(way)
        reached = np.abs(ideal - self._velocity) <= change
        velocity = np.where(reached, ideal, self._velocity + np.sign(ideal - self._velocity) * change)
        landed = reached & (ideal == way / step)
        self.at = np.where(landed, self.goal, self.at + velocity * step)
        self._velocity = np.where(landed, 0.0, velocity)


CYCLE = 0.004  # s
PATIENCE = 1.0  # s without a word of the client: the timer of command 1, CommTimeout of EGMSetupUC
GUIDED_SPEED = np.radians(20.0)  # rad/s, MaxSpeedDeviation of EGMActJoint
LASER = "zb_laser"
DOMAINS = ("cfg", "motion", "rapid")

ControllerState = Literal["motoroff", "motoron", "emergencystop", "emergencystopreset"]
Mode = Literal["AUTO", "MANR", "MANF"]
_MOVE, _GUIDE = 1.0, 2.0
_SILENT = 1.0
_CRAWL = 1e-9  # share of the top speeds at a speed ratio of 0: the drive has no standstill on the way


class Irc5:
    """A controller with the program of `zerobeam_egm` in it; attributes are its panel.

    Every use takes its `lock`: `turn` and what a person does take it themselves, what a client asks for is
    called with it held.
    """

    def __init__(self, cell: CellBehind, egm: Egm) -> None:
        self.lock = threading.RLock()
        self.cell, self.egm = cell, egm
        self.state: ControllerState = "motoron"
        self.mode: Mode = "AUTO"
        self.speed_ratio = 100
        self.running = False
        self.cycle_mode = "forever"
        self.reason = ""  # why the program has stopped by itself, "" where it has not
        self.data = RapidData()
        self.signals = {LASER: 0}
        self.masters: dict[str, str] = {}  # domain: session
        self.remote: dict[str, bool] = {}  # session: whether remote manual mode privilege is granted to it
        self.seconds = 0.0  # of motion: those of the cell's clock
        self._now = 0.0  # of the talk
        robot = cell.robot
        self._drive = Drive(cell.counts(), cell.top_speed, cell.acceleration, CYCLE)
        self._display, self._lower, self._upper = robot.display, robot.lower, robot.upper
        self._main = self._program()

    # What the arm does

    def turn(self, now: float, cycles: int = 1) -> None:
        """Take what has come by EGM, go through so many cycles of program and motion, and send where the arm
        is; `now` in seconds."""
        with self.lock:
            self._now = now
            self.egm.receive(now)
            for _ in range(cycles):
                self._cycle()
            self.egm.tell(
                now,
                self.joints_deg(),
                self._drive.at * self._display,
                motors_on=self.state == "motoron",
                running=self.running,
                met=self._drive.arrived,
            )

    def _cycle(self) -> None:
        """4 ms of program and motion."""
        if self.running:
            next(self._main)
        # The program may have stopped in this step.
        self._drive.advance(held=not self.running)
        self.seconds += CYCLE
        self.cell.drive(self._drive.at, self.seconds)

    def joints_deg(self) -> Matrix:
        """(6,) by the encoders."""
        with self.lock:
            return self.cell.counts() * self._display

    @property
    def standing(self) -> bool:
        return self._drive.standing

    # What a person at the panel does

    def press_emergency_stop(self) -> None:
        with self.lock:
            self.state, self.running = "emergencystop", False

    def release_emergency_stop(self) -> None:
        """The button comes out: the motors stay off until they are switched on."""
        with self.lock:
            if self.state == "emergencystop":
                self.state = "emergencystopreset"

    def turn_key(self, mode: Mode) -> None:
        """The mode switch: it stops the program and takes the motors off, and what manual mode had
        granted."""
        with self.lock:
            self.mode, self.running = mode, False
            self.remote.clear()
            if self.state == "motoron":
                self.state = "motoroff"

    def grant_remote(self) -> None:
        """The person at the pendant says yes to all who ask for remote manual mode privilege."""
        with self.lock:
            self.remote = dict.fromkeys(self.remote, True)

    # What a client asks for

    def set_state(self, state: str) -> None:
        """Motors on or off."""
        if state not in ("motoron", "motoroff"):
            raise RequestRefused(INVALID_ARGUMENT, f"ctrl-state={state}")
        self._require_automatic()
        if self.state == "emergencystop":
            raise RequestRefused(REJECTED, "emergency stop")
        if state == "motoroff":
            self.running = False
        self.state = "motoron" if state == "motoron" else "motoroff"

    def set_speed_ratio(self, text: str) -> None:
        self._require_automatic()
        try:
            ratio = float(text)
        except ValueError:
            ratio = -1.0
        if not (0 <= ratio <= 100 and ratio == int(ratio)):
            raise RequestRefused(INVALID_ARGUMENT, f"speed-ratio={text[:80]}")
        self.speed_ratio = int(ratio)

    def start(self, cycle_mode: str, session: str) -> None:
        self._require_automatic()
        self._require_not_held("motion", session)
        if self.state != "motoron" or self.running:
            raise RequestRefused(EXECUTION_STATE, f"{self.state}, {self.execution}")
        if cycle_mode in ("once", "forever"):
            self.cycle_mode = cycle_mode
        elif cycle_mode != "asis":
            raise RequestRefused(INVALID_ARGUMENT, f"cycle={cycle_mode[:80]}")
        self.running, self.reason = True, ""

    def stop(self) -> None:
        """Anyone may, in any mode."""
        self.running = False

    def reset_program_pointer(self, session: str) -> None:
        self._require_automatic()
        self._require_not_held("rapid", session)
        if self.running:
            raise RequestRefused(EXECUTION_STATE, self.execution)
        self.egm.end()
        self._drive.rest()
        self._main = self._program()

    @property
    def execution(self) -> Literal["running", "stopped"]:
        return "running" if self.running else "stopped"

    def write(self, name: str, value: str, session: str) -> None:
        """A datum of the module: mastership of RAPID is taken for it where nobody has it."""
        self._require_privilege(session)
        self._require_not_held("rapid", session)
        self.data.written(name, value)

    def set_signal(self, name: str, value: str, session: str) -> None:
        self._require_privilege(session)
        if value not in ("0", "1"):
            raise RequestRefused(INVALID_ARGUMENT, f"lvalue={value[:80]}")
        self.signals[name] = int(value)
        self.cell.switch(self.signals[LASER] == 1)

    def request(self, domains: tuple[str, ...], session: str) -> None:
        """Mastership of all these domains, or of none."""
        self._require_privilege(session)
        for domain in domains:
            self._require_not_held(domain, session)
        self.masters.update(dict.fromkeys(domains, session))

    def release(self, domains: tuple[str, ...], session: str) -> None:
        if any(self.masters.get(domain) != session for domain in domains):
            raise RequestRefused(NOT_HELD)
        for domain in domains:
            del self.masters[domain]

    def leave(self, session: str) -> None:
        """A session is over: it holds nothing any more."""
        self.masters = {domain: holder for domain, holder in self.masters.items() if holder != session}
        self.remote.pop(session, None)

    def _require_automatic(self) -> None:
        if self.mode != "AUTO":
            raise RequestRefused(MODE_REJECT, self.mode)

    def _require_privilege(self, session: str) -> None:
        if self.mode != "AUTO" and not self.remote.get(session, False):
            raise RequestRefused(REJECTED, f"{self.mode} without remote manual mode privilege")

    def _require_not_held(self, domain: str, session: str) -> None:
        if self.masters.get(domain, session) != session:
            raise RequestRefused(HELD, domain)

    # The program, a step of which is 4 ms: what is said of it in the package's docstring

    def _program(self) -> Generator[None]:
        data = self.data
        data.set("zb_start", False)
        data.set("zb_command", 0.0)
        while True:
            while not data.flag("zb_start"):
                yield
            data.set("zb_start", False)
            data.set("zb_error", 0.0)
            command = data.number("zb_command")
            if command == _MOVE:
                yield from self._move()
            elif command == _GUIDE:
                yield from self._guide()
            data.set("zb_done", data.number("zb_done") + 1)
            yield

    def _move(self) -> Generator[None]:
        """VelSet, MoveAbsJ with a fine point."""
        target = np.array(self.data.joints_deg("zb_target")) / self._display
        yield from self._require_within_limits(target)
        share = np.clip(self.data.number("zb_speed"), 1, 100) / 100
        ratio: int | None = None
        self.cell.sent(target)
        watched = self._now
        while True:
            if self._now - watched >= PATIENCE:
                watched = self._now
                if self.data.number("zb_command") == 0:
                    yield from self._exit()
                self.data.set("zb_command", 0.0)
            if ratio != self.speed_ratio:
                ratio = self.speed_ratio
                self._drive.go(target, max(share * ratio / 100, _CRAWL))
            yield
            if self._drive.arrived:
                return

    def _guide(self) -> Generator[None]:
        """EGMRunJoint until the client has enough, or is silent for too long; EGM_STOP_HOLD."""
        self._drive.rest()
        self.egm.begin(self._now)
        error = 0.0
        followed: Matrix | None = None
        while self.data.number("zb_command") == _GUIDE:
            if self.egm.silence(self._now) > PATIENCE:
                error = _SILENT
                break
            if self.egm.reference_deg is not None and self.egm.reference_deg is not followed:
                followed = self.egm.reference_deg
                reference = followed / self._display
                yield from self._require_within_limits(reference)
                self._drive.follow(reference, GUIDED_SPEED)
            yield
        self._drive.rest()
        while not self._drive.standing:
            yield
        self.egm.end("MCI_ERROR" if error else "MCI_STOPPED")
        self.data.set("zb_error", error)

    def _exit(self) -> Generator[None]:
        """StopMove and EXIT: the program is over, a new start begins at main."""
        self.data.set("zb_error", _SILENT)
        self.running, self.reason = False, "the client has fallen silent"
        self._drive.rest()
        self._main = self._program()
        yield  # to the end of this step; nobody asks for another

    def _require_within_limits(self, joints: Matrix) -> Generator[None]:
        """Execution stops at a motion error, and again at every new start from there."""
        outside = np.flatnonzero((joints < self._lower) | (joints > self._upper))
        while outside.size:
            self.running, self.reason = False, f"joint {outside[0] + 1} would leave its limits"
            yield
