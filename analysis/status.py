"""What may be said of a parameter, and of all offsets together: the words that every answer uses.

`identified` and `weak` are determined by the data (within the tolerance, or beyond it), `unidentifiable` is
not, `held` is not estimated. `assumed` is what the data determine only with what nobody stated or measured,
as the mounting of the tool: it has numbers, and is no part of a pass. `unvalidated` is what would be
identified, weak or assumed if the model described the measurements: its numbers are not to be relied on. This
is a leaf: whatever holds an answer imports it.
"""

from __future__ import annotations

import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from typing import Literal

from ..model.errors import UnsoundResult

LACK_OF_FIT = 1e-3  # p-value below which a misfit is not put down to chance
NOT_DESCRIBED = "the model does not describe the measurements"
UNVALIDATED = f"unvalidated: {NOT_DESCRIBED}"

Status = Literal["identified", "weak", "assumed", "unidentifiable", "held", "unvalidated"]
# Of a run beside others: a prior has a part in it, or it is of a table that states it, or does not.
RepeatStatus = Status | Literal["prior", "stated", "not stated"]
Verdict = Literal["pass", "weak", "degenerate", "misfit"]

_VERDICT_OF: dict[Status, Verdict] = {
    "unidentifiable": "degenerate",
    "weak": "weak",
    "unvalidated": "misfit",
}
_BY_GRAVITY: tuple[Status, ...] = (
    "identified",
    "weak",
    "assumed",
    "held",
    "unidentifiable",
    "unvalidated",
)
_GRAVITY: dict[Verdict, int] = {"pass": 0, "weak": 1, "degenerate": 2, "misfit": 3}


def known(status: RepeatStatus) -> bool:
    """Whether the data determine it, if the model describes them."""
    return status in ("identified", "weak", "unvalidated")


def has_numbers(status: RepeatStatus) -> bool:
    """Whether it has an estimate, a standard uncertainty, an interval: the data determine it, if need be with
    what is assumed, or a table states it."""
    return known(status) or status in ("assumed", "stated")


def called(*status: Status) -> str:
    """What stands beside the numbers of parameters of these statuses: of a misfit that they are unvalidated,
    else the gravest of the statuses.

    >>> called("identified", "weak"), called("identified", "unvalidated")
    ('weak', 'unvalidated: the model does not describe the measurements')
    """
    gravest = max(status, key=_BY_GRAVITY.index)
    return UNVALIDATED if gravest == "unvalidated" else gravest


def caveat(statuses: Iterable[Status]) -> str:
    """The end of a line or caption with numbers of parameters of these statuses: of a misfit that they are
    unvalidated, else nothing.

    >>> caveat(["identified", "weak"]), caveat(["held", "unvalidated"])
    ('', '; unvalidated: the model does not describe the measurements')
    """
    return f"; {UNVALIDATED}" if "unvalidated" in statuses else ""


def with_misfit(status: Status) -> Status:
    """The status where the model does not describe the data."""
    return "unvalidated" if has_numbers(status) else status


def verdict_of(offsets: Iterable[Status]) -> Verdict:
    """The verdict over the statuses of all offsets: that of the gravest. What is assumed or held is no part
    of a pass; where nothing but that is estimated, there is none."""
    every = tuple(offsets)
    if "assumed" in every and not any(known(status) or status == "unidentifiable" for status in every):
        return "weak"
    return max(
        (_VERDICT_OF.get(status, "pass") for status in every), key=_GRAVITY.__getitem__, default="pass"
    )


def as_grave(verdict: Verdict, needed: Verdict) -> bool:
    """Whether a verdict is as grave as the one that is needed, or graver."""
    return _GRAVITY[verdict] >= _GRAVITY[needed]


def require_no_more_than(what: str, status: RepeatStatus | None, **claims: object) -> None:
    """Raise UnsoundResult unless `claims` (by name, None where nothing is claimed) go with the status.

    What the data cannot determine is never reported as known: every object that holds an estimate, a standard
    uncertainty, an interval or a covariance of one parameter calls this when it is made. Parts of a result
    that was read have no status of their own (None): it is checked as a whole.

    Examples
    --------
    >>> require_no_more_than("delta2", "unidentifiable", estimate=None, std=None)
    >>> require_no_more_than("delta2", "unidentifiable", estimate=0.1)
    Traceback (most recent call last):
        ...
    zerobeam.model.errors.UnsoundResult: 'delta2' is unidentifiable, yet it has a value as estimate
    """
    claimed = [name for name, value in claims.items() if value is not None]
    if claimed and status is not None and not has_numbers(status):
        raise UnsoundResult(f"{what!r} is {status}, yet it has a value as {', '.join(claimed)}")


def versions() -> dict[str, str]:
    """Versions of what an answer was computed with, by the library's name."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    names = ("zerobeam", "numpy", "scipy", "casadi", "emcee")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}
