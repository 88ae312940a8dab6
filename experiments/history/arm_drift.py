"""The drift of an arm by its results in a history: which of them count, jumps and events, the due date."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np

from ...analysis.drift.drift import Drift, Jump, Undecided, drift
from ...analysis.drift.forecast import HORIZON_YEARS, due_after
from ...analysis.drift.instruments import change_at
from ...analysis.drift.smoother import Observation, series_of
from .store import Event, StoredResult

YEAR = timedelta(days=365.25)
NOT_SOON = f"not within {HORIZON_YEARS:g} years"


@dataclass(frozen=True)
class LeftOut:
    """A result that does not count, and why."""

    result: StoredResult
    reason: str


@dataclass(frozen=True)
class DatedJump:
    """A jump between two results, the events that were logged in between, and the instruments before and
    after (of the nearest results that determine the offset) where these differ: a bias looks like a jump."""

    jump: Jump
    after: datetime
    before: datetime
    events: tuple[Event, ...]
    instruments: tuple[str, str] | None


@dataclass(frozen=True)
class DatedChange:
    """A change that may be a jump or drift; the other fields as those of `DatedJump`."""

    change: Undecided
    after: datetime
    before: datetime
    events: tuple[Event, ...]
    instruments: tuple[str, str] | None


@dataclass(frozen=True, eq=False)
class ArmDrift:
    """What an arm's results say of its drift. `drift` is None with fewer than two results that count.

    `due` is None where no date can be given; `due_reason` says why, or why it is due already, "" where
    nothing is to be said.
    """

    serial: str
    model: str
    used: tuple[StoredResult, ...]
    left_out: tuple[LeftOut, ...]
    drift: Drift | None
    jumps: tuple[DatedJump, ...]
    undecided: tuple[DatedChange, ...]
    tolerance_mm: float
    due: datetime | None
    due_reason: str

    def at_last(self) -> ArmDrift:
        """The same without the states before the last result (`Drift.at_last`), for many arms."""
        return replace(self, drift=None if self.drift is None else self.drift.at_last())


def arm_drift(
    arm: tuple[str, str], results: Sequence[StoredResult], events: Sequence[Event], tolerance_mm: float
) -> ArmDrift:
    """The drift of an arm (serial number, model) by its results and events.

    What may have changed the arm since the last result that counts (collision, motor, mastering) makes the
    next calibration due when it happened.
    """
    used: list[StoredResult] = []
    left_out: list[LeftOut] = []
    for own in results:
        reason = _why_not(own)
        if reason is None:
            used.append(own)
        else:
            left_out.append(LeftOut(own, reason))
    found, due, reason = None, None, "fewer than two results count"
    jumps: tuple[DatedJump, ...] = ()
    undecided: tuple[DatedChange, ...] = ()
    if len(used) >= 2:
        units = {row["name"]: row["unit"] for own in used for row in own.offsets}
        at = [own.measured_at for own in used]
        reset = [t for t in range(len(at) - 1) if _between(events, at[t], at[t + 1], "mastering")]
        found = drift(series_of([_observation(own, used[0].measured_at) for own in used], units, reset))
        instruments = [own.instrument for own in used]

        def beside(
            after: int, offset: str
        ) -> tuple[datetime, datetime, tuple[Event, ...], tuple[str, str] | None]:
            assert found is not None
            between = _between(events, at[after], at[after + 1])
            return at[after], at[after + 1], between, change_at(found.series, instruments, after, offset)

        jumps = tuple(DatedJump(own, *beside(own.after, own.offset)) for own in found.jumps)
        undecided = tuple(DatedChange(own, *beside(own.after, own.offset)) for own in found.undecided)
        due, reason = _due(found, used[-1], tolerance_mm)
    if used and (since := _since(events, used[-1].measured_at)):
        due, reason = since[0].at, f"{since[0].what} on {since[0].at:%Y-%m-%d}, after the last result"
    return ArmDrift(*arm, tuple(used), tuple(left_out), found, jumps, undecided, tolerance_mm, due, reason)


def _why_not(own: StoredResult) -> str | None:
    if own.verdict == "misfit":
        return "misfit: the model does not describe the measurements"
    if own.without_prior is None:
        return "it has no covariance of the offsets without prior: add it again, made by this version"
    dof = own.without_prior["dof"]
    if dof is not None and dof <= 2:
        return "its noise is estimated with two degrees of freedom or fewer"
    return None


def _observation(own: StoredResult, first: datetime) -> Observation:
    alone = own.without_prior
    assert alone is not None
    dof = alone["dof"]
    # An estimated noise: the variance of Student's t.
    factor = 1.0 if dof is None else dof / (dof - 2)
    by_geometry = np.array(alone["by_geometry"], float).reshape(len(alone["names"]), -1)
    return Observation(
        at=(own.measured_at - first) / YEAR,
        names=tuple(alone["names"]),
        values=np.array(alone["values"], float),
        covariance=factor * np.array(alone["covariance"], float),
        shared=by_geometry @ by_geometry.T,
    )


def _between(
    events: Sequence[Event], after: datetime, before: datetime, what: str | None = None
) -> tuple[Event, ...]:
    return tuple(own for own in events if after <= own.at <= before and what in (None, own.what))


def _since(events: Sequence[Event], last: datetime) -> tuple[Event, ...]:
    """What may have changed the offsets after the last result."""
    return tuple(own for own in events if own.at > last and own.what != "other")


def _due(found: Drift, last: StoredResult, tolerance_mm: float) -> tuple[datetime | None, str]:
    if last.sensitivity_mm2 is None:
        return None, "the last result claims no accuracy at the TCP"
    names, matrix = [row["name"] for row in last.offsets], np.array(last.sensitivity_mm2, float)
    unknown = [name for i, name in enumerate(names) if matrix[i, i] > 0 and name not in found.series.names]
    if unknown:
        return None, f"the TCP depends on offsets that no result determines: {', '.join(unknown)}"
    lost = [
        name
        for name, is_known in zip(found.series.names, found.series.determined[-1], strict=True)
        if not is_known
    ]
    if lost:
        return None, f"no result since the last mastering determines {', '.join(lost)}"
    at = [names.index(name) for name in found.series.names if name in names]
    if len(at) < len(found.series.names):
        return None, "the last result has other offsets than the results before"
    years = due_after(found, matrix[np.ix_(at, at)], tolerance_mm)
    if years is None:
        return None, NOT_SOON
    if years == 0:
        return last.measured_at, "the uncertainty at the last result exceeds the tolerance already"
    try:
        return last.measured_at + years * YEAR, ""
    except OverflowError:  # behind the last day of the calendar
        return None, NOT_SOON
