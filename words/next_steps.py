"""What to do with an answer: values to enter, the file for the robot, what it gains, how to verify it.

What the data do not determine is never offered: values are offered of a pass alone.
"""

from __future__ import annotations

import re
import shlex

from ..analysis.answer.findings import HeldOutMisfit, OtherBasins
from ..analysis.answer.result import EnteredValue, NextStep, NextSteps, Result
from ..analysis.diagnostics.enter import Entered
from ..analysis.displacement import Displacement
from . import numbers
from .enter import WHY_THEY_DIFFER, conformity_sentence, enter_sentence, geometry_sentence
from .wording import be, label, listed

_SAFE = re.compile(r"[\w./+@-]+")
# What writes the offsets for a controller, by its vendor: the command, and the file's name.
_FILES = {
    "abb": ("export rapid", "offsets.mod"),
    "universal-robots": ("export ur", "joint-zero.txt"),
    "kuka": ("export kuka", "mastering.txt"),
    "fanuc": ("export fanuc", "mastering.txt"),
}


# What speaks against entering the values of a pass; export refuses most of it too.
_AGAINST: dict[type, str] = {
    Displacement: "Enter nothing yet: a target seems to have moved while it was measured. Record the run"
    " again, or give the target another name in the measurements after it moved.",
    OtherBasins: "Enter nothing: other sets of offsets fit nearly as well. Record more measurements, in"
    " varied postures.",
    HeldOutMisfit: "Enter nothing yet: the offsets do not predict the held-out target. Look for the cause.",
}


def next_steps(result: Result) -> NextSteps:
    """What to do with an answer, whatever its verdict."""
    against = [_AGAINST[type(finding)] for finding in result.findings if type(finding) in _AGAINST]
    if against:
        return NextSteps((), (NextStep(against[0]),))
    if result.verdict != "pass":
        return NextSteps((), _not_yet(result))
    return NextSteps(_values(result), _steps(result))


def _not_yet(result: Result) -> tuple[NextStep, ...]:
    """Nothing is offered: why, and what to do first."""
    if not result.likelihood.converged:
        return (
            NextStep(
                "Enter nothing: the fit did not converge. Look at the measurements, or record more of them."
            ),
        )
    if result.misfit is not None:
        return (
            NextStep(
                "Enter nothing: the model does not describe the measurements. Look for the cause first (joint"
                " columns, signs, units, a moved target, geometry), then measure again."
            ),
        )
    offsets = [row for row in result.parameters if row.group == "offset"]
    open_ = [row.name for row in offsets if row.status in ("unidentifiable", "weak")]
    known = any(row.status == "identified" for row in offsets)
    named = open_ or [row.name for row in result.parameters if row.status in ("unidentifiable", "weak")]
    which = listed([label(name) for name in named]) if named else "the parameters together"
    steps = [
        NextStep(
            f"Enter nothing yet: {which}"
            f" {be(named)} not determined well enough. Record more measurements, in"
            " postures that a plan chooses and a check approves:",
            (
                "zerobeam plan optimal --header HEADER --target X,Y,Z -o plan.yaml",
                "zerobeam check plan.yaml",
            ),
        )
    ]
    if known and open_:
        command, file = _command(result)
        without = " ".join(f"--without {name}" for name in open_)
        steps.append(
            NextStep(
                "If the identified offsets are to be applied alone, at your decision:",
                (f"zerobeam {command} {_run(result)} {without} -o {file}",),
            )
        )
    return tuple(steps)


def offered(result: Result) -> Entered | None:
    """The values to enter, where they may be entered: one rule for all who show them."""
    return result.entered if next_steps(result).enter else None


def _values(result: Result) -> tuple[EnteredValue, ...]:
    if result.entered is None:
        return ()
    entries = []
    for name, value in result.entered.values.items():
        row, u = result.parameters.named(name), result.entered.u[name]
        assert row.estimate is not None
        assert row.std is not None
        entries.append(
            EnteredValue(
                name,
                numbers.estimate(value, u, row.unit),
                numbers.spread(2 * u, row.unit),
                numbers.estimate(row.estimate, row.std, row.unit),
            )
        )
    return tuple(entries)


def _steps(result: Result) -> tuple[NextStep, ...]:
    run, (command, file) = _run(result), _command(result)
    why = f" {WHY_THEY_DIFFER}" if result.entered_geometry else ""
    gain = " ".join(filter(None, (enter_sentence(result), geometry_sentence(result))))
    return (
        NextStep(
            f"1. Write the file for this robot. It says how it is used.{why}",
            (f"zerobeam {command} {run} -o {file}",),
        ),
        NextStep(f"2. {gain} {conformity_sentence(result)}"),
        NextStep(
            "3. Verify: measure a few postures of this run, chosen for the purpose, with the corrected robot."
            " The answer is pass, fail or inconclusive.",
            (f"zerobeam plan verify {run} -o verify.yaml", f"zerobeam verify {run} NEW.jsonl"),
        ),
    )


def _command(result: Result) -> tuple[str, str]:
    """What writes the file for this robot."""
    return _FILES.get(result.inputs.vendor or "", ("export robot", "corrected.yaml"))


def _run(result: Result) -> str:
    """The run's file for a command; a stand-in where the name holds what a shell would read."""
    name = result.inputs.run
    return shlex.quote(name) if _SAFE.fullmatch(name) else "RUN.jsonl"
