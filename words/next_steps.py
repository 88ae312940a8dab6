"""What to do with an answer: the message's action, values to enter, what they gain, how to verify them.

What the data do not determine is never offered: values are offered of a pass alone.
"""

from __future__ import annotations

from ..analysis.answer.answer_message import Message
from ..analysis.answer.result import EnteredValue, NextStep, NextSteps, Result
from ..analysis.diagnostics.values_to_enter import Entered
from ..model.instruments.flange_tool import FlangeTool
from . import numbers
from .controllers import export_command, lacks_factory_calibration, taken_by
from .enter import (
    WHY_THEY_DIFFER,
    conformity_sentence,
    enter_sentence,
    geometry_sentence,
    model_sentence,
)
from .message import judged, run_argument
from .provenance import is_simulated


def next_steps(result: Result, message: Message) -> NextSteps:
    """What to do with an answer, whatever its verdict; the first step is the action of its `message`."""
    action = message.action
    first = NextStep(action.text, () if action.command is None else (action.command,))
    entered = offered(result)
    if entered is not None and taken_by(result.inputs.vendor) != "offsets":
        return NextSteps((), (first, *_with_the_model(result)))
    if entered is not None:
        return NextSteps(_values(result, entered), (first, *_after_entering(result)))
    return NextSteps((), (first, *_alone(result)))


def _alone(result: Result) -> tuple[NextStep, ...]:
    """The identified offsets without the others."""
    offsets = [row for row in result.parameters if row.group == "offset"]
    open_ = [row.name for row in offsets if row.status in ("unidentifiable", "weak")]
    if not open_ or not any(row.status == "identified" for row in offsets):
        return ()
    command, file = export_command(result.inputs.vendor)
    without = " ".join(f"--without {name}" for name in open_)
    return (
        NextStep(
            "If the identified offsets are to be applied alone, at your decision:",
            (f"zerobeam {command} {run_argument(result.inputs.run)} {without} -o {file}",),
        ),
    )


def offered(result: Result) -> Entered | None:
    """The values to enter, where they may be entered: one rule for all who show them."""
    inputs = result.inputs
    nominal = lacks_factory_calibration(inputs.vendor, inputs.header.get("robot"))
    if (
        result.verdict != "pass"
        or judged(result).against
        or (nominal and not is_simulated(inputs.provenance))
    ):
        return None
    return result.entered


def _values(result: Result, entered: Entered) -> tuple[EnteredValue, ...]:
    entries = []
    for name, value in entered.values.items():
        row, k = result.parameters.named(name), result.coverage_factor
        assert row.estimate is not None
        assert row.std is not None
        entries.append(
            EnteredValue(
                name,
                numbers.estimate(value, k * entered.u[name], row.unit),
                numbers.spread(k * entered.u[name], row.unit),
                numbers.estimate(row.estimate, k * row.std, row.unit),
            )
        )
    return tuple(entries)


def _with_the_model(result: Result) -> tuple[NextStep, ...]:
    """What the corrected model gains, and how to verify it, where a controller takes no offsets."""
    run = run_argument(result.inputs.run)
    verify = NextStep(
        "Verify: measure a second run with the same header. It is predicted.",
        (f"zerobeam analyse {run} --hold-out NEW.jsonl",),
    )
    gain = " ".join(
        each for each in (model_sentence(result), conformity_sentence(result)) if each is not None
    )
    return NextStep(gain), verify


def _after_entering(result: Result) -> tuple[NextStep, ...]:
    run = run_argument(result.inputs.run)
    why = WHY_THEY_DIFFER if result.entered_geometry else None
    kinds = list(result.inputs.instruments.values())
    if len(kinds) == 1 and issubclass(kinds[0], FlangeTool):
        verify = NextStep(
            "Verify: measure a few postures of this run, chosen for the purpose, with the corrected robot."
            " The answer is pass, fail or inconclusive.",
            (f"zerobeam plan verify {run} -o verify.yaml", f"zerobeam verify {run} NEW.jsonl"),
        )
    else:
        verify = NextStep(
            "Verify before the values are entered: measure a second run with the same header. It is"
            " predicted.",
            (f"zerobeam analyse {run} --hold-out NEW.jsonl",),
        )
    gain = (enter_sentence(result), geometry_sentence(result), conformity_sentence(result), why)
    return (
        NextStep(" ".join(sentence for sentence in gain if sentence is not None)),
        verify,
    )
