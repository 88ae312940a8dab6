"""The one message of an answer: verdict, least well determined offset, cause, action, cautions, what may be
done with it; and the two lines of what was stated and assumed. Terminal, HTML, PDF, JSON, Python, app and
history show it first, as it is.

What is said of a run, and how grave it is, is in `catalogue.py`, of a plan in `plan_catalogue.py`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..analysis.answer.answer_message import Action, May, Message
from ..analysis.answer.findings import prediction_failed
from ..analysis.answer.result import EnteredValue, NextStep, NextSteps, Result
from ..analysis.diagnostics.values_to_enter import Entered
from ..analysis.observability.check import Check
from ..analysis.observability.geometry_result import Basis, Size
from ..analysis.solution import Solution
from ..analysis.status import NOT_DESCRIBED, Verdict, known
from ..model.files.run import LEFT_OUT, in_no_file, made_without
from ..model.instruments.flange_tool import FlangeTool
from ..model.likelihood.parameters import Unit
from . import numbers
from .case import RunCase
from .catalogue import RUN, SaidToEnterNothing
from .controllers import lacks_factory_calibration, taken_by
from .enter import (
    WHY_THEY_DIFFER,
    conformity_sentence,
    enter_sentence,
    links_step,
    met_words,
    required_words,
)
from .entries import VERDICT_WORDS, graded, message_by, rows_of, said_word, sentences_of, worst_of
from .geometry_words import tolerance_words
from .observability import named_part, too_few_words
from .plan_catalogue import plan_headline, plan_message
from .provenance import is_simulated
from .run_argument import run_argument
from .trust import offsets_sentence, verdict_sentence
from .wording import (
    NOT_DETERMINED,
    Namer,
    capital,
    clipped,
    counted,
    joints,
    listed,
    person,
    shown,
    status_words,
)

_HARDLY = 0.95  # of a U that is left were this known exactly: it does not matter


def basis_lines(
    bases: Sequence[Basis],
    header: Mapping[str, object],
    k: float,
    name: Namer,
    *,
    effects: bool,
    of: str = "U",
) -> tuple[str, ...]:
    """The lines; with `effects` what each does to the expanded uncertainties, of coverage factor `k`; `of` as
    of `quantity_of_u`."""
    by_header = [*_noise(header), *(_words(one, k, name, effects, of) for one in bases if one.stated)]
    assumed = [_words(one, k, name, effects, of) for one in bases if not one.stated]
    lines = [f"Stated: {'; '.join(by_header)}."] if by_header else []
    return (*lines, *([f"Assumed: {'; '.join(assumed)}."] if assumed else []))


def _noise(header: Mapping[str, object]) -> Iterator[str]:
    """What the header says of the noise of joints and instruments."""
    noise, instruments = header.get("noise"), header.get("instruments")
    if isinstance(noise, Mapping):
        sizes = _sizes(noise, (("joint_deg", "deg"), ("joint_mm", "mm")))
        if sizes:
            yield f"noise of joints {sizes}"
        if noise.get("spot_mm"):
            yield f"of spot {_sizes(noise, (('spot_mm', 'mm'),))}"
    if isinstance(instruments, Mapping):
        for label, entry in instruments.items():
            keys: tuple[tuple[str, Unit], ...] = (("sigma_mm", "mm"), ("sigma_deg", "deg"))
            sizes = _sizes(entry, keys) if isinstance(entry, Mapping) else ""
            if sizes:
                yield f"of {clipped(str(label))} {sizes}"


def _sizes(entry: Mapping[str, object], keys: Sequence[tuple[str, Unit]]) -> str:
    parts = []
    for key, unit in keys:
        value = entry.get(key)
        if isinstance(value, int | float) or (isinstance(value, list | tuple) and value):
            parts.append(tolerance_words(value if isinstance(value, int | float) else tuple(value), unit))
        elif isinstance(value, Mapping):
            at_zero, per_m = (tolerance_words(value[each], unit) for each in ("constant", "per_m"))
            parts.append(f"{at_zero} and {per_m} a metre")
    return listed(parts) if parts else ""


def _words(basis: Basis, k: float, name: Namer, effects: bool, of: str) -> str:
    if basis.part == "links":
        exact, text = "links exact", _of_arm(basis)
    else:
        what = named_part(basis.kind, basis.of, basis.part)
        exact, text = f"{what} exactly as stated", f"{what} {_listed_sizes(basis.sizes)}"
    if not basis.sizes:
        return f"{exact} (in no U)" if effects else exact
    if not effects or basis.offset is None or basis.u is None or basis.u_if_exact is None:
        return text
    if basis.u_if_exact > _HARDLY * basis.u:
        return f"{text} (U hardly less if exact)"
    u, if_exact = (numbers.spread(k * each, basis.unit or "") for each in (basis.u, basis.u_if_exact))
    (offset,) = joints([basis.offset], name)
    return f"{text} ({offset} {of} {u}, if exact {if_exact})"


def _of_arm(basis: Basis) -> str:
    """The sizes of links, and of how joints bend; `typical links` stand for all that is assumed of an arm."""
    links = [size for size in basis.sizes if size.of in ("length", "angle", None)]
    typical = "" if basis.stated else "typical "
    parts = [f"{typical}links {_listed_sizes(links)}"] if links else []
    if basis.stated or not links:
        parts += [f"{typical}{size.of} {_listed_sizes([size])}" for size in basis.sizes if size not in links]
    return ", ".join(parts)


def _listed_sizes(sizes: Sequence[Size]) -> str:
    return ", ".join(tolerance_words(size.std, size.unit) for size in sizes)


WHAT_ELSE = "What else to know"  # the cautions that page one has no room for


def message(answer: Result | Check) -> Message:
    """The message of a result, or of a plan that was checked."""
    if isinstance(answer, Check):
        return plan_message(answer)
    case = RunCase.of_result(answer)
    k, header = answer.coverage_factor, answer.inputs.header
    content = message_of_run(case)
    of = quantity_of_u(values_shown(answer, content))
    basis = basis_lines(answer.taken_as_known, header, k, person, effects=case.sound, of=of)
    return replace(content, basis=basis)


def acceptance_plan_message(measurements: int, calibration: str, run: str) -> Message:
    """The message of a run that tests a corrected robot: its own offsets do not judge it."""
    return Message(
        verdict=f"{counted(measurements, 'measurement')} for the test of {shown(calibration)}.",
        worst=None,
        cause=None,
        action=Action(
            "Compare them with the calibration.",
            f"zerobeam verify {run_argument(calibration)} {run_argument(run)}",
        ),
        cautions=(),
        grade="held",
    )


def headline(answer: Result | Solution | Check, name: Namer = str) -> str:
    """Verdict and cause without the verdict's word; of a plan what it will determine, and why not the rest,
    broken constraints first. `name` writes names."""
    if isinstance(answer, Check):
        return plan_headline(answer, name)
    case = (
        RunCase.of_result(answer, name)
        if isinstance(answer, Result)
        else RunCase.so_far(answer, "", {}, name)
    )
    cause, _ = sentences_of(rows_of(case, RUN), case)
    return _determined(case) if cause is None else f"{_determined(case)} {cause}"


def headline_so_far(solution: Solution, name: Namer = str) -> str:
    """The same while measurements are being made."""
    if not solution.converged:
        return "These measurements determine no offset yet."
    return headline(solution, name)


def message_of_run(case: RunCase) -> Message:
    """The message of a run: of its result, or of the fit that there is so far."""
    rows = [row for row in case.offsets if row.status != "assumed"] if case.sound else []
    k = case.k

    def value(row: Any) -> str:
        if row.std is None or row.estimate is None:
            return NOT_DETERMINED
        unit, u = numbers.unit_of(row.unit), k * row.std
        return f"{numbers.estimate(row.estimate, u, unit)} ± {numbers.spread(u, unit)}"

    content = message_by(case, RUN, "", worst_of(rows, k, value))
    values = None if case.result is None else values_shown(case.result, content)
    verdict = _verdict(case, quantity_of_u(values))
    return replace(content, verdict=verdict, action=_saved_first(case, content.action))


def _verdict(case: RunCase, of: str) -> str:
    """The verdict's word and what can be said of the offsets; `of` as of `offsets_sentence`."""
    if case.sound:
        return verdict_sentence(_judged(case), case.verdict, case.offsets, case.k, case.name, of)
    return f"{_judged(case)}. {_determined(case)}"


def _judged(case: RunCase) -> str:
    """The verdict's word, that of a simulated run as such; and whether the robot meets what it must."""
    word = said_word(VERDICT_WORDS[case.verdict], case.simulated)
    run = prediction_failed(case.findings)
    if run is not None and case.verdict == "pass":
        return f"{word} of this run alone, but it does not predict {clipped(shown(run), 60)}: enter nothing"
    if case.conformity is not None:
        return f"{word}; {met_words(case.conformity)}"
    required = case.header.get("required")
    if case.falls_short and isinstance(required, Mapping):
        return f"{word}; whether it meets the required {required_words(required)} cannot be said"
    return word


def _determined(case: RunCase) -> str:
    """What can be said of the offsets, the gravest first."""
    if case.stopped is not None:
        few = case.too_few
        why = f"the fit did not converge ({case.stopped})" if few is None else too_few_words(few)
        return f"{capital(why)}: no offset is reported."
    if case.misfit is not None:
        return f"{capital(NOT_DESCRIBED)}."
    return offsets_sentence(case.offsets, case.k, case.name)


def _saved_first(case: RunCase, action: Action) -> Action:
    """The same, where a command needs a file and the run is in none: one of which a command left measurements
    out is saved by that command, one that Python made by Python."""
    if action.command is None or not case.run or not in_no_file(case.run):
        return action
    if LEFT_OUT not in case.provenance:
        return Action(
            f'{action.text} Save the run first: solution.run.write("{case.argument}").', action.command
        )
    if not case.sound:  # nothing goes on with it
        return Action(action.text, None)
    numbers_left_out = str(case.provenance[LEFT_OUT]).replace(" ", "")
    whole = run_argument(made_without(case.run))
    save = f"zerobeam analyse {whole} --drop {numbers_left_out} --save {case.argument}"
    return Action(f"{action.text} Save the run first; what is printed then has the command.", save)


# Of a result that is read


# Of results without a grade (before it was stated): their action says that nothing is to be entered, and not
# because no robot was measured, none of its offsets is estimated, or its controller takes none.
_ENTER_NOTHING = re.compile(
    r"Check |Enter nothing(?!: (?:no (?:robot|offset|published)|how this controller))"
)


def read_message(result: Result) -> Message:
    """Of a result.json: the message that it states; of an earlier version with its grade. Nothing may be done
    with a misfit, nor with what determines no offset, whatever the message says."""
    content = result.message
    if content is not None and content.grade is not None:
        determined = result.likelihood.converged and any(known(row.status) for row in result.offsets)
        return content if determined and result.verdict != "misfit" else replace(content, may=May())
    case = RunCase.of_result(result)
    if content is not None and _ENTER_NOTHING.match(content.action.text):
        case = replace(case, findings=(*case.findings, SaidToEnterNothing()))
    judging = [entry for entry in RUN if entry.grade != "note" or entry.colour]
    grade, may = graded(rows_of(case, judging), case.verdict)
    content = content or Message(VERDICT_WORDS[case.verdict], None, None, Action("", None), ())
    return replace(content, grade=grade, may=may)


def contradicted(verdict: Verdict, content: Message) -> bool:
    """Whether something speaks against the values of a pass: nothing is to be entered by it."""
    return verdict == "pass" and content.grade == "weak" and not content.may.enter


def falls_short(verdict: Verdict, content: Message) -> bool:
    """Whether a robot that passes is not shown to meet what is required of it."""
    return verdict == "pass" and content.grade == "weak" and content.may.enter


def verdict_words(verdict: Verdict, content: Message | None, simulated: bool) -> str:
    """The verdict as lists say it: of a pass by which nothing is to be entered, or that does not meet what is
    required, with that; of a simulated run as such; `content` is None where the result cannot be read."""
    word = status_words(verdict)
    if verdict == "pass" and content is None:
        word = "pass, result unreadable"
    elif content is not None and contradicted(verdict, content):
        word = "pass, enter nothing"
    elif content is not None and falls_short(verdict, content):
        word = "pass, requirement not shown to be met"
    return said_word(word, simulated)


def result_words(result: Result) -> str:
    """A result.json in a line: the verdict's word, how well the least well determined offset is known."""
    content = read_message(result)
    word = said_word(VERDICT_WORDS[result.verdict], is_simulated(result.inputs.provenance))
    if contradicted(result.verdict, content):
        return f"{word} of this run alone: enter nothing"
    if result.verdict == "misfit":
        return f"{word}: {NOT_DESCRIBED}"
    if content.worst is None:
        return word
    number = content.worst.name.removeprefix("delta")
    name = f"J{number}" if number.isdecimal() else clipped(content.worst.name)
    if content.worst.value is None:
        return f"{word}: {name} is not determined"
    return f"{word}: U ≤ {numbers.spread(content.worst.value, numbers.unit_of(content.worst.unit))} ({name})"


# What comes after the action


def offered(result: Result, content: Message) -> Entered | None:
    """The values to enter, where they may be entered: one rule for all who show them. `content` is the
    message of the result."""
    inputs = result.inputs
    nominal = lacks_factory_calibration(inputs.vendor, inputs.header.get("robot"))
    if result.verdict != "pass" or (nominal and not is_simulated(inputs.provenance)):
        return None
    return result.entered if content.may.export else None


def values_shown(result: Result, content: Message) -> Entered | None:
    """Those that the one table has in place of the offsets: where the controller takes offsets."""
    return offered(result, content) if taken_by(result.inputs.vendor) == "offsets" else None


def quantity_of_u(values: Entered | None) -> str:
    """What a U is of that is said beside the one table, where that has the U of other `values`."""
    return "U" if values is None or values.as_offsets else "offset U"


def next_steps(result: Result, content: Message) -> NextSteps:
    """What to do with an answer, whatever its verdict; the first step is the action of its message."""
    action, entered = content.action, offered(result, content)
    first = NextStep(action.text, () if action.command is None else (action.command,))
    if entered is None:
        return NextSteps((), (first,))
    run, offsets = run_argument(result.inputs.run), taken_by(result.inputs.vendor) == "offsets"
    before = " before the values are entered" if offsets else ""
    kinds = list(result.inputs.instruments.values())
    verify = NextStep(
        f"Verify{before}: measure a second run with the same header. It is predicted.",
        (f"zerobeam analyse {run} --hold-out NEW.jsonl",),
    )
    if offsets and len(kinds) == 1 and issubclass(kinds[0], FlangeTool):
        verify = NextStep(
            "Verify: measure a few postures of this run, chosen for the purpose, with the corrected robot."
            " The answer is pass, fail or inconclusive.",
            (f"zerobeam plan verify {run} -o verify.yaml", f"zerobeam verify {run} NEW.jsonl"),
        )
    gain = [enter_sentence(result), conformity_sentence(result)]
    links = links_step(result, enter=content.may.enter) if offsets else None
    if offsets:
        gain.append(WHY_THEY_DIFFER if result.entered_geometry else None)
    values = _values(result, entered) if offsets else ()
    more = () if links is None else (NextStep(links[0], (links[1],) if content.may.enter else ()),)
    gained = NextStep(" ".join(filter(None, gain)))
    # Of no robot there is nothing to verify.
    last = () if is_simulated(result.inputs.provenance) else (verify,)
    return NextSteps(values, (first, *more, gained, *last))


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
                entered.status.get(name),
            )
        )
    return tuple(entries)
