"""A plan, a rig and a run file brought together: what `zerobeam run` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..analysis.observability.aim import aim_plan
from ..model.errors import BadInput, RigFault, located
from ..model.files.header import Header
from ..model.files.journal import RunJournal
from ..model.files.plan import Plan
from ..model.files.robot_file import rebased
from ..model.files.run import read_run, recorded
from ..model.instruments.registry import names_of
from ..model.kinematics.pendant import pendant_of
from ..model.kinematics.robot import same_arm
from ..model.options import J3, USUAL_REPEATS, PendantUnit
from ..words.case import RunCase
from ..words.message import acceptance_plan_message, headline_so_far, message_of_run
from ..words.plan_catalogue import violation_words
from ..words.provenance import SIMULATED, VERIFIES, true_values
from ..words.wording import listed
from .acceptance_files import offsets_to_enter
from .measuring_options import RunOptions
from .plans.constraints import require_constraints, violations
from .procedure.beam_ports import BeamPorts
from .procedure.events import Ended, Listener, RunOpened
from .procedure.session import Adaptive, InTurn, OnceMore, Order, Ports, Session, SessionResult, WithRepeats
from .rigs.abb.driver import AbbRig
from .rigs.abb.rws_client import Caution, ControllerAccess
from .rigs.at_rest import JointsAtRest
from .rigs.manual.hand_ports import HandPorts
from .rigs.manual.line_sources import Lines
from .rigs.replay import ReplayRig, require_planned
from .rigs.simulated.cell_file import CellFile, read_cell
from .rigs.simulated.simulator import SimulatedRig
from .sensors.attached import InstrumentLines
from .sensors.detectors import Sensors
from .simulate import Rehearsal, Truth


@dataclass(frozen=True)
class CorrectedArm:
    """`values` are true values by parameter (deg, mm): the offsets less what was entered (if anything was),
    the tool and the geometry as they were. `run` and `sha256` are of the run's file."""

    run: str
    sha256: str
    values: Mapping[str, float]
    entered: bool = True

    def provenance(self) -> dict[str, str]:
        """For the header of a run of this arm."""
        state = {} if self.entered else {"arm offsets": "as found, none entered"}
        return {"arm": self.run, "arm sha256": self.sha256, **state}


def corrected_arm(path: Path, plan: Plan, cell: CellFile | None, *, as_found: bool = False) -> CorrectedArm:
    """The arm of the simulated run at `path`, for a plan of the same robot in the same cell; `as_found`
    without the offsets of that run entered.

    BadInput for a run that is not simulated, of another robot, from another cell (which has the arm's
    backlash, geometry and encoders), or that does not determine all its offsets: nothing would be entered.
    """
    run = read_run(path)
    true = true_values(run.header.provenance)
    if not true:
        raise BadInput(
            "the run is not simulated: what its arm truly is, nobody knows",
            allowed="a run of zerobeam run --rig simulated",
            remedy="run the plan on the robot",
            file=path,
            line=run.header_line,
        )
    if not same_arm(run.robot, plan.robot):
        raise BadInput(
            "the plan is for another robot than the run's",
            found=f"the plan's {plan.robot.name}",
            allowed=run.robot.name,
            file=path,
            line=run.header_line,
        )
    cell_of_run, cell_sha256 = run.header.provenance.get("cell sha256"), None if cell is None else cell.sha256
    if cell_of_run != cell_sha256:
        raise BadInput(
            "the arm of the run belongs to another cell",
            found="no --cell" if cell_sha256 is None else f"a cell with SHA-256 {cell_sha256[:12]}",
            allowed="no --cell" if cell_of_run is None else f"the cell with SHA-256 {str(cell_of_run)[:12]}",
            remedy="state the cell that the run was simulated in, and no other",
            file=path,
            line=run.header_line,
        )
    entered = {} if as_found else offsets_to_enter(run)
    values = {name: value - entered.get(name, 0.0) for name, value in true.items()}
    return CorrectedArm(path.name, run.sha256, values, not as_found)


_LED = ("manual", "live")  # rigs that a person, or another program, moves


@dataclass(frozen=True)
class Controller:
    """How an ABB controller is reached, which sensors belong to it, and how carefully it is driven."""

    access: ControllerAccess
    sensors: Sensors
    caution: Caution
    about: Mapping[str, str] = field(default_factory=dict)  # what the run's provenance says of the sensors


@dataclass(frozen=True)
class Answers:
    """Where the lines of a run by hand come from, the unit of their values and what joint 3 is counted from:
    None is as the robot file states. `arm` has the joints of a live run, `instrument` what is read there, and
    `about` what the provenance says of them."""

    lines: Lines
    units: PendantUnit | None = None
    j3: J3 | None = None
    arm: JointsAtRest | None = None
    instrument: InstrumentLines | None = None
    about: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class RunRequest(RunOptions):
    """How a plan is to be carried out; `controller` is ABB's, `answers` of the rig that is a person, `scene`
    asks for the events of a picture."""

    scene: bool = False
    controller: Controller | None = None
    answers: Answers | None = None

    def enough(self, plan: Plan) -> float | None:
        """The standard uncertainty (deg; mm) at which an adaptive run ends; None for another run."""
        if not self.adaptive:
            return None
        return plan.header.tolerance.offset_deg if self.tolerance is None else self.tolerance


Provenance = dict[str, str | int | float]


@dataclass(frozen=True, eq=False)
class _Way:
    """How a plan is carried out: the ports, the order, and `about`, what the run's provenance says of them.
    `adaptive` is the order within it that says why an adaptive run ended."""

    about: Provenance
    ports: Ports
    order: Order
    adaptive: Adaptive | None = None


def record(plan: Plan, file: Path, request: RunRequest, listener: Listener) -> Ended:
    """Carry the plan out into the run file `file`; the answer is the last event (docs/files-cell.md).

    A plan that breaks its constraints moves no robot: it can be rehearsed, with a note.

    Raises BadInput before anything moves, RigFault where the rig stops: the measurements so far are in the
    file.
    """
    if request.kind not in (*_LED, "simulated"):
        plan.header.require_tool()
    if request.kind != "simulated":
        _refuse({"--arm": request.arm}, "is for the simulated rig")
    if request.kind == "abb" or request.kind in _LED:
        require_constraints(plan)
    led = _by_rig if plan.header.only_beam else _rehearsed_by_hand
    made = _by_hand if request.kind in _LED else led
    way = made(plan, request, listener)
    header = _header(plan, file, way.about)
    with _journal(plan, file, header, request) as journal:
        listener(_begin(plan, journal, request))
        result = Session(way.ports, journal, way.order).carry_out()
        torn = journal.torn
    why = None if way.adaptive is None else way.adaptive.reason
    answer = _answer(plan, file, header, result, torn, why)
    listener(answer)
    return answer


def _by_rig(plan: Plan, request: RunRequest, listener: Listener) -> _Way:
    if plan.via and (request.adaptive or request.closing or request.once_more):
        raise BadInput(
            "the plan states intermediate postures (via_deg), which are safe in its own order only",
            remedy="leave out --adaptive, --closing and --once-more, or the intermediate postures",
            file=plan.path,
        )
    rig, about = _rig(plan, request)
    ports = BeamPorts(plan, rig, listener, scene=request.scene)
    return _Way({**rig.provenance(), **about}, ports, *_order(plan, request))


def _by_hand(plan: Plan, request: RunRequest, listener: Listener) -> _Way:
    """A person, or a robot that goes its own way, says where the arm is."""
    _refuse({"--cell": request.cell, "--recorded": request.recording}, "is not for a run by hand")
    answers = request.answers
    if answers is None:
        raise BadInput("a run by hand needs somebody to answer", remedy="type the values, or state --watch")
    if answers.instrument is not None:
        _require_one_reading(plan)
    if not plan.header.only_beam:
        _refuse({"--adaptive": request.adaptive or None}, _for_a_beam(plan))
    if not plan.header.only_tools:
        options = {"--closing": request.closing or None, "--once-more": request.once_more or None}
        _refuse(options, _for_tools(plan))
    pendant, lines = pendant_of(plan.robot, answers.j3), answers.lines
    pendant.per_degree(answers.units)
    units = answers.units or pendant.unit
    arm = answers.arm
    ports = HandPorts(plan, listener, lines, pendant, units, request.scene, arm, answers.instrument)
    origin = "by hand" if arm is None else "joints read from the controller"
    about: Provenance = {"origin": origin, "plan sha256": plan.sha256, **answers.about}
    return _Way(about, ports, *_order(plan, request))


def _require_one_reading(plan: Plan) -> None:
    """BadInput for a plan of which an instrument's lines would not say what they are of."""
    postures = [shot.posture for shot in plan.shots if shot.posture is not None]
    if len(plan.header.kinds) > 1 or len(set(postures)) < len(postures):
        raise BadInput(
            "lines of an instrument are read for one instrument, once at each posture",
            found=", ".join(f"{label}: {kind.name}" for label, kind in plan.header.kinds.items()),
            remedy="leave --sensors out, and type what the instruments read",
            file=plan.path,
        )


def _for_tools(plan: Plan) -> str:
    return f"is for what meets a target; {_measures(plan)}"


def _for_a_beam(plan: Plan) -> str:
    return f"is for a {' or '.join(names_of(beam=True))}; {_measures(plan)}"


def _measures(plan: Plan) -> str:
    kinds = " and a ".join(kind.name for kind in plan.header.kinds.values())
    return f"the plan measures with a {kinds}"


def _rehearsed_by_hand(plan: Plan, request: RunRequest, listener: Listener) -> _Way:
    """What is no beam is led to its target by hand, or reads wherever the arm stands: no servo, no sensors;
    only the simulated rig can do that."""
    _refuse(
        {
            "--cell": request.cell,
            "--recorded": request.recording,
            "--adaptive": request.adaptive or None,
            "--closing": request.closing or None,
            "--once-more": request.once_more or None,
        },
        _for_a_beam(plan),
    )
    if request.kind != "simulated":
        raise BadInput(
            f"the rig {request.kind} cannot lead a {plan.header.tool_kind.name}",
            remedy=f"use a {' or '.join(names_of(beam=True))}, or --rig simulated to rehearse",
        )
    arm = None if request.arm is None else corrected_arm(request.arm, plan, None, as_found=request.as_found)
    # An arm that is known was measured before, perhaps with this seed.
    rng = np.random.default_rng(request.seed if arm is None else [request.seed, 1])
    # As found the targets are where they were in a run with this seed.
    drawn = Truth.drawn(plan, np.random.default_rng(request.seed) if request.as_found else rng)
    truth = drawn if arm is None else drawn.knowing(arm.values)
    provenance: Provenance = {
        "origin": SIMULATED,
        "seed": request.seed,
        **truth.provenance(),
        "plan sha256": plan.sha256,
        **({} if arm is None else arm.provenance()),
    }
    rehearsal = Rehearsal(truth, rng, listener)
    return _Way(provenance, rehearsal, rehearsal)


def _order(plan: Plan, request: RunRequest) -> tuple[Order, Adaptive | None]:
    """The order of the postures, and the adaptive order within it (it says why the run ended), if any."""
    enough = request.enough(plan)
    adaptive = None if enough is None else Adaptive(plan, enough, request.gain)
    order: Order = adaptive or InTurn(len(plan.postures))
    repeat = 0 if adaptive is None else USUAL_REPEATS if request.repeat is None else request.repeat
    if request.closing:  # the first of each target
        repeat = max(repeat, len({shot.target for shot in plan.shots}))
    if repeat:
        order = WithRepeats(order, len(plan.postures), repeat)
    return (OnceMore(order, len(plan.postures)) if request.once_more else order), adaptive


def _rig(plan: Plan, request: RunRequest) -> tuple[SimulatedRig | ReplayRig | AbbRig, Provenance]:
    """The rig, and what the run's provenance says of its making."""
    about: Provenance = {"plan sha256": plan.sha256}
    if request.kind == "abb":
        _refuse({"--cell": request.cell, "--recorded": request.recording}, "is not for the ABB rig")
        if request.controller is None:
            raise BadInput("the ABB rig needs a controller", remedy="state --host")
        if plan.robot.conventions.joint3 == "ground":
            raise BadInput(
                "the ABB rig drives arms whose joint 3 is counted from link 2",
                found=f"{plan.robot.name}: pendant: {{joint3: ground}}",
                remedy="export the plan as a program: zerobeam export plan rapid",
            )
        reached = request.controller
        return AbbRig(plan, reached.access, reached.sensors, reached.caution), {**about, **reached.about}
    if request.kind == "replay":
        if request.recording is None:
            raise BadInput("a replay needs a recording", remedy="name the run to be replayed: --recorded RUN")
        if request.cell is not None:
            raise BadInput("--cell is for the simulated rig", remedy="leave it out, or state --rig simulated")
        run = read_run(request.recording)
        return ReplayRig(plan, run), {**about, "recording sha256": run.sha256}
    if request.recording is not None:
        raise BadInput("--recorded is for a replay", remedy="leave it out, or state --rig replay")
    cell = CellFile()
    if request.cell is not None:
        cell = read_cell(request.cell)
        about["cell sha256"] = str(cell.sha256)
    arm = None
    if request.arm is not None:
        of_run = None if request.cell is None else cell
        arm = corrected_arm(request.arm, plan, of_run, as_found=request.as_found)
        about |= arm.provenance()
    if not request.camera:
        cell, about["camera"] = cell.model_copy(update={"camera": None}), False
    values = None if arm is None else arm.values
    with located(request.cell or plan.path):
        return SimulatedRig(plan, cell, request.seed, resumed=request.resume, arm=values), about


def _refuse(options: Mapping[str, object], why: str) -> None:
    """BadInput for the first of the options that is stated."""
    for name, value in options.items():
        if value is not None:
            raise BadInput(f"{name} {why}", remedy=f"leave {name} out")


def _header(plan: Plan, file: Path, about: Provenance) -> Header:
    """The plan's header as that of a run in `file`."""
    robot = rebased(plan.header.robot, plan.path.parent, file.parent)
    return plan.header.model_copy(update={"provenance": {**plan.header.provenance, **about}, "robot": robot})


def _journal(plan: Plan, file: Path, header: Header, request: RunRequest) -> RunJournal:
    if not request.resume:
        if request.force and file.exists():
            _require_rehearsal(file, request)
            file.unlink()
        return RunJournal(file, header)
    message = "the recording has a measurement that is not of this plan"
    remedy = "remove its line, or start without --resume under another name"
    by_hand = request.kind in _LED  # a person may have said that another posture is meant
    return RunJournal.resumed(
        file, header, lambda run: require_planned(plan, run, message, remedy, anywhere=by_hand)
    )


def _require_rehearsal(file: Path, request: RunRequest) -> None:
    """BadInput unless the file is a simulated run, to be replaced by another one: measurements never are."""
    try:
        origin = read_run(file).header.provenance.get("origin")
    except BadInput:
        origin = None
    if origin != SIMULATED or request.kind != "simulated":
        raise BadInput(
            "the file exists already, and measurements are never overwritten",
            allowed="with --force: a simulated run in the place of another simulated run",
            remedy="choose another name, or move it away first",
            file=file,
        )


def missing_words(missing: Sequence[int]) -> str:
    """Which measurements of a plan are missing; there is one at least."""
    numbers = listed([str(number) for number in missing], 99)
    one = len(missing) == 1
    return f"measurement{'' if one else 's'} {numbers} of the plan {'is' if one else 'are'} missing"


def still_to_come(plan: Plan, file: Path) -> tuple[int, ...]:
    """The measurements of the plan that the run file has not; all of one that cannot be read."""
    every = range(len(plan.postures))
    try:
        run, _ = recorded(file.read_bytes(), file)
    except (OSError, BadInput):
        return tuple(every)
    done = {shot.shot for shot in run.shots}
    return tuple(number for number in every if number not in done)


def _begin(plan: Plan, journal: RunJournal, request: RunRequest) -> RunOpened:
    return RunOpened(
        rig=request.kind,
        file=journal.path.name,
        postures=len(plan.postures),
        recorded=tuple(shot.shot for shot in journal.shots),
        tolerance=request.enough(plan),
    )


def _answer(
    plan: Plan, file: Path, header: Header, result: SessionResult, torn: str | None, why: str | None
) -> Ended:
    state = result.state
    if state is None:
        why_not = dict.fromkeys(f"{refused.reason}: {refused.found}" for refused in result.refused)
        if not why_not:
            raise RigFault(f"no measurement is recorded yet: --resume goes on with {file.name}")
        raise RigFault(f"no measurement could be recorded: {'; '.join(why_not)}")
    notes = [f"Measurement {r.shot} was refused ({r.reason}): {r.found}" for r in result.refused]
    notes += [torn] if torn else []
    # Of a plan that moves a robot there are none.
    broken = violations(aim_plan(plan))
    notes += [f"Posture {each.posture}: {violation_words(each)}" for each in broken]
    done = {*(shot.shot for shot in result.shots), *(refused.shot for refused in result.refused)}
    new = {
        shot.shot for shot in plan.shots if shot.again is None
    }  # of an adaptive run repeats are no candidates
    saved = new - done - set(result.missing)
    incomplete = ""
    if result.missing:
        incomplete = f"Not complete: {missing_words(result.missing)}. "
    verifies = header.provenance.get(VERIFIES)
    met = True
    if verifies is None:
        case = RunCase.so_far(state, file.as_posix(), header.model_dump(mode="json"))
        summary, headline, met = message_of_run(case), headline_so_far(state), not case.falls_short
    else:
        summary = acceptance_plan_message(len(result.shots), str(verifies), file.as_posix())
        headline = summary.verdict
    return Ended(
        file=file.name,
        verdict=state.verdict,
        headline=incomplete + headline,
        message=replace(summary, verdict=incomplete + summary.verdict),
        parameters=state.offsets,
        p_value=state.p_value,
        consistent=state.consistent,
        shots=tuple(shot.shot for shot in result.shots),
        refused=result.refused,
        saved=None if why is None else len(saved),
        why=why,
        seconds={name: round(value, 3) for name, value in result.seconds.items()},
        notes=tuple(notes),
        geometry=state.geometry(plan.header),
        true=true_values(header.provenance),
        missing=result.missing,
        coverage_factor=state.coverage_factor,
        verifies=None if verifies is None else str(verifies),
        tolerance=state.offset_tolerance,
        conforms=met,
    )
