"""The page of the study `geometry`: what intervals are worth if the arm deviates from nominal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ....experiments.studies.geometry.answer import (
    CheckedOffset,
    GeometryEstimator,
    GeometryParameter,
    GeometryPlan,
    GeometrySettings,
    GeometryStudy,
    ToleranceLevel,
)
from ....words import numbers
from ....words.wording import clipped, counted, label, sentence
from ...style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    Page,
    Paragraph,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from ...style.canvas import Picture
from ..coverage_figure import coverage_picture
from ..phrases import (
    LONGEST_NAME,
    NOT_DETERMINED,
    NOT_GIVEN,
    about_study,
    files_block,
    noise_in_words,
    plan_in_words,
    plan_title,
    spread,
    view_of,
)
from ..shares import (
    BY_CHANCE,
    ERROR_COLUMNS,
    PlainRow,
    error_cells,
    meanings,
    percent,
    share_cell,
    share_columns,
    standing,
    verdicts,
    worst_cell,
)
from .uncertainty_figure import uncertainty_picture
from .z_figure import z_picture

_ERRORS = ("bias", "bias_mcse", "rmse", "predicted_std", "z", "z_low", "z_high", "checked_std")
_KINDS = ("noise_only", "considered", "freed")
_ABOUT = (
    "Noise only: geometry taken as nominal, of an arm that has it. Considered: geometry taken as nominal, of"
    " an arm that deviates by the tolerances. Freed: the geometry estimated, with the tolerances as priors."
    " From the smallest u of an offset to the largest, as `zerobeam check` predicts it."
)


def geometry_page(answer: GeometryStudy) -> Page:
    """The display strings of a study of arms that deviate from nominal geometry."""
    settings, plans = answer.settings, answer.plans
    estimators = [own for plan in plans for own in plan.estimators]
    sections = [
        section_of(
            "All plans",
            _overview(plans, settings),
            Legend(meanings(estimators), []),
            Paragraph(BY_CHANCE),
        ),
        section_of(
            "What geometry does to the uncertainty",
            Paragraph(_ABOUT),
            _predicted(plans),
            FigureBlock("uncertainty") if uncertainty_picture(plans) else None,
        ),
        section_of(
            "Errors in standard uncertainties",
            Paragraph("z is the root mean square of an offset’s errors in its own u: 1 if u is right."),
            FigureBlock("z") if z_picture(plans) else None,
        ),
        section_of(
            f"How often the {percent(settings.level)} intervals hold the truth",
            Paragraph("With the geometry estimated."),
            FigureBlock("coverage"),
        ),
        section_of(
            "How it was done",
            about_study(
                answer,
                [
                    ("Arms for each plan", str(settings.arms)),
                    ("Seed", str(settings.seed)),
                    ("Level of the intervals", percent(settings.level)),
                    ("Chance of a false alarm", percent(settings.chance)),
                    ("Offsets of the arms", numbers.exact(settings.offset_deg, "deg")),
                    ("Candidates of a plan", str(settings.candidates)),
                ],
            ),
            files_block("parameters.csv and plans.csv hold the shares, the errors and the predictions"),
        ),
        *(section for plan in plans for section in _plan(plan, settings)),
    ]
    subtitle = (
        f"{settings.arms} simulated arms for each of {counted(len(plans), 'plan')}, seed {settings.seed}"
    )
    return view_of(answer, subtitle, sections)


def _overview(plans: Sequence[GeometryPlan], settings: GeometrySettings) -> Table:
    # The verdict second, so that a phone shows it without scrolling.
    columns = [("geometry", "left"), ("intervals", "left"), ("farthest", "right"), ("z", "right")]
    columns.append(("misfit", "right"))
    rows = []
    for plan in plans:
        about = Cell(counted(plan.shots, "measurement"), span=len(columns) - 1)
        rows.append(row_of(plan_title(plan.name), about))
        for own in plan.estimators:
            mark, words = standing(own)
            cells = [worst_cell(own, settings.level), z_range(own), f"{own.misfit} of {own.converged}"]
            rows.append(row_of(own.name, Cell(words, mark=mark), *cells, tone=mark))
    caption = (
        "Share of intervals that hold the truth, in %: the parameter farthest from"
        f" {percent(settings.level)}; errors in standard uncertainties; answers that say misfit"
    )
    return table_of(caption, columns, rows)


def z_range(own: GeometryEstimator) -> str:
    """Smallest to largest root mean square of errors in standard uncertainties."""
    zs = [row.z for row in own.parameters if row.z is not None]
    if not zs:
        return NOT_DETERMINED
    return f"{numbers.significant(min(zs))} to {numbers.significant(max(zs))}"


def _predicted(plans: Sequence[GeometryPlan]) -> Table:
    columns = [("plan", "left"), ("tolerances", "left"), ("noise only", "right"), ("considered", "right")]
    columns.append(("freed", "right"))
    rows = []
    for plan in plans:
        ranges = [u_range(plan.checked, kind) for kind in _KINDS]
        rows.append(row_of(clipped(plan.name, LONGEST_NAME), tolerances(plan.tolerance), *ranges))
    return table_of("Predicted u of the offsets, smallest to largest", columns, rows)


def tolerances(level: ToleranceLevel) -> str:
    """Both tolerances in words."""
    return f"{numbers.exact(level.length_mm, 'mm')}, {numbers.exact(level.angle_deg, 'deg')}"


def u_range(rows: Sequence[CheckedOffset], kind: str) -> str:
    """Smallest to largest u of the offsets that the plan determines; words for the others."""
    found = [getattr(row, kind) for row in rows]
    known = [value for value in found if value is not None]
    if not known:
        return NOT_DETERMINED
    unit = rows[0].unit if len({row.unit for row in rows}) == 1 else ""
    text = f"{spread(min(known))} to {spread(max(known), unit)}"
    return text if len(known) == len(found) else f"{text}; {len(found) - len(known)} {NOT_DETERMINED}"


def _plan(plan: GeometryPlan, settings: GeometrySettings) -> list[Section]:
    facts = [
        ("Plan", plan_in_words(plan.words, plan.shots, noise_in_words(plan.noise), plan.robot)),
        ("Tolerances", tolerances(plan.tolerance)),
        ("Arms", str(plan.arms)),
        ("Targets not hit", f"{plan.failed} (others drawn in their place)" if plan.failed else "none"),
    ]
    if plan.efficiency is not None:
        certified = f"{numbers.significant(100 * plan.efficiency)}{numbers.NO_BREAK}%"
        facts.append(("Certified efficiency", certified))
    return [
        section_of(
            plan_title(plan.name),
            Facts(facts),
            Legend([], verdicts(plan.estimators)),
            _parameters(plan, settings.level),
            new_page=True,
        )
    ]


def _parameters(plan: GeometryPlan, level: float) -> Table:
    columns = [("parameter", "left"), (f"within {percent(level)}", "right"), ("z", "right")]
    columns += [*ERROR_COLUMNS, ("u by check", "right")]
    rows = []
    for own in plan.estimators:
        mark, words = standing(own)
        about = f"{sentence(own.words)} ({words})"
        rows.append(row_of(own.name, Cell(about, span=len(columns) - 1), tone=mark))
        for row in own.parameters:
            name = label(row.name)
            if row.coverage is None:
                undetermined = Cell(NOT_DETERMINED, span=len(columns) - 1)
                rows.append(row_of(name, undetermined, tone="unidentifiable"))
                continue
            cell = share_cell(row.coverage, own.control)
            last = [z_text(row), *error_cells(row, row.coverage.of), spread(row.checked_std, row.unit)]
            rows.append(row_of(name, cell, *last, tone=cell.mark))
    caption = (
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval; errors in standard"
        " uncertainties; bias and root mean square error, next to what was stated, and u by check"
    )
    return table_of(caption, columns, rows)


def z_text(row: GeometryParameter) -> str:
    """z with its 95 % interval."""
    if row.z is None or row.z_low is None or row.z_high is None:
        return NOT_GIVEN
    digits = numbers.decimals((row.z_high - row.z_low) / 4)
    low, high = numbers.fixed(row.z_low, digits), numbers.fixed(row.z_high, digits)
    return f"{numbers.fixed(row.z, digits)} ({low} to {high})"


@dataclass(frozen=True)
class _Part:
    """A plan by its estimator with free geometry, as the figure of the shares takes it."""

    name: str
    control: bool
    agrees: bool
    sentence: str
    parameters: tuple[GeometryParameter, ...]


def geometry_pictures(answer: GeometryStudy) -> list[Picture | None]:
    plans, level = answer.plans, answer.settings.level
    parts = [
        _Part(plan.name, own.control, own.agrees, own.sentence, own.parameters)
        for plan in plans
        for own in plan.estimators
        if own.name == "freed"
    ]
    counts = [row.coverage.of for part in parts for row in part.parameters if row.coverage is not None]
    title = f"How often the {percent(level)} intervals hold the truth, with the geometry estimated"
    shares = coverage_picture(parts, [level], min(counts, default=1), "coverage", title) if parts else None
    return [uncertainty_picture(plans), z_picture(plans), shares]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def parameter_rows(answer: GeometryStudy) -> Iterator[PlainRow]:
    """One row for each plan, estimator and parameter; nothing but names where it is not determined."""
    for plan in answer.plans:
        for own in plan.estimators:
            for row in own.parameters:
                yield {
                    "plan": plan.name,
                    "geometry": own.name,
                    "control": own.control,
                    "parameter": row.name,
                    "unit": row.unit,
                    "status": row.status,
                    "level": answer.settings.level,
                    **share_columns(row.coverage),
                    **{key: getattr(row, key) for key in _ERRORS},
                }


def plan_rows(answer: GeometryStudy) -> Iterator[PlainRow]:
    """One row for each plan and offset: what `check` predicts."""
    for plan in answer.plans:
        for row in plan.checked:
            yield {
                "plan": plan.name,
                **{key: getattr(plan, key) for key in ("chosen_for", "robot", "shots", "arms", "failed")},
                "efficiency": plan.efficiency,
                "length_mm": plan.tolerance.length_mm,
                "angle_deg": plan.tolerance.angle_deg,
                "joint_deg": plan.noise.joint_deg,
                "spot_mm": plan.noise.spot_mm,
                "parameter": row.name,
                "unit": row.unit,
                **{kind: getattr(row, kind) for kind in _KINDS},
            }
