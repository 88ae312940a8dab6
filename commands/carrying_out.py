"""The command that moves an arm, or simulates one: run."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from ..experiments.rigs.manual.lines import Lines, TypedLines, WatchedLines
from ..model.errors import BadInput, RigFault
from .console import EXIT_STATUS, OutputLost, err, json_text, out, print_json, say
from .options import Camera, J3Origin, Json, NewRunFile, PlanFile, Seed

if TYPE_CHECKING:
    from ..experiments.recording import Answers, Controller
    from ..experiments.recording import RigName as RigKind
    from ..experiments.rigs.abb.access import Caution, ControllerAccess
    from ..experiments.sensors.text_lines import InstrumentLines
    from ..model.files.plan import Plan


class RigName(StrEnum):
    """What can carry a plan out."""

    SIMULATED = "simulated"
    REPLAY = "replay"
    ABB = "abb"
    MANUAL = "manual"


def _rig_name(text: str) -> str:
    """A rig's name, or the address of a controller whose joints are read."""
    if "://" not in text and text not in set(RigName):
        raise typer.BadParameter(f"{text!r} is neither {', '.join(RigName)} nor an address as ur://HOST")
    return text


def run(
    plan: PlanFile,
    file: NewRunFile,
    rig: Annotated[
        str,
        typer.Option(
            parser=_rig_name,
            metavar="RIG",
            help="What carries the plan out: simulated, replay, abb, manual; or a controller whose joints are"
            " read while its own program or a person moves the arm: SCHEME://HOST[:PORT] (ur, kuka, fanuc,"
            " yaskawa, ros).",
        ),
    ] = RigName.SIMULATED.value,
    cell: Annotated[
        Path | None, typer.Option(help="Cell file (.yaml) of the simulated rig.", show_default=False)
    ] = None,
    camera: Camera = True,
    arm: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN",
            help="Simulated: the arm of this simulated run, with its offsets entered.",
            show_default=False,
        ),
    ] = None,
    as_found: Annotated[
        bool,
        typer.Option(
            "--as-found",
            help="With --arm: without its offsets entered; with the seed of RUN the targets stay too.",
        ),
    ] = False,
    recorded: Annotated[
        Path | None, typer.Option(help="Run file that a replay gives back.", show_default=False)
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a run that was stopped.")] = False,
    adaptive: Annotated[
        bool,
        typer.Option(
            "--adaptive",
            help="Choose the next posture by the measurements so far; end when the tolerance is reached.",
        ),
    ] = False,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="With --adaptive: the standard uncertainty that is enough (deg; mm). Default: the plan's.",
            show_default=False,
        ),
    ] = None,
    host: Annotated[
        str | None, typer.Option(help="ABB: address of the controller.", show_default=False)
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="ABB: port of Robot Web Services.")] = 80,
    egm_port: Annotated[int, typer.Option(min=1, max=65535, help="ABB: own UDP port for EGM.")] = 6510,
    sensor_port: Annotated[
        int, typer.Option(min=1, max=65535, help="ABB: port of PSD and camera at the host.")
    ] = 6520,
    sensors: Annotated[
        Path | None,
        typer.Option(
            help="Sensors file. ABB: else those of the simulated controller. By hand or live: an instrument"
            " that sends lines. Live with a laser: the PSD, which confirms a posture by a centred beam.",
            show_default=False,
        ),
    ] = None,
    user: Annotated[
        str | None, typer.Option(help="ABB: user, else ZEROBEAM_ABB_USER.", show_default=False)
    ] = None,
    password: Annotated[
        str | None,
        typer.Option(help="ABB: password, else ZEROBEAM_ABB_PASSWORD or the keyring.", show_default=False),
    ] = None,
    speed: Annotated[float, typer.Option(help="ABB: share of the joints' top speeds.")] = 0.25,
    laser: Annotated[
        str, typer.Option(help="ABB: digital output of the laser, NETWORK/UNIT/NAME.")
    ] = "Local/DRV_1/zb_laser",
    yes: Annotated[bool, typer.Option("--yes", help="ABB: move without asking first.")] = False,
    watch: Annotated[
        Path | None,
        typer.Option(help="Manual: take the joint values from this file as it grows.", show_default=False),
    ] = None,
    units: Annotated[
        Literal["deg", "rad", "pulse"] | None,
        typer.Option(
            help="Manual: unit of the joint values, if neither they nor the robot file state it (deg).",
            show_default=False,
        ),
    ] = None,
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="Manual: what joint 3 is counted from, if not as the robot file states.",
            show_default=False,
        ),
    ] = None,
    closing: Annotated[
        bool,
        typer.Option("--closing", help="Measure the first posture again at the end: has the PSD moved?"),
    ] = False,
    force: Annotated[
        bool,
        typer.Option(
            "--force",
            "--overwrite",
            help="Replace a simulated run of that name by this one; measurements are never replaced.",
        ),
    ] = False,
    seed: Seed = 0,
    as_json: Json = False,
    json_lines: Annotated[
        bool, typer.Option("--json-lines", help="Print every event as a line of JSON as it happens.")
    ] = False,
    scene: Annotated[
        bool,
        typer.Option("--scene", help="With --json-lines: also where the arm is sent, what the camera sees."),
    ] = False,
) -> None:
    """Carry a plan out: bring the beam to the target from each posture, record, identify."""
    from ..experiments.plans.constraints import require_constraints
    from ..experiments.procedure.events import ConfirmationAsked, RunEvent, event_json
    from ..experiments.recording import Answers, RunRequest, record
    from ..experiments.rigs.live.centred import CentredLines
    from ..model.files.plan import read_plan
    from ..reports.terminal.answers import print_carried
    from ..reports.terminal.live import led_view, live_view

    if tolerance is not None and not adaptive:
        raise BadInput("--tolerance is for an adaptive run", remedy="add --adaptive, or leave it out")
    live = "://" in rig
    if sensors is not None and not live and rig not in (RigName.ABB, RigName.MANUAL):
        raise BadInput(
            "--sensors is for real sensors", remedy="add --rig abb, manual or a controller's address"
        )
    if as_found and arm is None:
        raise BadInput("--as-found is for the arm of a run", remedy="add --arm RUN, or leave it out")
    if watch is not None and rig != RigName.MANUAL:
        raise BadInput("--watch is for the manual rig", remedy="add --rig manual, or leave it out")
    if force and resume:
        raise BadInput("--force and --resume contradict each other", remedy="state one of the two")
    planned = read_plan(plan)
    enough = tolerance if tolerance is not None else planned.header.tolerance.offset_deg
    with ExitStack() as opened:
        view: Callable[[RunEvent], None] = led_view(err)
        answers: Answers | None = None

        def report(event: RunEvent) -> None:
            view(event)
            if answers is not None and isinstance(answers.lines, CentredLines):
                answers.lines.hear(event)
            if json_lines:
                try:
                    sys.stdout.write(json_text(event_json(event)) + "\n")
                    sys.stdout.flush()
                except OutputLost:
                    message = f"note: the events are no longer read; the run goes on, into {file}"
                    say(message, to=err)

        def confirm(text: str) -> bool:
            if yes:
                return True
            report(ConfirmationAsked(text))
            return typer.confirm(text, err=True)

        controller: Controller | None = None
        if rig == RigName.ABB:
            # Plan, access, caution, then sensors: errors are reported before a port is opened.
            require_constraints(planned)
            access, caution = _access(host, port, user, password), _caution(speed, egm_port, laser, confirm)
            controller = _controller(opened, planned, access, sensors, sensor_port, caution)
        if rig == RigName.MANUAL:
            # Of a terminal, and of the app, which asks for the scene, a person reads the questions.
            follows = not (sys.stdin.isatty() or scene)
            lines = TypedLines(sys.stdin, follows=follows) if watch is None else WatchedLines(watch)
            instrument, about = _instrument(opened, planned, sensors)
            answers = Answers(lines, units, j3, None, instrument, about)
        elif live:
            require_constraints(planned)
            answers = _live_answers(opened, planned, rig, j3, sensors, attended=scene)
        request = RunRequest(
            rig="live" if live else cast("RigKind", rig),
            seed=seed,
            cell=cell,
            camera=camera,
            arm=arm,
            as_found=as_found,
            recording=recorded,
            resume=resume,
            tolerance=enough if adaptive else None,
            closing=closing,
            force=force,
            scene=scene and json_lines,
            controller=controller,
            answers=answers,
        )
        if answers is None:
            view = opened.enter_context(live_view(err))
        try:
            answer = record(planned, file, request, report)
        except KeyboardInterrupt:
            if file.exists():
                kept = f"What is recorded stays in {file}: --resume goes on with it."
                say(kept, to=err)
            raise
    if as_json:
        print_json(event_json(answer))
    elif not json_lines:
        print_carried(out, answer)
        say(f"Run: {file}")
    done = 0 if answer.verifies else EXIT_STATUS[answer.verdict]  # a test is judged by zerobeam verify
    raise typer.Exit(1 if answer.missing else done)


def _live_answers(
    opened: ExitStack,
    plan: Plan,
    address: str,
    j3: J3Origin | None,
    sensors: Path | None,
    *,
    attended: bool,
) -> Answers:
    """The joints of the controller at an address, taken where a line or the PSD confirms them: closed with
    `opened`. `attended`: a person reads the questions, although this is no terminal."""
    from ..experiments.recording import Answers
    from ..experiments.rigs.live.address import open_joints
    from ..experiments.rigs.live.centred import CentredLines, currents_of
    from ..experiments.sensors.attached import read_sensors
    from ..model.kinematics.pendant import pendant_of

    lines: Lines = TypedLines(sys.stdin, follows=not (sys.stdin.isatty() or attended))
    about: dict[str, str] = {}
    instrument = None
    if sensors is not None and plan.header.only_beam:
        if len(plan.target_names) > 1:
            raise BadInput(
                "which PSD confirms a posture is not clear",
                found=", ".join(plan.target_names),
                allowed="a plan with one target",
                remedy="leave --sensors out, and confirm each posture by Enter",
            )
        attached = read_sensors(sensors, plan)
        opened.callback(attached.close)
        (target,) = plan.target_names
        say("Switch the laser off, and press Enter: the ambient light is measured.", to=err)
        lines.following()
        dark = currents_of(attached, target)
        if dark is None:
            raise RigFault("most samples of the PSD do not arrive")
        say(
            "Switch the laser on. A posture is recorded where the beam rests on the centre of the PSD.",
            to=err,
        )
        lines, about = CentredLines(attached, target, dark.mean(axis=0)), attached.provenance()
    else:
        instrument, about = _instrument(opened, plan, sensors)
    joints = open_joints(address, pendant_of(plan.robot, j3))
    opened.callback(joints.close)
    scheme = address.partition("://")[0]
    about = {"controller": f"{scheme} {joints.identity}".rstrip(), **about}
    return Answers(lines, None, j3, joints, instrument, about)


def _instrument(
    opened: ExitStack, plan: Plan, sensors: Path | None
) -> tuple[InstrumentLines | None, dict[str, str]]:
    """The instrument of a plan that sends lines, if a file says so, and the provenance of its readings."""
    from ..experiments.sensors.attached import open_instrument

    if sensors is None:
        return None, {}
    instrument, about = open_instrument(sensors, plan)
    opened.callback(instrument.close)
    return instrument, about


def _access(host: str | None, port: int, user: str | None, password: str | None) -> ControllerAccess:
    from ..experiments.rigs.abb.access import find_access
    from ..experiments.rigs.abb.rws_client import require_extra

    require_extra()  # before anything is asked of the network
    return find_access(os.environ, host=host, port=port, user=user, password=password)


def _caution(speed: float, egm_port: int, laser: str, confirm: Callable[[str], bool]) -> Caution:
    """`confirm` asks a person before the first motion."""
    from ..experiments.rigs.abb.access import Caution, Signal

    return Caution(confirm, speed, egm_port, Signal.parse(laser))


def _controller(
    opened: ExitStack,
    plan: Plan,
    access: ControllerAccess,
    sensors: Path | None,
    sensor_port: int,
    caution: Caution,
) -> Controller:
    """How the controller is reached, and which sensors belong to it: closed with `opened`."""
    from ..experiments.recording import Controller
    from ..experiments.sensors.attached import read_sensors
    from ..experiments.sensors.interface import RemoteSensors

    if sensors is None:
        remote = RemoteSensors(access.address, sensor_port)
        opened.callback(remote.close)
        return Controller(access, remote, caution)
    attached = read_sensors(sensors, plan)
    opened.callback(attached.close)
    return Controller(access, attached, caution, attached.provenance())
