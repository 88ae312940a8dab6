"""The page of an acceptance test: the error measured before and after, the verdict and its rule."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from ..analysis.acceptance import (
    Acceptance,
    AcceptancePlan,
    AcceptanceResult,
    EnteredOffset,
    MeasuredError,
    PostureError,
)
from ..analysis.status import Verdict as Tone
from ..analysis.status import versions
from ..experiments.acceptance_files import ACCEPTANCE_SCHEMA, RunOfTest, Verified
from ..model.errors import BadInput
from ..model.files.header import by_plain_key
from ..model.parsing.reading import LARGEST_RECORDING, read_text
from ..model.records import read, to_json
from ..words import numbers
from ..words.controllers import no_offsets_words, taken_by
from ..words.enter import (
    ACCEPTANCE_WORDS,
    CONTROLLERS_MODEL,
    RULE,
    acceptance_reason,
    measured_sentence,
    mistake_sentence,
    narrow_sentence,
    not_judged_sentence,
    noticed_sentence,
    probability_words,
)
from ..words.provenance import DATE, KEYS, OPERATOR, SERIAL, SIMULATED, provenance_entry
from ..words.wording import clipped, counted, label, listed, measured_at, shown
from .output.whole_folder import FolderContents, Kind, write_answer
from .style.blocks import (
    Block,
    FigureBlock,
    Form,
    Page,
    Paragraph,
    Row,
    Table,
    Verdict,
    plain_page,
    row_of,
    section_of,
    table_of,
)
from .style.canvas import Picture, bare_y, beside, new_figure, style, to_svg
from .style.theme import light

NAME = "before_and_after"
MOST_DRAWN = 30
_TONES: dict[Acceptance, Tone] = {"pass": "pass", "fail": "misfit", "inconclusive": "weak"}
_UNKNOWN = "not stated"
_STEPS = (
    "Enter the values, bring targets back to about their places, and record these postures with the"
    " corrected robot, as the run was recorded."
)
_NOTHING_ENTERED = (
    "This plan and zerobeam verify are for a robot into which the values were entered; with corrected"
    " programs or a corrected model the arm moves otherwise. To test the calibration there, measure a second"
    " run with the same header: zerobeam analyse RUN --hold-out NEW.jsonl."
)


def acceptance_page(verified: Verified) -> Page:
    """All that the report of an acceptance test shows."""
    measured, labels = verified.measured, verified.calibration.recorded.header.labels
    names = [posture.target for posture in measured.postures]
    return Page(
        "Verification of a calibration",
        f"{clipped(verified.calibration.recorded.robot.name)},"
        f" {counted(verified.measurements, 'measurement')} of {clipped(verified.run.file, 60)}",
        Verdict(_TONES[verified.verdict], ACCEPTANCE_WORDS[verified.verdict], acceptance_reason(verified)),
        list(_notes(verified)),
        [
            section_of(
                "Measured before and after",
                Paragraph(measured_sentence(measured)),
                FigureBlock(NAME),
                _errors_table(measured, measured_at(names, labels)),
                Paragraph(f"{CONTROLLERS_MODEL} The noise is the standard deviation of one measurement."),
                brief=True,
            ),
            section_of("The test and its rule", *_test(verified), brief=True),
            section_of("What was compared", _compared(verified)),
            section_of("Approval", Form(_approved(verified.run), ("Signature",))),
        ],
        [
            (SERIAL, clipped(_entry(verified.calibration, SERIAL) or _UNKNOWN, 40)),
            ("Verified on", clipped(_entry(verified.run, DATE) or _UNKNOWN, 40)),
        ],
    )


def _notes(verified: Verified) -> Iterator[str]:
    runs = (verified.calibration, verified.run)
    if any(by_plain_key(run.provenance).get("origin") == SIMULATED for run in runs):
        yield "These measurements were simulated: no robot was verified."
    if verified.conformity is not None:
        yield not_judged_sentence(verified.conformity)


def _entry(run: RunOfTest, name: str) -> str:
    return provenance_entry(by_plain_key(run.provenance), KEYS[name])


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def _errors_table(measured: MeasuredError, at: str) -> Table:
    def row(posture: PostureError) -> Row:
        before = "—" if posture.before_mm is None else numbers.significant(posture.before_mm, 2, "mm")
        after, noise = (numbers.significant(value, 2, "mm") for value in (posture.after_mm, posture.noise_mm))
        return row_of(str(posture.measurement), clipped(posture.target, 24), before, after, noise)

    columns = ["measurement", at, "as found", "as left", "noise"]
    return table_of("Error, posture by posture", columns, [row(one) for one in measured.postures], "rlr")


def _test(answer: AcceptanceResult) -> Iterator[Block]:
    yield Paragraph(RULE)
    yield noticed_table(answer.offsets)
    yield Paragraph(noticed_sentence(answer.offsets))
    for mistake in answer.mistakes[:3]:
        yield Paragraph(mistake_sentence(mistake))


def acceptance_plan_page(plan: AcceptancePlan, vendor: str | None) -> Page:
    """What the planned test would notice, and what to do at a controller of this vendor."""
    caution = f"Caution: {no_offsets_words(vendor)}. {_NOTHING_ENTERED}"
    count = counted(len(plan.rows), "posture")
    return plain_page(
        "",
        Paragraph(f"{count} of the run: measurements {listed([str(row) for row in plan.rows], 20)}."),
        noticed_table(plan.offsets),
        Paragraph(noticed_sentence(plan.offsets)),
        Paragraph(narrow_sentence()) if plan.narrow else None,
        Paragraph(_STEPS if taken_by(vendor) == "offsets" else caution),
    )


def noticed_table(offsets: Sequence[EnteredOffset]) -> Table:
    """What the test would notice, offset by offset."""
    rows = [
        row_of(
            label(offset.name),
            numbers.estimate(offset.entered, offset.std, offset.unit),
            f"{numbers.exact(offset.tolerance, offset.unit)}: {probability_words(offset.power)}",
            probability_words(offset.power_not_entered),
        )
        for offset in offsets
    ]
    heads = ("entered", "error of the tolerance", "not entered")
    columns = ["name", *heads]
    return table_of("What the test notices", columns, rows)


def _compared(verified: Verified) -> Table:
    runs = (verified.calibration, verified.run)
    rows = [
        row_of("Run", *(shown(run.file) for run in runs)),
        row_of("Measurements", *(str(len(run.recorded.shots)) for run in runs)),
        *(
            row_of(name, *(_entry(run, name) or _UNKNOWN for run in runs))
            for name in (SERIAL, DATE, OPERATOR)
        ),
        row_of("SHA-256", *(run.sha256 for run in runs)),
        row_of("zerobeam", "", versions()["zerobeam"]),
    ]
    return table_of("The two runs", ["", "calibration, as found", "verification, as left"], rows, "l")


def _approved(run: RunOfTest) -> list[tuple[str, str]]:
    provenance = by_plain_key(run.provenance)
    return [("Approved by", provenance_entry(provenance, KEYS["Authorised by"])), ("Date of approval", "")]


# ── the figure ────────────────────────────────────────────────────────────────────────────────


def errors_picture(measured: MeasuredError) -> Picture:
    """Each posture's error as found and as left on one scale from 0, with a line between them; of many
    postures those with the largest error as left."""
    drawn = sorted(measured.postures, key=lambda posture: -posture.after_mm)[:MOST_DRAWN]
    drawn.sort(key=lambda posture: posture.measurement)
    at = list(range(len(drawn)))
    with style():
        figure = new_figure(1.1 + 0.26 * len(drawn))
        axes = figure.subplots()
        before = [(y, one.before_mm) for y, one in zip(at, drawn, strict=True) if one.before_mm is not None]
        axes.hlines(
            [y for y, _ in before],
            [drawn[y].after_mm for y, _ in before],
            [mm for _, mm in before],
            color=light("line"),
            linewidth=1.5,
        )
        handles = axes.plot(
            [mm for _, mm in before],
            [y for y, _ in before],
            "D",
            markersize=5.5,
            color=light("weak"),
            markerfacecolor="none",
            mew=1.2,
            label="as found",
        )
        handles += axes.plot(
            [one.after_mm for one in drawn],
            at,
            "o",
            markersize=5.5,
            mew=0,
            color=light("identified"),
            label="as left",
        )
        for y, mm in before:
            after = numbers.significant(drawn[y].after_mm, 2, "mm")
            beside(axes, mm, y, f"{numbers.significant(mm, 2)} → {after}")
        axes.set_yticks(at, [f"measurement {one.measurement}" for one in drawn])
        axes.set_ylim(len(drawn) - 0.4, -0.6)
        farthest = max([one.after_mm for one in drawn] + [mm for _, mm in before])
        axes.set_xlim(0, 1.25 * farthest)
        axes.set_xlabel("error, mm")
        bare_y(axes)
        axes.legend(
            handles=handles if before else handles[1:],
            loc="lower right",
            bbox_to_anchor=(1, 1),
            ncols=2,
            handletextpad=0.2,
        )
        svg = to_svg(figure, NAME)
    title = "Error before and after, on one scale from 0"
    if len(drawn) < len(measured.postures):
        title += f": the {len(drawn)} of {len(measured.postures)} postures with the largest error as left"
    return Picture(NAME, title, measured_sentence(measured), svg)


_TABLE = "errors.csv"
ACCEPTANCE = Kind.of_answer("verification", "verification.json", ACCEPTANCE_SCHEMA, _TABLE)


def write_acceptance_report(folder: Path | str, verified: Verified) -> None:
    """Write the report of an acceptance test to `folder`. Raises as `write_answer`."""
    tables = {_TABLE: [asdict(posture) for posture in verified.measured.postures]}
    picture = errors_picture(verified.measured)
    contents = FolderContents(to_json(verified), acceptance_page(verified), [picture], tables)
    write_answer(folder, ACCEPTANCE, contents)


def read_acceptance(folder: Path, sha256: str) -> Verified:
    """The answer in the folder of a verification of the calibration by the run of this hash.

    BadInput for a folder without one, and for that of another calibration.
    """
    file = folder / ACCEPTANCE.mark
    try:
        answer = read(Verified, read_text(file, LARGEST_RECORDING)[0])
    except ValueError as error:
        raise BadInput(
            "this is not the report of a verification",
            found=str(error),
            allowed="a folder that zerobeam verify RUN NEW -o DIR wrote",
            file=file,
        ) from None
    if (of := answer.calibration.sha256) != sha256:
        raise BadInput(
            "this verification is of another calibration",
            found=f"SHA-256 {of}",
            allowed=f"{sha256}, the run of the result that is certified",
            file=file,
        )
    return answer
