"""When the next calibration of an arm is due, by the databases of results in the folder.

The drift is fitted beside the answers, by a thread of its own: who asks waits a little, then goes without.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from threadpoolctl import threadpool_limits

from ....model.errors import BadInput
from ..kept import kept

TOLERANCE_MM = 0.5  # TCP error that is tolerated: as `zerobeam history drift` has it
_PATIENCE_S = 0.2  # of one answer
_MOST_KEPT = 64
_MOST_DATABASES = 4

_FITS = ThreadPoolExecutor(1, "due dates")


@dataclass(frozen=True)
class DueDate:
    """Of an arm; `reason` where it is due already."""

    serial: str
    date: datetime
    reason: str

    @property
    def overdue(self) -> bool:
        return self.date <= datetime.now(UTC).replace(tzinfo=None)


def due_dates(
    databases: Sequence[Path], serials: Collection[str], patience_s: float = _PATIENCE_S
) -> dict[str, DueDate]:
    """By serial number, as far as they are known by now: of an arm in several databases the last one is."""
    known: dict[str, DueDate] = {}
    sought = tuple(sorted(serials))
    for path in databases[:_MOST_DATABASES] if sought else ():
        try:
            made = _fit_of(path, _log_of(path), sought)
            dates = made.result(timeout=patience_s)
        except (BadInput, OSError, TimeoutError):
            continue
        for due in dates:
            if due.serial not in known or known[due.serial].date < due.date:
                known[due.serial] = due
    return known


@kept(_MOST_KEPT)
def _fit_of(path: Path, log: tuple[int, int] | None, serials: tuple[str, ...]) -> Future[tuple[DueDate, ...]]:
    """The due dates by this version of a database and its `log`, under way or known."""
    return _FITS.submit(_dates, path, serials)


def _log_of(path: Path) -> tuple[int, int] | None:
    """When the log of a database, which has what was written last, was changed, and its size; None: empty."""
    log = path.with_name(f"{path.name}-wal")
    facts = log.stat() if log.exists() else None
    return None if facts is None or not facts.st_size else (facts.st_mtime_ns, facts.st_size)


def _dates(path: Path, serials: tuple[str, ...]) -> tuple[DueDate, ...]:
    """BadInput where it is no history. A serial number that two models have is no arm's alone.

    What reads histories is loaded when there is one: it takes a second.
    """
    from ....experiments.history.arm_drift import arm_drift
    from ....experiments.history.database import open_history
    from ....experiments.history.store import arms, events, results

    history = open_history(str(path))
    dates = []
    try:
        every = [(arm.serial, arm.model) for arm in arms(history, _passed) if arm.results]
        for serial in serials:
            named = [arm for arm in every if arm[0] == serial]
            if len(named) != 1:
                continue
            stored, logged = list(results(history, named[0], _passed)), events(history, named[0], _passed)
            with threadpool_limits(limits=1, user_api="blas"):
                drift = arm_drift(named[0], stored, logged, TOLERANCE_MM)
            if drift.due is not None:
                dates.append(DueDate(serial, drift.due, drift.due_reason))
    finally:
        history.engine.dispose()
    return tuple(dates)


def _passed(error: BadInput) -> None:
    """A row that is damaged says nothing of a date."""
