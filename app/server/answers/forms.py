"""Forms: what may be stated to each command that the page carries out, as the records of its options say; and
which rigs can carry a plan out."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cache
from typing import Annotated, Any, Literal

from ....experiments.command_options import BackupOptions, ExportOptions, HistoryPageOptions, ProgramMotion
from ....experiments.makers.known_logs import read_log
from ....experiments.makers.maker import makers, plan_programs
from ....experiments.measuring_options import PlanOptions, RunOptions
from ....experiments.positions.position_languages import LANGUAGES
from ....experiments.rigs.at_rest import SCHEMES
from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.options import REQUIRED, OptionField, options_of
from ....model.records import it, record
from ....words.wording import capital
from ..index import Folder
from ..requests import end_point

RigKind = Literal["simulated", "manual", "live", "abb"]
# What carries a plan out, and the words of its button.
_RIGS: Mapping[RigKind, tuple[str, str]] = {
    "simulated": ("Simulation", "Start the simulation"),
    "manual": ("By hand", "Start"),
    "live": ("By hand, joints read from the controller", "Start: connects to the controller"),
    "abb": ("ABB robot", "Start: asks before the robot moves"),
}


Source = Callable[..., object]
_UNITS = re.compile(r"_(mm|deg|s)$")  # as names of options end
# What people call the words of options.
_WORDS = {
    **{"deg": "degrees", "rad": "radians", "mm": "millimetres", "m": "metres", "inch": "inches"},
    **{"link": "link 2", "ground": "the ground (FANUC)", "number": "number or order"},
    **{"A": "A: mean variance", "D": "D: generalised variance", "E": "E: largest variance"},
    **{"1sigma": "one standard uncertainty", "95": "95 %", "none": "not used"},
}


@record(kw_only=True)
class FieldChoice:
    """A word that may be stated."""

    value: str
    words: str


@record(kw_only=True)
class FormField:
    """An option of a command: a value that is stated is `flag=value`, by `several` once for each line."""

    flag: str
    label: str
    help: str
    kind: Literal["text", "number", "whole", "box", "choice", "names", "lines"]
    unit: Annotated[str | None, it("of the number, or of the parts")] = None
    least: float | None = None
    most: float | None = None
    parts: Annotated[list[str], it("names of the numbers of which the value is made; empty: one value")] = (
        field(default_factory=list)
    )
    choices: Annotated[list[FieldChoice], it("empty: any text")] = field(default_factory=list)
    among: Annotated[str | None, it("what the value is one of: a kind of file, columns of the table")] = None
    off: Annotated[str | None, it("of a box that is ticked at first: what states that it is not")] = None
    required: bool
    default: str | None = None
    needs: Annotated[list[str], it("other options, FLAG or FLAG=WORD,…, without which it is not stated")] = (
        field(default_factory=list)
    )
    rare: Annotated[bool, it("whether it is folded at first")] = False
    before: Annotated[str, it("what stands before what is typed")] = ""


@record(kw_only=True)
class CommandForm:
    """A command that the page carries out: its words, and what may be stated to it."""

    command: list[str]
    name: str
    label: str
    about: str = ""
    maker: str | None = None
    vendor: Annotated[str | None, it("of the robots that it is for, as robot files name it; null: any")] = (
        None
    )
    files: Annotated[list[str], it("usual names of what it writes, or endings of what it reads")] = field(
        default_factory=list
    )
    fields: list[FormField]


@record(kw_only=True)
class RigForm(CommandForm):
    """What can carry a plan out, and the words of its button."""

    begins: str
    kind: RigKind


def form_of(
    *sources: Source, without: Collection[str] = (), only: Collection[str] | None = None, word: str = ""
) -> list[FormField]:
    """The options of records and functions that the app may state, in their order: `without` some names, or
    `only` some. Those that need another `word` of the command are left out."""
    fields = [
        _field(one)
        for source in sources
        for one in options_of(source)
        if one.option.app and not one.option.argument
        if one.name not in without and (only is None or one.name in only)
        if all(word in need.split(",") for need in one.option.needs if not need.startswith("--"))
    ]
    flags = {one.flag for one in fields} | {"--rig"}  # what has no field needs nothing of it
    return [replace(one, needs=[need for need in one.needs if need.split("=")[0] in flags]) for one in fields]


def _field(one: OptionField) -> FormField:
    unit, option = _UNITS.search(one.name), one.option
    kind: Literal["text", "number", "whole", "box", "choice", "names", "lines"] = "text"
    if one.box:
        kind = "box"
    elif one.words:
        kind = "choice"
    elif one.several:
        kind = "lines"
    elif one.number:
        kind = "whole" if one.whole else "number"
    elif option.among == "points":
        kind = "names"
    default = one.typed_default
    if isinstance(default, bool):
        default = "true" if default else None
    name = one.flag.removeprefix("--").replace("-", " ")
    return FormField(
        flag=one.flag,
        label=option.label or capital(_UNITS.sub("", name.replace(" ", "_")).replace("_", " ")),
        help=capital(option.help),
        kind=kind,
        unit=option.unit or (unit and unit[1]),
        least=option.least,
        most=option.most,
        parts=list(option.parts),
        choices=[FieldChoice(value=f"{word}", words=_WORDS.get(f"{word}", f"{word}")) for word in one.words],
        among=option.among,
        off=one.long_flags[1] if one.box and len(one.long_flags) > 1 else None,
        required=one.default is REQUIRED,
        default=None if default in (None, (), REQUIRED) else f"{default:g}" if one.number else f"{default}",
        needs=[need for need in option.needs if need.startswith("--")],
        rare=option.rare,
    )


def _form(
    command: str, label: str, files: Sequence[str], fields: list[FormField], **more: Any
) -> CommandForm:
    words = command.split()
    name = " ".join(words[1:])
    return CommandForm(
        **{"command": words, "name": name, "label": label, "files": list(files), "fields": fields, **more}
    )


def _plans() -> Iterator[CommandForm]:
    for name, label in {"optimal": "optimal", "x": "X-Pattern", "y": "Y-Pattern"}.items():
        fields = form_of(PlanOptions, without=("header_file",), word=name)
        yield _form(f"plan {name}", label, ["plan.yaml"], fields)


def _exports() -> Iterator[CommandForm]:
    for maker in sorted(makers(), key=lambda maker: maker.vendor is not None):
        for kind in maker.offsets:
            about, fields = inspect.getdoc(kind.text) or kind.name, form_of(kind.text, ExportOptions)
            yield _form(
                f"export {kind.name}",
                kind.name,
                [f"offsets.{kind.ending}"],
                fields,
                about=about,
                maker=maker.name,
                vendor=maker.vendor,
            )


def _programs() -> Iterator[CommandForm]:
    sheet = ("pdf", "sheet for the person at the robot (PDF)", ("plan.pdf",), ("j3",), None)
    programs = ((one.name, one.label, one.files, one.options, vendor) for one, vendor in plan_programs())
    for name, label, files, options, vendor in (sheet, *programs):
        fields = form_of(ProgramMotion, only=options)
        yield _form(f"export plan {name}", label, files, fields, name=name, vendor=vendor)


# What is mapped beside the columns of a table.
_MAPPED = ("units", "lengths", "header_row", "columns", "delimiter", "decimal", "j3", "reversed_joints")


def _imports() -> Iterator[CommandForm]:
    ordered = sorted(makers(), key=lambda maker: maker.vendor is not None)
    readers = [(maker, reader) for maker in ordered for reader in maker.read if not reader.hidden]
    for maker, reader in readers:
        about = " ".join((inspect.getdoc(reader.read) or reader.name).split())
        sentence = re.sub(r"\.(\s.*)?$", "", about)  # the first
        fields = form_of(reader.read, without=_MAPPED if reader.name == "csv" else ())
        yield _form(f"import {reader.name}", sentence, [reader.files], fields, about=about, maker=maker.name)
    for maker in ordered:
        for log in maker.logs:
            label = f"{log.about}: a log over time, of which a measurement is where the arm dwells"
            more = {"about": f"{label}.", "maker": maker.name}
            yield _form(f"import log {log.name}", label, ["Logs as CSV files."], form_of(read_log), **more)


def _positions() -> Iterator[CommandForm]:
    endings = [ending for language in LANGUAGES for ending in language.endings]
    yield _form("positions keep", "Convert the positions", endings, form_of(BackupOptions))


def _histories() -> Iterator[CommandForm]:
    fields = form_of(HistoryPageOptions, without=("db",))
    yield _form("history report", "Make the pages", ["arm.html", "fleet.html"], fields)


_FORMS: Mapping[str, Callable[[], Iterator[CommandForm]]] = {
    "plan": _plans,
    "export": _exports,
    "export plan": _programs,
    "import": _imports,
    "positions": _positions,
    "history": _histories,
}


@end_point(
    "GET /api/forms", "What may be stated to the commands of a kind (`of`: " + ", ".join(_FORMS) + ")."
)
def forms(_: Folder, of: str) -> list[CommandForm]:
    """The forms of the commands that begin with a word, as the makers have them."""
    if of not in _FORMS:
        raise BadInput("there are no such forms", found=of, allowed=", ".join(_FORMS))
    return _made(of)


@cache
def _made(of: str) -> list[CommandForm]:
    return list(_FORMS[of]())


_SERVO = ("cell", "camera", "adaptive", "tolerance", "gain", "repeat")  # what only a led beam has


def offered_rigs(plan: Plan, vendor: str | None) -> list[RigForm]:
    """What can carry the plan out for a robot of this vendor (None: not stated)."""
    beam = plan.header.only_beam
    abb = beam and vendor in (None, "abb") and plan.robot.conventions.joint3 != "ground"
    kinds = [kind for kind in _RIGS if abb or kind != "abb"]
    return run_forms(kinds, vendor, servo=beam, closing=plan.header.only_tools)


def run_forms(kinds: Sequence[RigKind], vendor: str | None, *, servo: bool, closing: bool) -> list[RigForm]:
    """The forms of rigs, of live joints one for each protocol. `servo`: a beam is led onto its target, with
    cell, camera and adaptive order; `closing`: the first posture can be measured again at the end."""
    without = {"rig", "resume"} | (set() if servo else {*_SERVO}) | (set() if closing else {"closing"})
    rigs = list[RigForm]()
    for kind in kinds:
        about = form_of(RunOptions, without=without)
        fields = [replace(one, needs=_left(one.needs)) for one in about if _is_for(one, kind)]
        flags = {one.flag for one in fields}
        fields = [one for one in fields if all(need.split("=")[0] in flags for need in one.needs)]
        label, begins = _RIGS[kind]
        command = ["run", f"--rig={kind}"]
        form = RigForm(command=command, name=kind, label=label, fields=fields, begins=begins, kind=kind)
        rigs += _live_forms(form, vendor) if kind == "live" else [form]
    return rigs


_RIG = "--rig="


def _is_for(field: FormField, rig: str) -> bool:
    needs = [need.removeprefix(_RIG) for need in field.needs if need.startswith(_RIG)]
    return all(rig in need.split(",") for need in needs) and (field.flag != "--seed" or rig == "simulated")


def _left(needs: Sequence[str]) -> list[str]:
    return [need for need in needs if not need.startswith(_RIG)]


def _live_forms(form: RigForm, vendor: str | None) -> Iterator[RigForm]:
    """Of each protocol that reads joints of this vendor's robots, its own before those for any."""
    names = {maker.vendor: maker.name for maker in makers()}
    schemes = [(name, one) for name, one in SCHEMES.items() if vendor is None or one.vendor in (None, vendor)]
    for name, scheme in schemes:
        maker = names[scheme.vendor] if scheme.vendor is not None else "ROS, any maker"
        behind = f"; options behind ?: {', '.join(f'{one}=' for one in scheme.options)}"
        address = FormField(
            flag="--rig",
            label="Controller’s address",
            help=f"host, or host:port (usual: {scheme.port}){behind if scheme.options else ''}",
            kind="text",
            required=True,
            before=f"{name}://",
        )
        yield replace(
            form,
            command=["run"],
            name=name,
            label=f"{form.label}: {maker}",
            vendor=scheme.vendor,
            about="The controller’s program, or a person at the pendant, moves the arm. The joints are read"
            " there where you confirm a posture; moving or stale ones are refused.",
            fields=[address, *form.fields],
        )
