"""Second opinions: the robust fit, held-out targets, the intervals by three methods."""

from __future__ import annotations

from ....analysis.answer.findings import HeldOutMisfit
from ....analysis.answer.result import Result
from ....analysis.diagnostics.hold_out import HoldOut
from ....analysis.diagnostics.outliers import Robust
from ....analysis.posterior.intervals import Intervals
from ....words import numbers
from ....words.findings import hold_out_message
from ....words.wording import NOT_DETERMINED, clipped, label, listed, sentence
from ...style.blocks import Cell, Facts, Paragraph, Section, Table, row_of, section_of, table_of
from ..parameters import noise_factors, unit_of


def robust_section(result: Result) -> Section | None:
    """The robust fit next to the likelihood fit; None where it was not asked for."""
    robust = result.robust
    if robust is None:
        return None
    table = _robust_table(result, robust) if robust.converged else None
    return section_of("Robust fit", Paragraph(robust_sentence(result, robust)), table)


def robust_sentence(result: Result, robust: Robust) -> str:
    """What the robust fit is and found."""
    if not robust.converged:
        return f"The robust fit did not converge ({sentence(robust.reason)}) and is not shown."
    if robust.loss == "huber":
        threshold = numbers.significant(robust.tuning)
        said = [f"Huber’s loss: a normalised residual beyond {threshold} weighs less, the larger the less."]
    else:
        nu = numbers.exact(robust.tuning)
        said = [f"Student’s loss with {nu} degrees of freedom: the larger a residual, the less it weighs."]
    said.append("A measurement of weight 1 counts as in the likelihood fit.")
    said.append(_outliers(result, robust))
    if robust.noise_scale is not None:
        said.append(f"The noise is {numbers.significant(robust.noise_scale)} times the stated.")
    if robust.with_uncertainty:
        said.append("Its intervals follow from the residuals as they are, not from the stated noise.")
    else:
        said.append(
            "It has no uncertainty: a measurement has leverage 1, or there are no more numbers than unknowns."
        )
    return " ".join(said)


def _outliers(result: Result, robust: Robust) -> str:
    if not robust.outliers:
        return "No outlier."
    weights = {shot.shot: weight for shot, weight in zip(result.shots, robust.weights, strict=True)}
    named = [f"{number} (weight {numbers.fixed(weights[number], 2)})" for number in robust.outliers]
    return f"Outlier{'' if len(named) == 1 else 's'}: {listed(named)}."


def _robust_table(result: Result, robust: Robust) -> Table:
    columns = [
        ("name", "left"),
        ("likelihood", "right"),
        ("robust", "right"),
        ("its 95 % interval", "right"),
        ("difference over u", "right"),
    ]
    rows = []
    for row in robust.parameters:
        own, unit = result.parameters.named(row.name), unit_of(row.unit)
        if own.group in ("target", "geometry"):
            continue
        name = label(row.name)
        if own.estimate is None or own.std is None or row.estimate is None:
            rows.append(row_of(name, Cell(NOT_DETERMINED, span=4), tone="unidentifiable"))
            continue
        std = row.std or own.std
        rows.append(
            row_of(
                name,
                numbers.estimate(own.estimate, own.std, unit),
                numbers.estimate(row.estimate, std, unit),
                "none" if row.interval95 is None else numbers.interval(row.interval95, std, unit),
                numbers.significant((row.estimate - own.estimate) / own.std, 2),
            )
        )
    return table_of("Offsets and tool by both fits", columns, rows)


def hold_out_section(result: Result) -> Section | None:
    """How the fit does at targets that it has not seen; None where none was held out."""
    held_out = result.hold_out
    if held_out is None:
        return None
    names = [clipped(name, 24) for name in held_out.targets]
    missing = "not available"
    rows = [
        ("Placements", listed([clipped(name, 24) for name in held_out.placements])),
        ("Targets", f"{len(names)}: {listed(names)}"),
        ("Measurements there", str(held_out.shots)),
        ("Measurements of the fit", str(held_out.shots_fitted)),
        ("Residuals without offsets, rms", numbers.or_words(held_out.rms_before_mm, missing, "mm")),
        ("Residuals with them, rms", numbers.or_words(held_out.rms_mm, missing, "mm")),
        ("Residuals expected from noise and fit", numbers.or_words(held_out.expected_mm, missing, "mm")),
        ("χ²", numbers.or_words(held_out.chi2, missing)),
        ("Degrees of freedom", missing if held_out.dof is None else str(held_out.dof)),
        ("p-value", missing if held_out.p_value is None else numbers.p_value(held_out.p_value)),
    ]
    said = (
        "Offsets and tool are fitted without these placements, each taken whole. Then only the position of"
        " each target is fitted, to its own measurements; what is left of the residuals shows whether"
        " the offsets hold there."
    )
    return section_of(
        "Held-out targets",
        Paragraph(said),
        *map(Paragraph, hold_out_sentences(result, held_out)),
        Facts(rows),
    )


def hold_out_sentences(result: Result, held_out: HoldOut) -> list[str]:
    """How it went."""
    said = []
    misfit = next((finding for finding in result.findings if isinstance(finding, HeldOutMisfit)), None)
    if misfit is not None:
        said.append(
            f"The residuals are {numbers.significant(misfit.factor, 2)} times what noise and fit explain: the"
            " offsets do not carry over to these targets as stated."
        )
    elif held_out.p_value is not None:
        said.append("The residuals agree with noise and fit: they do not contradict the offsets.")
    if (message := hold_out_message(held_out)) is not None:
        said.append(f"No judgement: {sentence(message)}.")
    return said


def intervals_section(result: Result) -> Section | None:
    """The intervals by three methods, where they differ or a parameter is weak; None where there is none
    such."""
    if not _of_people(result):
        return None
    table, said = intervals_table(result)
    return section_of("Intervals by three methods", Paragraph(said), table)


def _of_people(result: Result) -> list[Intervals]:
    """All but those of the geometry, whose section has them; `result.json` has all."""
    return [row for row in result.intervals if result.parameters.named(row.name).group != "geometry"]


def intervals_table(result: Result) -> tuple[Table, str]:
    """The intervals, and what they say together."""

    def ends(name: str, unit: str, interval: tuple[float, float] | None, missing: str) -> str:
        std = result.parameters.named(name).std
        return missing if interval is None or std is None else numbers.interval(interval, std, unit_of(unit))

    # The fit is at the marginal mode of noise factors, where no profile starts.
    chosen = _of_people(result)
    no_profile = "not defined" if noise_factors(result.parameters) else "no end found"
    columns = [("name", "left"), ("curvature", "right"), ("profile", "right"), ("posterior", "right")]
    rows = [
        row_of(
            label(row.name),
            ends(row.name, row.unit, row.linear, ""),
            ends(row.name, row.unit, row.profile, no_profile),
            ends(row.name, row.unit, row.posterior, "not sampled"),
        )
        for row in chosen
    ]
    said = (
        "By the curvature at the estimate, by the profile likelihood and by the quantiles of the posterior’s"
        " draws."
    )
    if differing := [label(row.name) for row in chosen if row.differ]:
        said += (
            f" They differ by a tenth of their width or more for {listed(differing)}: do not rely on one"
            " alone there, the widest is the safe one."
        )
    else:
        said += " They agree."
    return table_of("95 % intervals by three methods", columns, rows), said
