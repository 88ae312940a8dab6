"""Do repeated runs agree? Their scatter against what each run predicts, drift, and the one that is odd."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...model.robot import Matrix
from ...reports.words.wording import listed
from ..status import versions
from .consistency import LEVEL, Sample, against_others, consistency, holm, mean_of, of_a_std, one_offset
from .repeats import Kind, Progress, Repeat, read_repeats, times

Json = dict[str, Any]

SCHEMA = "zerobeam/compare/1"
CHANCE = 0.01  # of a false alarm over all questions together


def compare(paths: Sequence[Path], *, seed: int = 0, progress: Progress | None = None) -> Json:
    """The answer (`zerobeam/compare/1`, see docs/compare.md) on repeated runs: two run files or results at
    least, or one table of published offsets.

    Raises BadInput for files that cannot be used or runs that cannot be compared. A run whose fit did not
    converge is named under `failed` and has no numbers.
    """
    kind, repeats = read_repeats(paths, seed, progress or (lambda stage, share: None))
    return compared(kind, repeats, seed)


def compared(kind: Kind, repeats: Sequence[Repeat], seed: int) -> Json:
    """The same of runs that have been read."""
    repeats, at, by_time = _in_order(repeats)
    used = [r for r, repeat in enumerate(repeats) if repeat.failure is None]
    sample = _sample([repeats[r] for r in used], at[used], len(repeats[0].names))
    whole = consistency(sample)
    offsets = [
        {"name": name, "unit": unit, **one_offset(sample.offset(i))}
        for i, (name, unit) in enumerate(zip(repeats[0].names, repeats[0].units, strict=True))
    ]
    odd = dict(zip(used, (against_others(sample, k) for k in range(len(used))), strict=True))
    chances = {
        "consistency": [whole] if whole else [],
        "offsets": holm([row for row in offsets if row["p_value"] is not None]),
        "odd": holm([own for own in odd.values() if own]),
        "drift": holm([row["drift"] for row in offsets if row["drift"]]),
    }
    asked = [question for question, rows in chances.items() if rows]
    bound = CHANCE / max(len(asked), 1)
    found = {question: [row for row in chances[question] if row["p_holm"] < bound] for question in asked}
    verdict = "not tested"
    if any(found.values()):
        verdict = "does not agree"
    elif whole or chances["offsets"]:
        verdict = "agrees"
    for i, row in enumerate(offsets):
        row.update(mean_of(sample, i, verdict == "agrees"))
    answer: Json = {
        "schema": SCHEMA,
        "kind": kind,
        "verdict": verdict,
        "headline": "",
        "odd_run": None,
        "differing": [row["name"] for row in offsets if row in found.get("offsets", [])],
        "drifting": [row["name"] for row in offsets if row["drift"] in found.get("drift", [])],
        "consistency": whole,
        "offsets": offsets,
        "runs": [
            _run(repeat, float(at[r]), _factor(repeats), odd.get(r)) for r, repeat in enumerate(repeats)
        ],
        "held": list(repeats[0].held),
        "failed": [repeat.name for repeat in repeats if repeat.failure is not None],
        "settings": {
            "seed": seed,
            "level": LEVEL,
            "chance": CHANCE,
            "asked": asked,
            "order": "time" if by_time else "given",
            "at_unit": "h" if by_time else "run",
        },
        "versions": versions(),
    }
    if found.get("odd"):
        # Where the others disagree without it as well, no one run is to blame.
        worst = min((own["p_value"], r) for r, own in odd.items() if own)[1]
        rest = consistency(sample.without(used.index(worst)))
        if rest is None or rest["p_value"] >= bound:
            answer["odd_run"] = repeats[worst].name
    answer["headline"] = _headline(answer)
    answer["notes"] = list(_notes(answer, repeats))
    return answer


def _in_order(repeats: Sequence[Repeat]) -> tuple[Sequence[Repeat], Matrix, bool]:
    """The runs by time, hours from the first and True; or as they were given, numbers from 1 and False."""
    made = times(repeats)
    if made is None:
        return repeats, np.arange(1.0, len(repeats) + 1), False
    order = sorted(range(len(repeats)), key=lambda r: made[r])
    hours = [(made[r] - made[order[0]]).total_seconds() / 3600 for r in order]
    return [repeats[r] for r in order], np.array(hours), True


def _factor(repeats: Sequence[Repeat]) -> float:
    """The noise over the stated one that all runs tell together (its square is averaged by their spare
    numbers); 1 where the noise is known."""
    estimated = [repeat for repeat in repeats if repeat.noise_dof is not None and repeat.failure is None]
    if not estimated:
        return 1.0
    dof = [repeat.noise_dof or 0 for repeat in estimated]
    return float(np.sqrt(np.average([repeat.noise_scale**2 for repeat in estimated], weights=dof)))


def _sample(repeats: Sequence[Repeat], at: Matrix, size: int) -> Sample:
    """Of all offsets; one that fewer than two runs tell is compared in none."""
    values = np.array([repeat.value for repeat in repeats]).reshape(-1, size)
    values[:, np.isfinite(values).sum(axis=0) < 2] = np.nan
    known = [repeat.covariance for repeat in repeats if repeat.covariance is not None]
    covariances = np.array(known) * _factor(repeats) ** 2 if len(known) >= 2 else None
    if any(map(_lost, repeats)):
        # Then the misses are far from linear, and what is predicted of the others varies from run to run.
        covariances = None
    dof = [repeat.noise_dof for repeat in repeats if repeat.noise_dof is not None]
    joint = all(repeat.joint for repeat in repeats)
    return Sample(values, covariances, joint, sum(dof) if dof else None, at)


def _lost(repeat: Repeat) -> list[str]:
    """The free offsets that a run does not determine."""
    named = zip(repeat.names, repeat.status, strict=True)
    return [name for name, status in named if status == "unidentifiable" and repeat.failure is None]


def _run(repeat: Repeat, at: float, factor: float, odd: Json | None) -> Json:
    std = np.full(len(repeat.names), np.nan)
    if repeat.covariance is not None:
        std = factor * np.sqrt(np.diag(repeat.covariance))
    rows = zip(repeat.names, repeat.units, repeat.status, repeat.value.tolist(), std.tolist(), strict=True)
    return {
        "name": repeat.name,
        "sha256": repeat.sha256,
        "robot": repeat.robot,
        "shots": repeat.shots,
        "when": repeat.when,
        "at": at,
        "failure": repeat.failure,
        "odd": odd,
        "offsets": [
            {
                "name": name,
                "unit": unit,
                "status": status,
                "estimate": value if np.isfinite(value) else None,
                "std": own if np.isfinite(value + own) else None,
            }
            for name, unit, status, value, own in rows
        ],
    }


# ── in words ──────────────────────────────────────────────────────────────────────────────────


def _headline(answer: Json) -> str:
    runs, whole, verdict = answer["runs"], answer["consistency"], answer["verdict"]
    used = len(runs) - len(answer["failed"])
    if used < 2 or not any(row["runs"] for row in answer["offsets"]):
        return "There are no two runs that tell the same offset: nothing is compared."
    if verdict == "not tested":
        return (
            f"How far the {used} runs scatter is told, but not whether they agree: there is no uncertainty to"
            " rely on that the scatter could be compared with."
        )
    said = []
    if whole:
        said.append(
            f"the {used} runs scatter {whole['ratio']:.2g} times as much as predicted"
            f" (p = {whole['p_value']:.1g})"
        )
    elif verdict == "agrees":
        said.append(f"each offset of the {used} runs scatters as predicted")
    if answer["odd_run"] is not None:
        said.append(f"{answer['odd_run']} is the odd one{', the others agree without it' if whole else ''}")
    for names, verb, how in (
        (answer["differing"], "scatter", " more than predicted"),
        (answer["drifting"], "drift", ""),
    ):
        if names:
            said.append(f"{listed(names)} {verb}{'s' if len(names) == 1 else ''}{how}")
    if not said:
        said.append("a run is odd, but which one cannot be told")
    told = "; ".join(said)
    return f"{told[0].upper()}{told[1:]}."


def _notes(answer: Json, repeats: Sequence[Repeat]) -> Iterator[str]:
    for repeat in repeats:
        if repeat.failure is not None:
            yield f"{repeat.name} is not compared: {repeat.failure}"
        if lost := _lost(repeat):
            yield (
                f"{repeat.name} does not determine {listed(lost)}: then what it predicts of its other offsets"
                " cannot be relied on either, and the runs are compared by their scatter alone. Leave it out"
                " to test the others"
            )
        yield from (f"{repeat.name}: {sentence}" for sentence in repeat.sentences)
    rows, whole = answer["offsets"], answer["consistency"]
    if apart := [row["name"] for row in rows if not row["runs"]]:
        yield f"Not compared: {listed(apart)}. It takes two runs that tell an offset"
    if weak := sorted(
        {own["name"] for run in answer["runs"] for own in run["offsets"] if own["status"] == "weak"}
    ):
        yield (
            f"Weakly told in a run or more: {listed(weak)}. What its prior adds to an estimate is taken out"
            " again, to first order"
        )
    if whole and whole["ratio_interval95"][1] < 1:
        yield (
            f"The runs scatter less than predicted ({whole['ratio']:.2g} times): the noise may be overstated,"
            " or part of it is the same in all runs"
        )
    drifts = [row for row in rows if row["drift"] and row["drift"]["p_holm"] < 1 - LEVEL]
    if drifts and not answer["drifting"]:
        row = min(drifts, key=lambda row: float(row["drift"]["p_value"]))
        yield (
            f"A hint, no more: {row['name']} changes by {row['drift']['slope']:.2g} {row['unit']} a"
            f" {'run' if answer['settings']['at_unit'] == 'run' else 'hour'}, nearly in line"
            f" (p = {row['drift']['p_holm']:.2g} among all offsets)"
        )
    if answer["kind"] == "table":
        yield from _on_a_table(rows)
    if answer["kind"] == "results":
        yield (
            "Result files hold no covariance between offsets: each offset is tested on its own, and their"
            " p-values are corrected for their number (Holm). Run files are tested as a whole"
        )
    if any(repeat.noise_dof is not None for repeat in repeats):
        yield (
            "The noise is estimated: one factor on the stated noise is taken for all runs together, and the"
            " tests are F instead of chi-squared"
        )
    if len(repeats) - len(answer["failed"]) == 2:
        yield "Two runs cannot show a drift, nor which of them is the odd one: a third would"
    yield (
        "What is the same in all runs does not show in their scatter: errors of the arm's geometry, play that"
        " is always taken up from one side, a laser that is mounted askew"
    )


def _on_a_table(rows: list[Json]) -> Iterator[str]:
    count = max(row["runs"] for row in rows)
    if count >= 2:
        low, high = of_a_std(count - 1)
        yield (
            f"{count} runs tell a standard deviation only to between {low:.2g} and {high:.2g} times the one"
            " that they show"
        )
    yield (
        "Which noise would make runs scatter so depends on their postures, which a table does not tell: give"
        " run files, or see zerobeam study table2, which asks that of the paper's Table 2"
    )
