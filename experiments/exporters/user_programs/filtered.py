"""A whole program for the arm whose offsets were found: its targets corrected, every other byte as it was.

Nothing is written unless every motion of the program is understood: a program that is corrected in part moves
the arm to places that nobody has meant.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.reading import read_bytes
from ....model.files.robot_file import Vendor
from ....model.kinematics.orientation import (
    from_abc,
    from_quaternion,
    from_rotation_vector,
    from_rpy,
    stated_numbers,
)
from ....model.kinematics.pendant import Pendant, pendant_of
from ....model.kinematics.robot import J3, Robot
from ....words.wording import listed
from ...importers.robtargets import up_to_flange
from ..ascii_line import one_line
from ..calibration import Calibration
from ..programs.steps import require_axes
from ..vendors import require_vendor
from .fanuc_targets import fanuc_head, fanuc_literals, fanuc_targets
from .krl.targets import krl_head, krl_literals, krl_targets
from .parts import Edit, Parsed, Source, Stated
from .rapid_statements import rapid_literals
from .rapid_targets import rapid_head, rapid_targets
from .solving import Arms, Corrected, corrected
from .urscript_targets import urscript_head, urscript_targets
from .urscript_text import urscript_literals

MARK = "zerobeam export program"  # in the head of what was corrected once
_SHOWN = 8  # problems of a program that are named
_REMARK = 32  # characters of a FANUC remark


@dataclass(frozen=True)
class Language:
    """What is particular to the programs of one vendor."""

    name: str
    vendor: Vendor
    targets: Callable[[Source], Parsed]
    head: Callable[[str], tuple[int, str]]
    pose: Callable[[Sequence[float]], Matrix]
    form: str  # of a pose on the command line
    literals: Callable[[str], list[tuple[int, int]]]  # places of all literals of poses and joints


LANGUAGES: Mapping[str, Language] = {
    ".mod": Language(
        "RAPID", "abb", rapid_targets, rapid_head, from_quaternion, "X,Y,Z,Q1,Q2,Q3,Q4", rapid_literals
    ),
    ".src": Language("KRL", "kuka", krl_targets, krl_head, from_abc, "X,Y,Z,A,B,C", krl_literals),
    ".ls": Language("TP", "fanuc", fanuc_targets, fanuc_head, from_rpy, "X,Y,Z,W,P,R", fanuc_literals),
    ".script": Language(
        "URScript",
        "universal-robots",
        urscript_targets,
        urscript_head,
        from_rotation_vector,
        "X,Y,Z,RX,RY,RZ in metres and radians",
        urscript_literals,
    ),
}
_SAME = {".dat": ".src", ".prg": ".mod", ".sys": ".mod", ".urscript": ".script"}


@dataclass(frozen=True)
class Choices:
    """What the command line states of a program."""

    tools: Sequence[str] = ()
    frames: Sequence[str] = ()
    leave: Sequence[str] = ()
    near: str | None = None
    j3: J3 | None = None
    calls: Sequence[str] = ()


@dataclass(frozen=True)
class Filtered:
    """The files of the corrected program, and sentences about what was done and what was not."""

    files: dict[Path, bytes]
    said: list[str]


def language_of(path: Path) -> Language:
    """By the end of the file's name."""
    suffix = path.suffix.lower()
    found = LANGUAGES.get(_SAME.get(suffix, suffix))
    if found is None:
        raise BadInput(
            "the file ending is of no language that is read here",
            found=path.name,
            allowed=".mod (RAPID), .src and .dat (KRL), .ls (FANUC), .script (URScript)",
            file=path,
        )
    return found


def files_of(path: Path) -> list[Path]:
    """The files of the program: of KRL the .src and the .dat of one name, as far as they are there."""
    suffix = path.suffix.lower()
    if suffix not in (".src", ".dat"):
        return [path]
    others = [own for own in path.parent.iterdir() if own.stem == path.stem] if path.parent.is_dir() else []
    found = [path, *(own for own in others if own.suffix.lower() in {".src", ".dat"} - {suffix})]
    return sorted(found, key=lambda own: own.suffix.lower(), reverse=True)


def filtered(
    nominal: Robot, calibration: Calibration, path: Path, out: Path, choices: Choices | None = None
) -> Filtered:
    """The program `path` with corrected targets, for `out`.

    BadInput for another vendor's robot, for a program that was corrected before, and for one with
    motions that are not understood: then all of them are named.
    """
    language, choices = language_of(path), choices or Choices()
    note = require_vendor(nominal, language.vendor, f"a program in {language.name}")
    require_axes(nominal, 6, f"a program in {language.name}")
    if out.suffix.lower() != path.suffix.lower():
        raise BadInput(
            "the corrected program has another file ending", found=out.name, allowed=f"*{path.suffix}"
        )
    paths = files_of(path)
    texts = [_text(own) for own in paths]
    # The .dat begins on a line of its own.
    parts = [text if text.endswith("\n") else text + "\n" for text in texts]
    stated = _stated(language, nominal, choices)
    source = Source("".join(parts), nominal, stated)
    parsed = language.targets(source)
    arms = Arms(
        up_to_flange(nominal, nominal),
        up_to_flange(calibration.corrected, nominal),
        np.array([offset.internal for offset in calibration.offsets]),
        -1 if language.vendor == "kuka" else 1,
    )
    done = corrected(parsed, arms, stated.near)
    _claim_all(language, source, parsed)
    if parsed.problems:
        raise _not_understood(parsed, parts, paths)
    stated.check_names()
    if not parsed.targets:
        raise BadInput(
            "the program has no targets to correct", file=path, allowed="joint and Cartesian targets"
        )
    said = [*_summary(calibration, parsed, done, choices), *([] if note is None else [note])]
    ends = np.cumsum([0, *map(len, parts)])
    files = {}
    for own, text, start in zip(paths, texts, ends.tolist(), strict=False):
        edits = [
            Edit(edit.start - start, edit.end - start, edit.text)
            for edit in done.edits
            if start <= edit.start < start + len(text)
        ]
        name = out if own == path else out.with_suffix(own.suffix)
        whole = _with_head(language, _applied(text, edits), calibration, said, path.name).encode("latin-1")
        # What an editor put before the first line stays there, and only there.
        files[name] = BOM_UTF8 + whole if read_bytes(own).startswith(BOM_UTF8) else whole
    return Filtered(files, said)


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


def _stated(language: Language, robot: Robot, choices: Choices) -> Stated:
    upper = language.name in ("TP", "URScript")
    if language.name == "TP":
        choices = replace(choices, j3=pendant_of(robot, choices.j3, "fanuc").joint3)
    elif choices.j3 is not None:
        raise BadInput(f"--j3 is not for {language.name}", remedy="leave --j3 out")
    near = None
    if choices.near is not None:
        near = np.array(stated_numbers(choices.near, robot.n, "--near", "J1,J2,…"))
        near = Pendant(robot, choices.j3).between_links(near) if choices.j3 else near
    return Stated(
        dict(_frame(text, "--tool", language) for text in choices.tools),
        dict(_frame(text, "--frame", language) for text in choices.frames),
        frozenset(_bare(name) if upper else _bare(name).lower() for name in choices.leave),
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
    claimed = {(place.start, place.end) for place in parsed.literals}
    lines = {line for line, _ in parsed.problems}
    for span in sorted(claimed ^ set(language.literals(source.text))):
        line = source.line(span[0])
        if line not in lines:
            literal = " ".join(source.text[slice(*span)].split())[:60]
            parsed.problems.append((line, f"{literal}: it is not said what this position is (--leave?)"))


def _bare(name: str) -> str:
    """P[3] of FANUC is 3."""
    found = re.fullmatch(r"[Pp]\[(\d+)\]", name)
    return found[1] if found else name


def _frame(text: str, option: str, language: Language) -> tuple[str, Matrix]:
    name, _, values = text.rpartition("=")
    count = language.form.split(" ")[0].count(",") + 1
    return name.strip().lower(), language.pose(
        stated_numbers(values, count, option, f"[NAME=]{language.form}")
    )


def _not_understood(parsed: Parsed, texts: Sequence[str], paths: Sequence[Path]) -> BadInput:
    """What is not understood, by file and line."""
    lines = [text.count("\n") for text in texts]
    said = []
    for line, sentence in sorted(dict.fromkeys(parsed.problems)):
        file, own = (paths[1], line - lines[0]) if len(paths) > 1 and line > lines[0] else (paths[0], line)
        said.append(f"{file.name} line {own}: {sentence}")
    shown = "\n           ".join(said[:_SHOWN])
    more = f"\n           and {len(said) - _SHOWN} more" if len(said) > _SHOWN else ""
    return BadInput(
        "the program cannot be corrected as a whole, so nothing is written",
        found=shown + more,
        remedy="state what is asked for, rewrite these lines with fixed targets, or leave targets that are"
        " right as they are (taught on this very arm) by --leave NAME",
        file=paths[0],
    )


def _summary(calibration: Calibration, parsed: Parsed, done: Corrected, choices: Choices) -> list[str]:
    gone = [offset.name for offset in calibration.offsets if not offset.exported]
    uses = Counter(place.use for place in parsed.literals)
    said = [
        f"positions in the program: {uses.total()}; corrected: {uses['target']};"
        f" left as they are: {uses['left']}; poses of tools and frames: {uses['frame']}",
        f"joint targets: {done.joint_targets}, moved by up to {done.most_joint:.3f} deg; Cartesian targets:"
        f" {done.poses}, moved by up to {done.most_mm:.3f} mm",
    ]
    if gone:
        said.append(f"not corrected, as 0: {', '.join(gone)}")
    if choices.leave:
        said.append(f"left as they are: {listed(list(choices.leave))}")
    if done.changed:
        said.append(f"another configuration is needed, and written, at {listed(done.changed)}")
    if done.nearest:
        said.append(f"configuration taken from the joints nearest by, at {listed(done.nearest)}")
    return [*said, *parsed.left]


def _applied(text: str, edits: Sequence[Edit]) -> str:
    for edit in sorted(edits, reverse=True):
        text = text[: edit.start] + edit.text + text[edit.end :]
    return text


def _with_head(
    language: Language, text: str, calibration: Calibration, said: Sequence[str], name: str
) -> str:
    place, begin = language.head(text)
    newline = "\r\n" if "\r\n" in text else "\n"
    if language.name == "TP":
        lines = [
            MARK,
            f"zerobeam {calibration.versions['zerobeam']}, offsets of the run",
            calibration.sha256[:16],
            *(
                f"{own.name} {own.applied:+.4f}" if own.exported else f"{own.name} NOT CORRECTED"
                for own in calibration.offsets
            ),
        ]
        rows = [f"{begin}{one_line(line).replace(';', ',')[:_REMARK]} ;" for line in lines]
    else:
        lines = [f"{MARK}: {name} with the offsets below", *said, *calibration.head]
        rows = [begin + one_line(line) for line in lines]
    return text[:place] + "".join(row + newline for row in rows) + text[place:]
