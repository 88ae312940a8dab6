"""What the page can do of what a message says: its button, and what that does."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from ....analysis.answer.answer_message import Action
from ....analysis.observability.check import Check, carried_out
from ....experiments.makers.maker import makers
from ....model.errors import BadInput
from ....model.parsing.confinement import free_path
from ....model.records import it, record
from ....words.plan_catalogue import tried_change
from ....words.wording import listed
from ..index import Folder
from ..job_commands import job_command

Step = Literal["plan", "measure", "result", "cell"]
_DECIMALS = 6


@record(kw_only=True)
class DoesJob:
    """The button begins a job, and the page shows what it makes."""

    kind: Literal["job"] = "job"
    command: Annotated[list[str], it("what POST /api/jobs takes")]
    then: Literal["plan", "result", "file"]


@record(kw_only=True)
class DoesPostures:
    """The button gives the plan other postures."""

    kind: Literal["postures"] = "postures"
    postures_deg: list[list[float]]
    targets: Annotated[list[str] | None, it("of each, where there are several, or some are repeats")] = None
    again: Annotated[
        list[int | None] | None,
        it("the posture that each repeats; null where it is new"),
    ] = None


@record(kw_only=True)
class DoesLeaveOut:
    """The button leaves measurements out: the page shows the fit without them, and saves the run so."""

    kind: Literal["leave_out"] = "leave_out"
    measurements: list[int]


@record(kw_only=True)
class DoesStep:
    """The button leads to another step of the calibration."""

    kind: Literal["step"] = "step"
    step: Step


@record(kw_only=True)
class OfferedAction:
    """What to do next, and the button that does it."""

    text: str
    label: Annotated[str | None, it("of the button; null where the page can do nothing")]
    does: DoesJob | DoesPostures | DoesLeaveOut | DoesStep | None


def action_of_plan(check: Check, action: Action) -> OfferedAction:
    """Of a plan: its change, or the way to the measurements."""
    plan = check.aimed.plan
    rows = (plan.postures * plan.robot.display).round(_DECIMALS).tolist()
    targets = [str(name) for name in plan.called]
    again = [shot.again for shot in plan.shots]
    simple = all(each.usual for each in plan.means)
    simple = simple and not any(len(between) for between in plan.via)
    does: DoesJob | DoesPostures | DoesStep | None = None
    label: str | None = None
    if check.violations:
        broken = {each.posture for each in check.violations}
        kept = [i for i in range(len(rows)) if i not in broken]
        if simple and len(kept) >= 2:
            label = "Remove the postures that break constraints"
            does = _postures(
                [rows[i] for i in kept],
                [targets[i] for i in kept],
                [kept.index(of) if (of := again[i]) in kept else None for i in kept],
            )
    elif check.verdict == "pass" and not check.falls_short:
        label, does = "Measure", DoesStep(step="measure")
    elif simple and (tried := tried_change(check)) is not None:
        new, like = carried_out(check, tried)
        for at, joints in zip(like, (new * plan.robot.display).round(_DECIMALS).tolist(), strict=True):
            if tried.how == "add":
                rows, targets, again = [*rows, joints], [*targets, targets[at]], [*again, None]
            elif again[at] is None or tried.how == "replace":
                rows[at], again[at] = joints, None
        rows = [row if of is None else rows[of] for row, of in zip(rows, again, strict=True)]
        noun = "postures" if tried.how == "vary" else "posture"
        label, does = f"Apply the suggested {noun}", _postures(rows, targets, again)
    return OfferedAction(text=action.text, label=label, does=does)


def _postures(rows: list[list[float]], targets: list[str], again: list[int | None]) -> DoesPostures:
    repeats = any(of is not None for of in again)
    return DoesPostures(
        postures_deg=rows,
        targets=targets if repeats or len(set(targets)) > 1 else None,
        again=again if repeats else None,
    )


def action_of_result(
    folder: Folder, action: Action, run: Path | None, *, analysed: bool = True
) -> OfferedAction:
    """Of a result: the command of its message, where the app may carry it out on its run. One that was
    `analysed` is not analysed again as it is: nothing has changed."""
    words = [] if action.command is None or run is None else shlex.split(action.command)[1:]
    if dropped := _dropped(words):
        noun = "measurement" if len(dropped) == 1 else "measurements"
        does = DoesLeaveOut(measurements=list(map(int, dropped)))
        return OfferedAction(text=action.text, label=f"Leave out {noun} {listed(dropped)}", does=does)
    again = analysed and words[:1] == ["analyse"]
    made = None if run is None or again else _command(folder, words, run)
    if made is None:
        return OfferedAction(text=action.text, label=None, does=None)
    label, then = _label(made)
    return OfferedAction(text=action.text, label=label, does=DoesJob(command=made, then=then))


def _dropped(words: Sequence[str]) -> list[str]:
    """The measurements without which a command analyses."""
    if words[:1] != ["analyse"] or "--drop" not in words[:-1]:
        return []
    numbers = words[words.index("--drop") + 1].split(",")
    return numbers if all(text.isdecimal() and len(text) < 10 for text in numbers) else []


def _command(folder: Folder, words: Sequence[str], run: Path) -> list[str] | None:
    """The command with the run as it is called in the folder, and new files beside it."""
    if words[:1] == ["analyse"]:  # what a page shows is a report
        words = ["report", *words[1:], f"--out={folder.called(free_path(run.with_name('report')))}"]
    called, made = folder.called(run), list[str]()
    for i, word in enumerate(words):
        if word == run.name or (i > 0 and words[i - 1] == "--header"):
            made.append(called)
        elif i > 0 and words[i - 1] == "-o":
            made.append(folder.called(free_path(run.with_name(word))))
        else:
            made.append(word)
    try:
        job_command(folder, made)
    except BadInput:
        return None
    return made


def _label(command: Sequence[str]) -> tuple[str, Literal["plan", "result", "file"]]:
    if command[0] == "export":
        maker = next(
            (maker for maker in makers() if command[1] in [kind.name for kind in maker.offsets]), None
        )
        if maker is None or maker.vendor is None:
            return "Export the corrected robot", "file"
        return f"Export for the {maker.name} controller", "file"
    if command[0] == "plan":
        return ("Plan a verification" if command[1] == "verify" else "Plan more measurements"), "plan"
    return "Make the report", "result"
