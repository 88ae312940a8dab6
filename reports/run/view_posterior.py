"""The posterior: whether it converged, and what it says."""

from __future__ import annotations

from typing import Any

from ..style.blocks import Cell, Facts, Table, row_of, table_of
from ..words import numbers
from ..words.wording import counted, label, sentence
from .view_parameters import unit_of

Json = dict[str, Any]


def posterior_part(result: Json) -> Json:
    posterior = result["posterior"]
    facts = [
        ("Draws", str(posterior["draws"])),
        ("Ensembles", f"{posterior['ensembles']} of {counted(posterior['walkers'], 'walker')}"),
        ("Smallest effective sample size", numbers.or_words(posterior["ess_min"], "not available")),
        ("Largest rank-normalised R-hat", _ratio(posterior["rhat_max"])),
        ("Acceptance", numbers.or_words(posterior["acceptance"], "not available", "")),
        ("Time", f"{numbers.significant(posterior['seconds'], 2)}\u00a0s"),
    ]
    said = sentence(posterior["message"])
    if not posterior["converged"]:
        said = f"The posterior has not converged and is not shown. {said}"
    return {
        "converged": posterior["converged"],
        "sentence": said,
        "facts": Facts(facts),
        "table": _posterior_table(result),
    }


def _posterior_table(result: Json) -> Table | None:
    posterior = result["posterior"]
    if not posterior["converged"] or posterior["parameters"] is None:
        return None
    noise = any(row["group"] == "noise" for row in result["parameters"])
    untold = {row["name"] for row in result["parameters"] if row["status"] == "unidentifiable"}
    targets = {row["name"] for row in result["parameters"] if row["group"] == "target"}
    columns = [
        ("name", "left"),
        ("mean", "right"),
        ("std", "right"),
        ("2.5 % to 97.5 %", "right"),
        ("ESS bulk, tail", "right"),
        ("R-hat", "right"),
    ]
    rows = []
    for row in posterior["parameters"]:
        if row["name"] in targets:
            continue
        if row["source"] == "prior" or row["name"] in untold:
            told = "drawn from the prior: the data have no say"
            rows.append(row_of(label(row["name"]), Cell(told, span=5), tone="unidentifiable"))
            continue
        std, unit = row["std"], unit_of(row)
        rows.append(
            row_of(
                label(row["name"]),
                numbers.estimate(row["mean"], std, unit),
                numbers.spread(std, unit),
                numbers.interval((row["q2_5"], row["q97_5"]), std, unit),
                f"{row['ess_bulk']:.0f}, {row['ess_tail']:.0f}",
                _ratio(row["rhat"]),
            )
        )
    caption = f"Posterior of offsets{', tool and noise' if noise else ' and tool'}"
    return table_of(caption, columns, rows) if rows else None


def _ratio(rhat: float | None) -> str:
    return "not available" if rhat is None else numbers.fixed(rhat, 3)
