"""The page of the study `geometry`: what intervals are worth if the arm deviates from nominal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...experiments.studies.geometry_coverage import (
    CheckedOffset,
    GeometryEstimator,
    GeometryParameter,
    GeometryPlan,
    GeometrySettings,
    GeometryStudy,
    ToleranceLevel,
)
from ...words import numbers
from ...words.wording import clipped, counted, label
from ..style.blocks import (
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
from ..style.canvas import Picture, bare_y, hatched, new_figure, style, to_svg
from ..style.palette import light
from .coverage_figures import coverage_picture, head_rows, name_rows
from .study_blocks import (
    BY_CHANCE,
    ERROR_COLUMNS,
    LONGEST_NAME,
    NOT_DETERMINED,
    NOT_GIVEN,
    PlainRow,
    columns_of,
    how_it_was_done,
    meanings,
    noise_in_words,
    parameter_columns,
    percent,
    plan_in_words,
    plan_title,
    rows_of,
    share_and_errors,
    spread,
    standing,
    standing_cell,
    unmet_in_words,
    verdicts,
    view_of,
    worst_cell,
)

# u by kind: key, words, role of the colour.
_KINDS = (
    ("noise_only", "noise only", "held"),
    ("considered", "nominal, arm has tolerances", "weak"),
    ("freed", "geometry estimated", "identified"),
)
_ROW, _TALLEST = 0.16, 7.4  # inches
_ABOUT = (
    "Noise only: geometry taken as nominal, of an arm that has it. Considered: geometry taken as nominal, of"
    " an arm that deviates by the tolerances. Freed: the geometry estimated, with the tolerances as priors."
    " From the smallest u of an offset to the largest, as `zerobeam check` predicts it."
)


def geometry_page(answer: GeometryStudy) -> Page:
    """The display strings of a study of arms that deviate from nominal geometry."""
    settings, plans = answer.settings, answer.plans
    estimators = [estimator for plan in plans for estimator in plan.estimators]
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
        how_it_was_done(
            answer,
            [
                ("Arms for each plan", str(settings.arms)),
                ("Seed", str(settings.seed)),
                ("Level of the intervals", percent(settings.level)),
                ("Probability of a false alarm", percent(settings.chance)),
                ("Offsets of the arms", numbers.exact(settings.offset_deg, "deg")),
                ("Candidates of a plan", str(settings.candidates)),
            ],
            "parameters.csv and plans.csv hold the shares, the errors and the predictions",
        ),
        *(section for plan in plans for section in _plan(plan, settings)),
    ]
    subtitle = (
        f"{settings.arms} simulated arms for each of {counted(len(plans), 'plan')}, seed {settings.seed}"
    )
    return view_of(answer, subtitle, sections)


def _overview(plans: Sequence[GeometryPlan], settings: GeometrySettings) -> Table:
    # The verdict second, so that a phone shows it without scrolling.
    columns = ["geometry", "intervals", "farthest", "z", "misfit"]
    rows = []
    for plan in plans:
        about = Cell(counted(plan.shots, "measurement"), span=len(columns) - 1)
        rows.append(row_of(plan_title(plan.name), about))
        for estimator in plan.estimators:
            verdict, worst = standing_cell(estimator), worst_cell(estimator, settings.level)
            misfit = f"{estimator.misfit} of {estimator.converged}"
            rows.append(row_of(estimator.name, verdict, worst, z_range(estimator), misfit, tone=verdict.mark))
    caption = (
        "Share of intervals that hold the truth, in %: the parameter farthest from"
        f" {percent(settings.level)}; errors in standard uncertainties; answers that say misfit"
    )
    return table_of(caption, columns, rows, "llr")


def z_range(estimator: GeometryEstimator) -> str:
    """Smallest to largest root mean square of errors in standard uncertainties."""
    zs = [row.z for row in estimator.parameters if row.z is not None]
    if not zs:
        return NOT_DETERMINED
    return f"{numbers.significant(min(zs))} to {numbers.significant(max(zs))}"


def _predicted(plans: Sequence[GeometryPlan]) -> Table:
    columns = ["plan", "tolerances", "noise only", "considered", "freed"]
    rows = []
    for plan in plans:
        ranges = [u_range(plan.checked, kind) for kind, _, _ in _KINDS]
        rows.append(row_of(clipped(plan.name, LONGEST_NAME), tolerances(plan.tolerance), *ranges))
    return table_of("Predicted u of the offsets, smallest to largest", columns, rows, "llr")


def tolerances(level: ToleranceLevel) -> str:
    """Both tolerances in words."""
    return f"{numbers.exact(level.length_mm, 'mm')}, {numbers.exact(level.angle_deg, 'deg')}"


def u_range(rows: Sequence[CheckedOffset], kind: str) -> str:
    """Smallest to largest u of the offsets that the plan determines; words for the others."""
    values = [getattr(row, kind) for row in rows]
    known = [value for value in values if value is not None]
    if not known:
        return NOT_DETERMINED
    unit = rows[0].unit if len({row.unit for row in rows}) == 1 else ""
    text = f"{spread(min(known))} to {spread(max(known), unit)}"
    return text if len(known) == len(values) else f"{text}; {len(values) - len(known)} {NOT_DETERMINED}"


def _plan(plan: GeometryPlan, settings: GeometrySettings) -> list[Section]:
    facts = [
        ("Plan", plan_in_words(plan.words, plan.shots, noise_in_words(plan.noise), plan.robot)),
        ("Tolerances", tolerances(plan.tolerance)),
        ("Arms", str(plan.arms)),
        ("Targets not hit", unmet_in_words(plan.failed)),
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
    columns = ["parameter", f"within {percent(level)}", "z", *ERROR_COLUMNS, "u by check"]
    width = len(columns) - 1
    rows = [row for part in plan.estimators for row in rows_of(part, part.words, width, _cells)]
    caption = (
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval (Clopper and Pearson);"
        " errors in standard uncertainties; bias and root mean square error, next to what was stated, and u"
        " by check"
    )
    return table_of(caption, columns, rows)


def _cells(row: GeometryParameter, control: bool) -> list[str | Cell] | None:
    cells = share_and_errors(row, control)
    if cells is None:
        return None
    within, *errors = cells
    return [within, z_text(row), *errors, spread(row.checked_std, row.unit)]


def z_text(row: GeometryParameter) -> str:
    """z with its 95 % interval."""
    if row.z is None or row.z_low is None or row.z_high is None:
        return NOT_GIVEN
    digits = numbers.decimals((row.z_high - row.z_low) / 4)
    low, high = numbers.fixed(row.z_low, digits), numbers.fixed(row.z_high, digits)
    return f"{numbers.fixed(row.z, digits)} ({low} to {high})"


def geometry_pictures(answer: GeometryStudy) -> list[Picture | None]:
    plans, level = answer.plans, answer.settings.level
    parts = [replace(one, name=plan.name) for plan in plans for one in plan.estimators if one.name == "freed"]
    counts = [row.coverage.of for part in parts for row in part.parameters if row.coverage is not None]
    title = f"How often the {percent(level)} intervals hold the truth, with the geometry estimated"
    shares = coverage_picture(parts, [level], min(counts, default=1), "coverage", title) if parts else None
    return [uncertainty_picture(plans), z_picture(plans), shares]


# ── u of the offsets by the number of measurements ────────────────────────────────────────────


def uncertainty_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """Bands from the smallest u of an offset to the largest over the numbers of measurements.

    Of the plans for nominal geometry that have the tolerances of the first; a dashed line is the largest of
    those chosen for free geometry.

    None where fewer than two numbers of measurements can be compared.
    """
    chosen = [plan for plan in plans if plan.chosen_for == "nominal"]
    chosen = [plan for plan in chosen if plan.tolerance == chosen[0].tolerance and _all_known(plan)]
    if len(chosen) < 2:
        return None
    better = [plan for plan in plans if plan.chosen_for == "freed" and plan.tolerance == chosen[0].tolerance]
    better = [plan for plan in better if _all_known(plan)]
    with style():
        figure = new_figure(2.9)
        axes = figure.subplots()
        axes.set_xscale("log")
        axes.set_yscale("log")
        shots = [plan.shots for plan in chosen]
        for kind, words, role in _KINDS:
            ends = [_ends(plan, kind) for plan in chosen]
            low, high = [end[0] for end in ends], [end[1] for end in ends]
            axes.fill_between(shots, low, high, color=light(role), alpha=0.22, linewidth=0)
            axes.plot(shots, high, "o-", markersize=3.5, linewidth=1.3, color=light(role), label=words)
        if len(better) > 1:
            largest = [_ends(plan, "freed")[1] for plan in better]
            axes.plot(
                [plan.shots for plan in better],
                largest,
                "o--",
                markersize=3.5,
                linewidth=1.2,
                color=light("identified"),
                markerfacecolor=light("ground"),
                label="the same, plan chosen for it",
            )
        axes.set_xticks(shots, [str(count) for count in shots])
        axes.minorticks_off()
        bottom, top = axes.get_ylim()
        steps = [factor * 10.0**power for power in range(-5, 3) for factor in (1, 2, 5)]
        axes.set_yticks([step for step in steps if bottom <= step <= top])
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel("measurements")
        axes.set_ylabel("u of the offsets, °")
        figure.legend(loc="outside upper left", ncols=2)
        svg = to_svg(figure, "uncertainty")
    title = (
        "Predicted u of the offsets by the number of measurements: from the smallest (band) to the largest"
    )
    return Picture("uncertainty", title, _uncertainty_alt(chosen), svg)


def _all_known(plan: GeometryPlan) -> bool:
    return bool(plan.checked) and all(
        getattr(row, kind) is not None and row.unit == "deg" for row in plan.checked for kind, _, _ in _KINDS
    )


def _ends(plan: GeometryPlan, kind: str) -> tuple[float, float]:
    values = [getattr(row, kind) for row in plan.checked]
    return min(values), max(values)


def _uncertainty_alt(plans: Sequence[GeometryPlan]) -> str:
    parts = []
    for plan in plans:
        ranges = []
        for kind, words, _ in _KINDS:
            low, high = _ends(plan, kind)
            ranges.append(f"{words} {numbers.spread(low)} to {numbers.spread(high, 'deg')}")
        parts.append(f"{plan.shots} measurements: {', '.join(ranges)}")
    return f"Smallest to largest u of the offsets. {'; '.join(parts)}."


# ── errors in standard uncertainties ──────────────────────────────────────────────────────────


def z_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """A row for each estimator of each plan, a dot for each offset; logarithmic, with a line at 1.

    None where there is nothing to draw.
    """
    rows = [(plan, estimator) for plan in plans for estimator in (None, *plan.estimators)]
    if not any(row.z for _, one in rows if one is not None for row in one.parameters):
        return None
    height = min(_TALLEST, 0.6 + _ROW * len(rows))
    size = min(8.0, 0.86 * 72 * (height - 0.6) / len(rows))
    with style():
        figure = new_figure(height)
        axes = figure.subplots()
        axes.set_xscale("log")
        for y, (plan, estimator) in enumerate(rows):
            if estimator is None:
                head_rows(axes, y + 0.1, f"Plan {clipped(plan.name, 36)}", size, pad=0.6)
                continue
            zs = [row.z for row in estimator.parameters if row.z]
            if not zs:
                hatched(axes, y, NOT_DETERMINED, size=size - 0.5)
                continue
            role = "identified" if estimator.agrees else "held" if estimator.control else "weak"
            colour = light(role)
            fill = light("ground") if estimator.control else colour
            axes.plot([min(zs), max(zs)], [y, y], "-", linewidth=0.8, color=colour)
            axes.plot(zs, [y] * len(zs), "o", markersize=3.2, color=colour, markerfacecolor=fill)
        axes.axvline(1.0, color=light("ink"), linewidth=0.9, zorder=0.6)
        axes.set_ylim(len(rows) - 0.4, -0.7)
        name_rows(axes, [(y, one.name) for y, (_, one) in enumerate(rows) if one is not None], size)
        bare_y(axes)
        axes.minorticks_off()
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        low, high = axes.get_xlim()
        ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if low <= tick <= high]
        axes.set_xticks(ticks)
        axes.set_xlabel("root mean square of the errors, in standard uncertainties")
        svg = to_svg(figure, "z")
    title = "Errors of the offsets in their standard uncertainties, a dot for each offset; line: u is right"
    return Picture("z", title, _z_alt(plans), svg)


def _z_alt(plans: Sequence[GeometryPlan]) -> str:
    parts = []
    for plan in plans:
        texts = []
        for estimator in plan.estimators:
            offsets = [
                f"{label(row.name)} {numbers.significant(row.z) if row.z else NOT_DETERMINED}"
                for row in estimator.parameters
            ]
            texts.append(f"{estimator.name} ({standing(estimator)[1]}): {', '.join(offsets)}")
        parts.append(f"plan {clipped(plan.name, 40)}: {'; '.join(texts)}")
    return f"Root mean square of the errors in standard uncertainties. {'. '.join(parts)}."


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def parameter_rows(answer: GeometryStudy) -> Iterator[PlainRow]:
    """One row for each plan, estimator and parameter; nothing but names where it is not determined."""
    for plan in answer.plans:
        for estimator in plan.estimators:
            for row in estimator.parameters:
                more = ("z", "z_low", "z_high", "checked_std")
                names = {"plan": plan.name, "geometry": estimator.name}
                yield parameter_columns(estimator, row, answer.settings.level, *more, **names)


def plan_rows(answer: GeometryStudy) -> Iterator[PlainRow]:
    """One row for each plan and offset: what `check` predicts."""
    for plan in answer.plans:
        for row in plan.checked:
            yield {
                "plan": plan.name,
                **columns_of(plan, "chosen_for", "robot", "shots", "arms", "failed", "efficiency"),
                **columns_of(plan.tolerance, "length_mm", "angle_deg"),
                **columns_of(plan.noise, "joint_deg", "spot_mm"),
                "parameter": row.name,
                "unit": row.unit,
                **columns_of(row, "noise_only", "considered", "freed"),
            }
