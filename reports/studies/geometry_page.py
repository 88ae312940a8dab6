"""The page of the study `geometry`: what intervals are worth if the arm deviates from nominal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...experiments.studies.geometry_coverage import (
    GeometryEstimator,
    GeometryParameter,
    GeometryPlan,
    GeometryStudy,
    ToleranceLevel,
)
from ...words import numbers
from ...words.wording import clipped, counted, label
from ..style.blocks import (
    Cell,
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
from ..style.canvas import Picture
from . import study_blocks as blocks
from .coverage_page import shares_picture
from .study_figures import Across, Curve, CurvePanel, Dot, Look, MarkRow, Scale, curves_picture, rows_picture

# What `check` predicts, in words, and the role of its colour.
_KINDS = (
    ("noise_only", "noise only", "held"),
    ("considered", "considered", "weak"),
    ("freed", "freed", "identified"),
)
_ABOUT = (
    "Noise only: geometry taken as nominal, of an arm that has it. Considered: geometry taken as nominal, of"
    " an arm that deviates by the tolerances. Freed: the geometry estimated, with the tolerances as priors."
    " From the smallest u of an offset to the largest, as `zerobeam check` predicts it."
)

PARAMETERS = blocks.flat(
    "plans estimators parameters coverage",
    "plan=1.name geometry=2.name control=2.control parameter=3.name unit=3.unit status=3.status"
    " level=0.settings.level held of share low high agrees"
    + "".join(
        f" {name}=3.{name}" for name in (*blocks.ERRORS.split(), "z", "z_low", "z_high", "checked_std")
    ),
)
PLANS = blocks.flat(
    "plans checked",
    "plan=1.name chosen_for=1.chosen_for robot=1.robot shots=1.shots arms=1.arms failed=1.failed"
    " efficiency=1.efficiency length_mm=1.tolerance.length_mm angle_deg=1.tolerance.angle_deg"
    " joint_deg=1.noise.joint_deg spot_mm=1.noise.spot_mm parameter=2.name unit noise_only considered freed",
)


def geometry_page(answer: GeometryStudy) -> Page:
    """The display strings of a study of arms that deviate from nominal geometry."""
    settings, plans = answer.settings, answer.plans
    level = settings.level
    estimators = [estimator for plan in plans for estimator in plan.estimators]

    def cells(one: GeometryEstimator) -> list[str]:
        zs = [row.z for row in one.parameters if row.z is not None]
        ends = [numbers.significant(pick(zs)) for pick in (min, max)] if zs else []
        z = " to ".join(ends) or blocks.NOT_DETERMINED
        return [blocks.worst_cell(one, level), z, f"{one.misfit} of {one.converged}"]

    sections = [
        section_of(
            "All plans",
            blocks.overview(
                f"{blocks.FARTHEST} {blocks.percent(level)}; errors in standard uncertainties; answers that"
                " say misfit",
                ["geometry", "intervals", "farthest", "z", "misfit"],
                [
                    (blocks.plan_title(one.name), counted(one.shots, "measurement"), one.estimators)
                    for one in plans
                ],
                cells,
            ),
            Legend(blocks.meanings(estimators), []),
            Paragraph(blocks.BY_CHANCE),
        ),
        section_of(
            "What geometry does to the uncertainty",
            Paragraph(_ABOUT),
            _predicted(plans),
            FigureBlock("uncertainty") if _uncertainty_picture(plans) else None,
        ),
        section_of(
            "Errors in standard uncertainties",
            Paragraph("z is the root mean square of an offset’s errors in its own u: 1 if u is right."),
            FigureBlock("z") if _z_picture(plans) else None,
        ),
        section_of(
            f"How often the {blocks.percent(level)} intervals contain the true value",
            Paragraph("With the geometry estimated."),
            FigureBlock("coverage"),
        ),
    ]
    return blocks.view_of(
        answer,
        f"{settings.arms} simulated arms for each of {counted(len(plans), 'plan')}",
        sections,
        "parameters.csv and plans.csv hold the shares, the errors and the predictions",
        details=[_plan(plan, level) for plan in plans],
    )


def _predicted(plans: Sequence[GeometryPlan]) -> Table:
    rows = []
    for plan in plans:
        unit = plan.checked[0].unit if len({row.unit for row in plan.checked}) == 1 else ""
        ranges = [
            blocks.smallest_to_largest((getattr(row, kind) for row in plan.checked), unit)
            for kind, *_ in _KINDS
        ]
        rows.append(row_of(clipped(plan.name, blocks.LONGEST_NAME), tolerances(plan.tolerance), *ranges))
    heads = ["plan", "tolerances", "noise only", "considered", "freed"]
    return table_of("Predicted u of the offsets, smallest to largest", heads, rows, "llr")


def tolerances(level: ToleranceLevel) -> str:
    """Both tolerances in words."""
    return f"{numbers.exact(level.length_mm, 'mm')}, {numbers.exact(level.angle_deg, 'deg')}"


def _plan(plan: GeometryPlan, level: float) -> Section:
    facts = [
        ("Tolerances", tolerances(plan.tolerance)),
        ("Arms", str(plan.arms)),
        blocks.unmet_fact(plan.failed),
    ]
    if plan.efficiency is not None:
        certified = f"{numbers.significant(100 * plan.efficiency)}{numbers.NO_BREAK}%"
        facts.append(("Certified efficiency", certified))

    def cells(row: GeometryParameter, control: bool) -> list[str | Cell] | None:
        if (both := blocks.share_and_errors(row, control)) is None:
            return None
        return [both[0], _z_text(row), *both[1:], blocks.spread(row.checked_std, row.unit)]

    table = blocks.parts_table(
        f"{blocks.SHARES}; errors in standard uncertainties; bias and root mean square error, next to what"
        " was stated, and u by check",
        [f"within {blocks.percent(level)}", "z", *blocks.ERROR_COLUMNS, "u by check"],
        plan.estimators,
        cells,
    )
    legend = Legend([], blocks.verdicts(plan.estimators))
    return section_of(
        blocks.plan_title(plan.name), blocks.plan_facts(plan, *facts), legend, table, new_page=True
    )


def _z_text(row: GeometryParameter) -> str:
    """z with its 95 % interval."""
    if row.z is None or row.z_low is None or row.z_high is None:
        return blocks.NOT_GIVEN
    digits = numbers.decimals((row.z_high - row.z_low) / 4)
    z, low, high = (numbers.fixed(value, digits) for value in (row.z, row.z_low, row.z_high))
    return f"{z} ({low} to {high})"


def geometry_pictures(answer: GeometryStudy) -> list[Picture | None]:
    plans, level = answer.plans, answer.settings.level
    parts = [replace(one, name=plan.name) for plan in plans for one in plan.estimators if one.name == "freed"]
    counts = [share.of for part in parts for row in part.parameters for share in row.shares]
    title = (
        f"How often the {blocks.percent(level)} intervals contain the true value, with the geometry estimated"
    )
    shares = shares_picture(parts, [level], min(counts, default=1), "coverage", title) if parts else None
    return [_uncertainty_picture(plans), _z_picture(plans), shares]


def _uncertainty_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """Bands from the smallest u of an offset to the largest over the numbers of measurements, of the plans
    for nominal geometry that have the tolerances of the first; a dashed line is the largest of those chosen
    for free geometry. None where fewer than two numbers of measurements can be compared."""
    known = [plan for plan in plans if _all_known(plan)]
    chosen = [plan for plan in known if plan.chosen_for == "nominal"]
    chosen = [plan for plan in chosen if plan.tolerance == chosen[0].tolerance]
    if len(chosen) < 2:
        return None
    shots = [plan.shots for plan in chosen]
    ranges = {kind: [_ends(plan, kind) for plan in chosen] for kind, *_ in _KINDS}
    curves = [
        Curve(shots, high, words, Look(role=role, size=3.5), low, high, band=True)
        for kind, words, role in _KINDS
        for low, high in [tuple(zip(*ranges[kind], strict=True))]
    ]
    better = [plan for plan in known if plan.chosen_for == "freed" and plan.tolerance == chosen[0].tolerance]
    if len(better) > 1:
        highest = [_ends(plan, "freed")[1] for plan in better]
        words = "the same, plan chosen for it"
        dashed = Look(stroke="--", filled=False, size=3.5)
        curves.append(Curve([one.shots for one in better], highest, words, dashed))
    texts = []
    for i, plan in enumerate(chosen):
        by_kind = (
            f"{words} {blocks.smallest_to_largest(ranges[kind][i], 'deg')}" for kind, words, _ in _KINDS
        )
        texts.append(f"{plan.shots} measurements: {', '.join(by_kind)}")
    return curves_picture(
        "uncertainty",
        "Predicted u of the offsets by the number of measurements: from the smallest (band) to the largest",
        f"Smallest to largest u of the offsets. {'; '.join(texts)}.",
        [CurvePanel(curves, Scale(log=True), across="measurements", up="u of the offsets, °")],
        Scale(log=True, ticks=shots),
    )


def _all_known(plan: GeometryPlan) -> bool:
    return bool(plan.checked) and all(
        getattr(row, kind) is not None and row.unit == "deg" for row in plan.checked for kind, *_ in _KINDS
    )


def _ends(plan: GeometryPlan, kind: str) -> tuple[float, float]:
    values = [getattr(row, kind) for row in plan.checked]
    return min(values), max(values)


def _z_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """A row for each estimator of each plan, a dot for each offset; logarithmic, with a line at 1. None where
    there is nothing to draw."""
    rows, texts = [], []
    for plan in plans:
        rows.append(MarkRow(f"Plan {clipped(plan.name, 36)}", head=True))
        parts = []
        for one in plan.estimators:
            zs = [row.z for row in one.parameters if row.z]
            role = "identified" if one.agrees else "held" if one.control else "weak"
            look = Look(role=role, filled=not one.control, size=3.2, width=0.8)
            marks = [Dot(z, min(zs), max(zs), look) for z in zs]
            rows.append(MarkRow(one.name, [marks], "" if zs else blocks.NOT_DETERMINED))
            offsets = [
                f"{label(row.name)} {numbers.or_words(row.z or None, blocks.NOT_DETERMINED)}"
                for row in one.parameters
            ]
            parts.append(f"{one.name} ({blocks.standing(one)[1]}): {', '.join(offsets)}")
        texts.append(f"plan {clipped(plan.name, 40)}: {'; '.join(parts)}")
    if not any(row.panels and row.panels[0] for row in rows):
        return None
    return rows_picture(
        "z",
        "Errors of the offsets in their standard uncertainties, a dot for each offset; line: u is right",
        f"Root mean square of the errors in standard uncertainties. {'. '.join(texts)}.",
        rows,
        [Across("root mean square of the errors, in standard uncertainties", Scale(log=True), [1.0])],
    )
