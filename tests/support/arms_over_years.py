"""Arms with results over years, made of one real result: known walks and jumps, misfits, offsets lost."""

import copy
import tempfile
from collections.abc import Collection, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from histories import a_result, write_result

from zerobeam.analysis.answer.answer_message import Action, Message
from zerobeam.analysis.covariance import OffsetsWithoutPrior
from zerobeam.experiments.history.arm_history import ArmHistory, arm_drift
from zerobeam.experiments.history.stored_result import Event, StoredResult, read_entry

FIRST = datetime(2023, 1, 15)
LOST = "delta3"


def base(demo: str = "good", **provenance: object) -> StoredResult:
    """A real result as a history gives it back."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_result(Path(folder) / "one.json", a_result(demo=demo, **provenance))
        own = read_entry(path, lambda sha256: None)
    assert own is not None
    names = [name for name in StoredResult.__dataclass_fields__ if name != "document_sha256"]
    return StoredResult(**{name: getattr(own, name) for name in names}, document_sha256=own.document_sha256)


def over_years(
    count: int,
    *,
    serial: str = "A-1",
    model: str = "irb1600",
    every: timedelta = timedelta(days=91),
    walk: float = 0.0,
    jump: tuple[int, int, float] | None = None,
    misfits: Collection[int] = (),
    lost: Collection[int] = (),
    demo: str = "good",
    **provenance: object,
) -> tuple[StoredResult, ...]:
    """So many results of an arm. `jump` is the result before which an offset, by its place, changes by so
    much; results `lost` do not determine `LOST`."""
    one = base(demo, **provenance)
    random, made = np.random.default_rng(4), []
    state = np.zeros(len(one.without_prior.names) if one.without_prior else 0)
    for t in range(count):
        alone, offsets, verdict = copy.deepcopy(one.without_prior), copy.deepcopy(one.offsets), one.verdict
        if alone is not None:
            values = random.multivariate_normal(np.add(alone.values, state), alone.covariance)
            if jump is not None and t >= jump[0]:
                values[jump[1]] += jump[2]
            alone = replace(alone, values=values.tolist())
            state = state + walk * random.normal(size=len(state))
            if t in lost:
                alone = without_offset(alone, LOST)
                unknown: Any = {"status": "unidentifiable", "estimate": None, "std": None, "interval95": None}
                offsets = [replace(row, **unknown) if row.name == LOST else row for row in offsets]
                verdict = "degenerate"
        if t in misfits:
            verdict = "misfit"
        made.append(
            replace(
                one,
                serial=serial,
                model=model,
                sha256=f"{t:064x}",
                measured_at=FIRST + t * every,
                verdict=verdict,
                offsets=offsets,
                without_prior=alone,
            )
        )
    return tuple(made)


def without_offset(alone: OffsetsWithoutPrior, lost: str) -> OffsetsWithoutPrior:
    """The same of a result that does not determine one of the offsets."""
    kept = [i for i, name in enumerate(alone.names) if name != lost]
    return replace(
        alone,
        names=[alone.names[i] for i in kept],
        units=[alone.units[i] for i in kept],
        values=[alone.values[i] for i in kept],
        covariance=[[alone.covariance[i][j] for j in kept] for i in kept],
        by_geometry=[alone.by_geometry[i] for i in kept],
    )


def arm_history(
    results: Sequence[StoredResult],
    events: Sequence[Event] = (),
    *,
    arm: tuple[str, str] = ("A-1", "irb1600"),
    tolerance_mm: float = 0.5,
    as_of: datetime | None = None,
) -> ArmHistory:
    """What its page is made of."""
    if results:
        arm = (results[0].serial, results[0].model)
    when = as_of or (results[-1].measured_at if results else None)
    drift, passed = (
        arm_drift(arm, results, events, tolerance_mm),
        Message("Pass", None, None, Action("", None), (), grade="pass"),
    )
    judged = tuple(passed if one.verdict == "pass" else None for one in results)
    return ArmHistory(arm=drift, results=tuple(results), judged=judged, events=tuple(events), asked=when)


def happened(what: Any, when: datetime, note: str = "", serial: str = "A-1") -> Event:
    """An event of an arm."""
    return Event(serial, "irb1600", when, what, note)
