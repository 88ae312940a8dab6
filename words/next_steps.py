"""What to do with an answer: the message's action, values to enter, what they gain, how to verify them.

What the data do not determine is never offered: values are offered of a pass alone.
"""

from __future__ import annotations

from ..analysis.answer.findings import HeldOutMisfit, OtherBasins
from ..analysis.answer.message import Message
from ..analysis.answer.result import EnteredValue, NextStep, NextSteps, Result
from . import numbers
from .message import export_command, run_argument


def next_steps(result: Result, message: Message) -> NextSteps:
    """What to do with an answer, whatever its verdict; the first step is the action of its `message`."""
    action = message.action
    first = NextStep(action.text, () if action.command is None else (action.command,))
    against = any(isinstance(finding, OtherBasins | HeldOutMisfit) for finding in result.findings)
    if result.verdict == "pass" and not against:
        return NextSteps(_values(result), (first, *_after_entering(result)))
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


def _values(result: Result) -> tuple[EnteredValue, ...]:
    entries = []
    for row in result.parameters:
        if row.group != "offset" or row.status != "identified":
            continue
        assert row.estimate is not None
        assert row.std is not None
        u = result.coverage_factor * row.std
        entries.append(
            EnteredValue(row.name, numbers.estimate(row.estimate, u, row.unit), numbers.spread(u, row.unit))
        )
    return tuple(entries)


def _after_entering(result: Result) -> tuple[NextStep, ...]:
    run = run_argument(result.inputs.run)
    gain = "What the values gain at the TCP is not claimed: it depends on what is not determined."
    accuracy = result.accuracy
    if accuracy is not None and accuracy.workspace is not None:
        now, then = accuracy.workspace.before_mm.median, accuracy.workspace.after95_mm.median
        gain = (
            f"What the values gain: the TCP is off by {numbers.significant(now, 2, 'mm')} now in the median"
            f" posture, and by at most {numbers.significant(then, 2, 'mm')} with them (95 %, nominal"
            " geometry taken as exact)."
        )
    return (
        NextStep(gain),
        NextStep(
            "Verify: measure a few postures of this run, chosen for the purpose, with the corrected robot."
            " The answer is pass, fail or inconclusive.",
            (f"zerobeam plan verify {run} -o verify.yaml", f"zerobeam verify {run} NEW.jsonl"),
        ),
    )
