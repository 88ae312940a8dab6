"""A whole program for the arm whose offsets were found: its targets corrected, every other byte as it was.

Nothing is written unless every motion of the program is understood: a program that is corrected in part moves
the arm to places that nobody has meant.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.robot_file import Vendor
from ...model.kinematics.orientation import stated_numbers
from ...model.kinematics.pendant import Pendant, pendant_of
from ...model.kinematics.robot import Robot
from ...model.parsing.reading import read_bytes
from ...words.wording import listed
from .calibration import NO_ROBOT, RobotCalibration
from .format_options import ProgramOptions
from .line_programs import for_correction
from .maker import ProgramFiles, one_line, program_languages, require_vendor, vendor_of
from .plan_programs import require_axes
from .program_parts import Edit, Language, Parsed, ProgramFacts, RequiredPose, Source
from .solving import Arms, CorrectedTarget, Corrections, correct_targets, up_to_flange

MARK = "zerobeam export program"  # in the head of what was corrected once
_BEFORE_THE_FIRST_RUN = (
    "targets that were taught on this arm hold the offsets already: leave them as they are by --leave NAME",
    "tools and frames that were measured with the uncorrected arm hold its error: measure them again",
    "first run: reduced speed, a hand on the enabling switch",
)
_SHORT = (  # the same, where a remark has few letters
    "NEVER ENTER THE OFFSETS AS WELL",
    "TAUGHT TARGETS: USE --leave",
    "MEASURE TOOLS AND FRAMES AGAIN",
    "FIRST RUN AT REDUCED SPEED",
)
_SHOWN = 8  # problems of a program that are named


@dataclass(frozen=True)
class CorrectedProgram:
    """The files of the corrected program, sentences about what was corrected and what was not, and the
    targets, with joints as the pendant of the robot counts them."""

    files: dict[Path, bytes]
    notes: list[str]
    targets: list[CorrectedTarget]


def program_files_of(path: Path, vendor: str | None = None) -> tuple[ProgramFiles, Vendor]:
    """The language of a program and its maker, by the end of the file's name; of several that of the robot's
    `vendor`, where it is known."""
    suffix = path.suffix.lower()
    languages = [(files, maker) for files, maker in program_languages() if suffix in files.endings]
    for files, maker in languages:
        if maker == vendor or len(languages) == 1:
            return files, maker
    if languages:
        raise BadInput(
            "the file ending is of several languages, and nothing says who made the robot",
            found=path.name,
            allowed=", ".join(maker for _, maker in languages),
            remedy="state vendor: … in the robot file",
            file=path,
        )
    if path.is_dir():
        endings = {ending for files, maker in program_languages() for ending in files.endings}
        first = next((each.name for each in sorted(path.iterdir()) if each.suffix.lower() in endings), None)
        raise BadInput(
            "this is a folder, and a program is named by one of its files",
            found=path.name if first is None else f"{path.name}, with {first} in it",
            remedy="name a file of it, and a file of the same ending in another folder by -o"
            + ("" if first is None else f": {path.name}/{first} -o corrected/{first}"),
            file=path,
        )
    raise BadInput(
        "the file ending is of no language that is read here",
        found=path.name,
        allowed=", ".join(files.about for files, _ in program_languages()),
        file=path,
    )


def _programs_for(robot: Robot) -> str | None:
    """What can be corrected for the controller of a robot."""
    about = [files.about for files, maker in program_languages() if maker == vendor_of(robot)]
    return f"name a program of this robot's controller: {', '.join(about)}" if about else None


def files_of(path: Path, vendor: str | None) -> list[Path]:
    """The files of the program, as far as they are there: of KRL the .src and the .dat of one name, of SPEL+
    the points of the folder too, of VAL3 all of it. Where the `vendor` is not known, of an ending that
    several makers use, all that may belong to it."""
    suffix = path.suffix.lower()
    languages = [
        files for files, maker in program_languages() if suffix in files.endings and vendor in (None, maker)
    ]
    order = [other for files in languages for other in files.paired]
    if not order or not path.parent.is_dir():
        return [path]
    folder = {other for files in languages for other in files.folder}
    beside = {*order} - folder - {suffix}
    paths = [
        other
        for other in sorted(path.parent.iterdir())
        if other == path
        or other.suffix.lower() in folder
        or (other.suffix.lower() in beside and other.stem == path.stem)
    ]
    return sorted(paths or [path], key=lambda each: order.index(each.suffix.lower()))


def corrected_program(
    nominal: Robot,
    calibration: RobotCalibration,
    path: Path,
    out: Path,
    choices: ProgramOptions | None = None,
) -> CorrectedProgram:
    """The program `path` with corrected targets, for `out`.

    BadInput for another vendor's robot, for a program that was corrected before, and for one with
    motions that are not understood: then all of them are named.
    """
    files_of_language, vendor = program_files_of(path, vendor_of(nominal))
    language, choices = for_correction(files_of_language.language()), choices or ProgramOptions()
    note = require_vendor(nominal, vendor, f"a program in {language.name}", _programs_for(nominal))
    require_axes(nominal, 6, f"a program in {language.name}")
    if out.suffix.lower() != path.suffix.lower():
        raise BadInput(
            "the corrected program has another file ending", found=out.name, allowed=f"*{path.suffix}"
        )
    paths = files_of(path, vendor)
    texts = [_text(each) for each in paths]
    parts = _parts(texts)
    facts = _facts(language, nominal, choices)
    source = Source("".join(parts), nominal, facts)
    parsed = language.targets(source)
    arms = Arms(
        up_to_flange(nominal, nominal),
        up_to_flange(calibration.corrected, nominal),
        np.array([offset.applied_rad for offset in calibration.offsets]),
        language.up,
        calibration.posture_offsets,
        language.by_joint2,
    )
    corrections = correct_targets(parsed, arms, facts.near)
    _claim_all(language, source, parsed)
    if parsed.problems:
        raise _not_understood(parsed, facts, parts, paths)
    facts.check_names()
    if not parsed.targets:
        raise BadInput(
            "the program has no targets to correct", file=path, allowed="joint and Cartesian targets"
        )
    counting = Pendant(nominal, facts.j3).counting
    also = [each for each in (note, counting) if each is not None]
    notes = [*_summary(calibration, parsed, corrections, choices), *also]
    ends = np.cumsum([0, *map(len, parts)])
    files = {}
    for each, text, start in zip(paths, texts, ends.tolist(), strict=False):
        edits = [
            Edit(edit.start - start, edit.end - start, edit.text)
            for edit in corrections.edits
            if start <= edit.start < start + len(text)
        ]
        suffix = each.suffix.lower()
        other = each.name if suffix in files_of_language.folder else out.stem + each.suffix
        name = out if each == path else out.with_name(other)
        whole = _applied(text, edits)
        mark = f"{MARK}: offsets of the run {calibration.inputs.sha256[:16]}"
        if suffix in language.marked:
            whole = language.marked[suffix].sub(MARK, whole, count=1)
        elif language.remark_end and each != path:  # the whole head once in an application of many files
            whole = _behind_head(language, whole, [f"{mark}; {out.name} says more"])
        else:
            whole = _behind_head(language, whole, _head_lines(language, calibration, notes, path.name))
        if suffix in language.with_data:
            whole = language.with_data[suffix](whole, mark)
        # What an editor put before the first line stays there, and only there.
        content = whole.encode("latin-1")
        files[name] = BOM_UTF8 + content if read_bytes(each).startswith(BOM_UTF8) else content
    pendant = Pendant(nominal, facts.j3)
    targets = [replace(each, joints=pendant.counted(each.joints)) for each in corrections.targets]
    return CorrectedProgram(files, notes, targets)


def poses_to_state(nominal: Robot, path: Path) -> tuple[RequiredPose, ...]:
    """The tools and frames of the program `path` whose poses nothing in it says: tools, then frames.

    BadInput for another vendor's robot, and where it is no program of a language that is read.
    """
    files_of_language, vendor = program_files_of(path, vendor_of(nominal))
    language = for_correction(files_of_language.language())
    require_vendor(nominal, vendor, f"a program in {language.name}", _programs_for(nominal))
    require_axes(nominal, 6, f"a program in {language.name}")
    facts = _facts(language, nominal, ProgramOptions())
    parts = _parts([_text(each) for each in files_of(path, vendor)])
    language.targets(Source("".join(parts), nominal, facts))
    return facts.required


def _text(path: Path) -> str:
    """A file as text of which each letter is one byte: whatever its encoding, the rest stays as it was."""
    text = read_bytes(path).removeprefix(BOM_UTF8).decode("latin-1")
    if "\0" in text:
        raise BadInput("this is a binary file, or UTF-16", file=path, remedy="save the program as plain text")
    if MARK in text:
        raise BadInput(
            "this program was corrected before: the offsets would be applied twice",
            file=path,
            remedy="correct the program that it was made of",
        )
    return text


def _parts(texts: Sequence[str]) -> list[str]:
    """The files of a program as parts of one text: the .dat begins on a line of its own."""
    return [text if text.endswith("\n") else text + "\n" for text in texts]


def _facts(language: Language, robot: Robot, choices: ProgramOptions) -> ProgramFacts:
    upper = language.case_sensitive
    if language.name == "TP":
        choices = replace(choices, j3=pendant_of(robot, choices.j3, "fanuc").joint3)
    elif choices.j3 is not None:
        raise BadInput(f"--j3 is not for {language.name}", remedy="leave --j3 out")
    near = None
    if choices.near is not None:
        near = np.array(stated_numbers(choices.near, robot.n, "--near", "J1,J2,…"))
        near = Pendant(robot, choices.j3).between_links(near) if choices.j3 else near
    return ProgramFacts(
        dict(_frame(text, "--tool", language) for text in choices.tools),
        dict(_frame(text, "--frame", language) for text in choices.frames),
        frozenset(name if upper else name.lower() for name in _bare(choices.leave, language)),
        near,
        choices.j3,
        frozenset(name if upper else name.lower() for name in choices.calls),
    )


def _claim_all(language: Language, source: Source, parsed: Parsed) -> None:
    """A problem of each literal with the shape of a pose or of joints that no statement has said the
    meaning of.

    The literals are found a second time, without the grammar: what is corrected, left and defined must be
    all of them.
    """
    claimed = {(literal_span.start, literal_span.end) for literal_span in parsed.literals}
    lines = {line for line, _ in parsed.problems}
    for span in sorted(claimed ^ set(language.literals(source.text))):
        line = source.line(span[0])
        if line not in lines:
            literal = " ".join(source.text[slice(*span)].split())[:60]
            parsed.problems.append((line, f"{literal}: it is not said what this position is (--leave?)"))


def _bare(names: Sequence[str], language: Language) -> list[str]:
    """The names as the language has them: P[3] and P3 of FANUC are 3, p[0] of VAL3 is p."""
    if language.name == "TP":
        return [re.sub(r"^[Pp](?:\[(\d+)\]|(\d+))$", r"\1\2", name) for name in names]
    return [name.removesuffix("[0]") for name in names] if language.name == "VAL3" else list(names)


def _frame(text: str, option: str, language: Language) -> tuple[str, Matrix]:
    name, _, values = text.rpartition("=")
    count = language.form.split(" ")[0].count(",") + 1
    name = name.strip() if language.case_sensitive else name.strip().lower()
    return name, language.pose(stated_numbers(values, count, option, f"[NAME=]{language.form}"))


def _not_understood(
    parsed: Parsed, facts: ProgramFacts, texts: Sequence[str], paths: Sequence[Path]
) -> BadInput:
    """The error that names the problems, by file and line, and all that is to be stated."""
    starts = np.cumsum([0, *(text.count("\n") for text in texts[:-1])]).tolist()
    sentences = []
    for line, sentence in sorted(dict.fromkeys(parsed.problems)):
        part = max(i for i, start in enumerate(starts) if line > start or not i)
        sentences.append(f"{paths[part].name} line {line - starts[part]}: {sentence}")
    shown = "\n           ".join(sentences[:_SHOWN])
    requests = f"state {' '.join(map(str, facts.required))}; " if facts.required else ""
    more = f"\n           and {len(sentences) - _SHOWN} more" if len(sentences) > _SHOWN else ""
    return BadInput(
        "the program cannot be corrected as a whole, so nothing is written",
        found=shown + more,
        remedy=f"{requests}rewrite lines that are not understood with fixed targets, or leave targets that"
        " are right as they are (taught on this very arm) by --leave NAME",
        file=paths[0],
    )


def _summary(
    calibration: RobotCalibration, parsed: Parsed, moved: Corrections, choices: ProgramOptions
) -> list[str]:
    gone = [offset.name for offset in calibration.offsets if not offset.exported]
    uses = Counter(literal.use for literal in parsed.literals)
    by_joints = [each.moved_joint for each in moved.targets if not each.cartesian]
    poses = [each.moved_mm for each in moved.targets if each.cartesian]
    notes = [
        f"positions in the program: {uses.total()}; corrected: {uses['target']};"
        f" left as they are: {uses['left']}; poses of tools and frames: {uses['frame']}",
        f"joint targets: {len(by_joints)}, moved by up to {max(by_joints, default=0.0):.3f} deg; Cartesian"
        f" targets: {len(poses)}, moved by up to {max(poses, default=0.0):.3f} mm",
        *_BEFORE_THE_FIRST_RUN,
    ]
    if gone:
        notes.append(f"not corrected, as 0: {', '.join(gone)}")
    if choices.leave:
        notes.append(f"left as they are: {listed(list(choices.leave))}")
    if moved.changed:
        notes.append(f"another configuration is needed, and written, at {listed(moved.changed)}")
    if moved.nearest:
        notes.append(f"configuration taken from the joints nearest by, at {listed(moved.nearest)}")
    return [*notes, *parsed.left]


def _applied(text: str, edits: Sequence[Edit]) -> str:
    for edit in sorted(edits, reverse=True):
        text = text[: edit.start] + edit.text + text[edit.end :]
    return text


def _head_lines(
    language: Language, calibration: RobotCalibration, notes: Sequence[str], name: str
) -> list[str]:
    if language.remark_width is None:
        return [f"{MARK}: {name} with the offsets below", *notes, *calibration.head]
    return [
        MARK,
        *_SHORT,
        *(["SIMULATED RUN, NO ROBOT MEASURED"] if NO_ROBOT in calibration.warnings else []),
        f"zerobeam {calibration.inputs.versions['zerobeam']}, offsets of run",
        calibration.inputs.sha256[:16],
        *(
            f"{offset.name} {offset.applied:+.4f}" if offset.exported else f"{offset.name} NOT CORRECTED"
            for offset in calibration.offsets
        ),
    ]


def _behind_head(language: Language, text: str, lines: Sequence[str]) -> str:
    """The text with remarks behind the head of its language."""
    head = re.search(language.head, text, re.MULTILINE | re.IGNORECASE)
    start = 0 if head is None else head.end()
    newline = "\r\n" if "\r\n" in text else "\n"
    rows = [one_line(line) for line in lines]
    if language.remark_width is not None:
        rows = [row.replace(";", ",")[: language.remark_width] for row in rows]
    if language.remark_end:  # of XML: no -- in it
        rows = [row.replace("--", "- -") for row in rows]
    end = " ;" if language.name == "TP" else language.remark_end
    remarks = "".join(f"{language.remark}{row}{end}{newline}" for row in rows)
    return text[:start] + remarks + text[start:]
