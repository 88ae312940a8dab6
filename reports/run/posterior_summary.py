"""The posterior: whether it converged, and what it says."""

from __future__ import annotations

from ...analysis.result import Result
from ..style.blocks import Cell, Facts, FigureBlock, Paragraph, Section, Table, row_of, section_of, table_of
from ..words import numbers
from ..words.findings import posterior_message
from ..words.wording import counted, ended, label, sentence
from .parameters import unit_of


def posterior_section(result: Result) -> Section:
    """The section of a report."""
    posterior = result.posterior
    facts = [
        ("Draws", str(posterior.draws)),
        ("Ensembles", f"{posterior.ensembles} of {counted(posterior.walkers, 'walker')}"),
        ("Smallest effective sample size", numbers.or_words(posterior.ess_min, "not available")),
        ("Largest rank-normalised R-hat", _ratio(posterior.rhat_max)),
        ("Acceptance", numbers.or_words(posterior.acceptance, "not available", "")),
        ("Time", f"{numbers.significant(posterior.seconds, 2)}\u00a0s"),
    ]
    return section_of(
        "Posterior",
        Paragraph(ended(posterior_sentence(result))),
        FigureBlock("posterior"),
        _table(result),
        Facts(facts),
    )


def posterior_sentence(result: Result) -> str:
    """How the sampling went."""
    said = sentence(posterior_message(result.posterior))
    return said if result.posterior.converged else f"No posterior is shown: {said}"


def _table(result: Result) -> Table | None:
    if result.posterior.parameters is None:
        return None
    noise = any(row.group == "noise" for row in result.parameters)
    targets = {row.name for row in result.parameters if row.group == "target"}
    columns = [
        ("name", "left"),
        ("mean", "right"),
        ("std", "right"),
        ("2.5 % to 97.5 %", "right"),
        ("ESS bulk, tail", "right"),
        ("R-hat", "right"),
    ]
    rows = []
    for row in result.posterior.parameters:
        if row.name in targets:
            continue
        if row.source == "prior":
            rows.append(row_of(label(row.name), Cell("prior only", span=5), tone="unidentifiable"))
            continue
        std, unit = row.std, unit_of(row.unit)
        rows.append(
            row_of(
                label(row.name),
                numbers.estimate(row.mean, std, unit),
                numbers.spread(std, unit),
                numbers.interval((row.q2_5, row.q97_5), std, unit),
                f"{row.ess_bulk:.0f}, {row.ess_tail:.0f}",
                _ratio(row.rhat),
            )
        )
    caption = f"Posterior of offsets{', tool and noise' if noise else ' and tool'}"
    return table_of(caption, columns, rows) if rows else None


def _ratio(rhat: float | None) -> str:
    return "not available" if rhat is None else numbers.fixed(rhat, 3)
