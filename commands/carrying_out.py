"""The command that moves an arm, or simulates one: run."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..experiments.measuring_options import RIGS, RunOptions
from ..experiments.rigs.manual.line_sources import Lines, TypedLines, WatchedLines
from ..model.errors import BadInput, RigFault
from ..model.options import Option
from .console import EXIT_STATUS, OutputLost, err, json_text, say, show_answer
from .shared_options import Json, NewRunFile, PlanFile

if TYPE_CHECKING:
    from ..experiments.recording import Answers, Controller
    from ..experiments.rigs.abb.rws_client import Caution, ControllerAccess
    from ..experiments.sensors.attached import InstrumentLines
    from ..model.files.plan import Plan


def run(
    plan: PlanFile,
    file: NewRunFile,
    options: RunOptions,
    as_json: Json = False,
    json_lines: Annotated[bool, Option("Print every event as a line of JSON as it happens.")] = False,
    scene: Annotated[
        bool, Option("With --json-lines: also where the arm is sent, what the camera sees.")
    ] = False,
) -> None:
    """Carry a plan out: bring the beam to the target from each posture, record, identify."""
    if "://" not in options.rig and options.rig not in RIGS:
        message = f"{options.rig!r} is neither {', '.join(RIGS)} nor an address as ur://HOST"
        raise typer.BadParameter(message, param_hint="'--rig'")
    options.require_consistent()
    from ..experiments.plans.constraints import require_constraints
    from ..experiments.procedure.events import ConfirmationAsked, RunEvent, event_json
    from ..experiments.recording import Answers, RunRequest, missing_words, record, still_to_come
    from ..experiments.rigs.at_rest import CentredLines
    from ..model.files.plan import read_plan
    from ..reports.output.live_view import led_view, live_view
    from ..reports.run.brief_page import ended_page
    from ..words.message import contradicted

    planned = read_plan(plan)
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
            if options.yes:
                return True
            report(ConfirmationAsked(text))
            return typer.confirm(text, err=True)

        controller: Controller | None = None
        if options.rig == "abb":
            # Plan, access, caution, then sensors: errors are reported before a port is opened.
            require_constraints(planned)
            controller = _controller(opened, planned, options, _access(options), _caution(options, confirm))
        if options.rig == "manual":
            # Of a terminal, and of the app, which asks for the scene, a person reads the questions.
            follows = not (sys.stdin.isatty() or scene)
            watch = options.watch
            lines = TypedLines(sys.stdin, follows=follows) if watch is None else WatchedLines(watch)
            instrument, about = _instrument(opened, planned, options.sensors)
            answers = Answers(lines, options.units, options.j3, None, instrument, about)
        elif options.kind == "live":
            require_constraints(planned)
            answers = _live_answers(opened, planned, options, attended=scene)
        request = RunRequest(
            **vars(options), scene=scene and json_lines, controller=controller, answers=answers
        )
        if answers is None:
            view = opened.enter_context(live_view(err))
        try:
            answer = record(planned, file, request, report)
        except (KeyboardInterrupt, RigFault) as stopped:
            missing = still_to_come(planned, file)
            some_recorded = len(missing) < len(planned.postures)
            if some_recorded or (file.exists() and isinstance(stopped, KeyboardInterrupt)):
                also = f"; {missing_words(missing)}" if missing and not options.adaptive else ""
                say(f"What is recorded stays in {file}{also}.", to=err)
                _say_how_to_go_on(plan, file, options)
            raise
    if as_json or not json_lines:
        show_answer(
            as_json, event_json(answer), lambda: ended_page(replace(answer, file=file.as_posix())), run=file
        )
    if answer.missing and not json_lines:
        _say_how_to_go_on(plan, file, options)
    done = 0 if answer.verifies else EXIT_STATUS[answer.verdict]  # a test is judged by zerobeam verify
    failed = answer.missing or not answer.conforms or contradicted(answer.verdict, answer.message)
    raise typer.Exit(1 if failed else done)


def _say_how_to_go_on(plan: Path, file: Path, options: RunOptions) -> None:
    from ..reports.output.terminal import print_blocks
    from ..reports.style.blocks import Commands

    say("To go on:", to=err)
    print_blocks(err, [Commands([options.resuming(plan, file)])])


def _live_answers(opened: ExitStack, plan: Plan, options: RunOptions, *, attended: bool) -> Answers:
    """The joints of the controller at the rig's address, taken where a line or the PSD confirms them:
    closed with `opened`. `attended`: a person reads the questions, although this is no terminal."""
    from ..experiments.procedure.rig import most
    from ..experiments.recording import Answers
    from ..experiments.rigs.at_rest import SAMPLES, CentredLines, open_joints
    from ..experiments.sensors.attached import read_sensors
    from ..model.kinematics.pendant import pendant_of

    sensors, j3 = options.sensors, options.j3
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
        dark = most(attached.currents(target, SAMPLES), SAMPLES)
        if dark is None:
            raise RigFault("most samples of the PSD do not arrive")
        say(
            "Switch the laser on. A posture is recorded where the beam rests on the centre of the PSD.",
            to=err,
        )
        lines, about = CentredLines(attached, target, dark.mean(axis=0)), attached.provenance()
    else:
        instrument, about = _instrument(opened, plan, sensors)
    joints = open_joints(options.rig, pendant_of(plan.robot, j3))
    opened.callback(joints.close)
    scheme = options.rig.partition("://")[0]
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


def _access(options: RunOptions) -> ControllerAccess:
    from ..experiments.rigs.abb.rws_client import find_access, require_extra

    require_extra()  # before anything is asked of the network
    return find_access(
        os.environ, host=options.host, port=options.port, user=options.user, password=options.password
    )


def _caution(options: RunOptions, confirm: Callable[[str], bool]) -> Caution:
    """`confirm` asks a person before the first motion."""
    from ..experiments.rigs.abb.rws_client import Caution, Signal

    return Caution(confirm, options.speed, options.egm_port, Signal.parse(options.laser))


def _controller(
    opened: ExitStack, plan: Plan, options: RunOptions, access: ControllerAccess, caution: Caution
) -> Controller:
    """How the controller is reached, and which sensors belong to it: closed with `opened`."""
    from ..experiments.recording import Controller
    from ..experiments.sensors.attached import read_sensors
    from ..experiments.sensors.detectors import RemoteSensors

    if options.sensors is None:
        remote = RemoteSensors(access.address, options.sensor_port)
        opened.callback(remote.close)
        return Controller(access, remote, caution)
    attached = read_sensors(options.sensors, plan)
    opened.callback(attached.close)
    return Controller(access, attached, caution, attached.provenance())
