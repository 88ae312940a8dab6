"""What may be said of a parameter, and of all offsets together: the words that every answer uses, and the row
of an answer, with no number that its status does not allow.

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
from typing import Annotated, ClassVar, Literal

from ..model.errors import UnsoundResult
from ..model.records import it, key, record

LACK_OF_FIT = 1e-3  # p-value below which a misfit is not put down to chance
UNVALIDATED = "unvalidated: the model does not describe the measurements"

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


@record(repr=False)
class StatusRow:
    """The parameter `name` in its `unit`, and what the data determine of it.

    Raises UnsoundResult where a number is claimed that the status does not allow: `claims` are the fields
    that have one. A "held" parameter has no number but the value that it is held at, its `estimate`.
    """

    claims: ClassVar[tuple[str, ...]] = ("estimate", "std", "interval95")

    name: Annotated[str, it("of the parameter, as `delta2` (docs/conventions.md)")]
    unit: Annotated[
        str, it("`deg`, `mm`, or `1` for a factor on the noise: 1.2 means 1.2 times the stated noise")
    ]
    status: Annotated[RepeatStatus, it("what the data determine")]

    def __post_init__(self) -> None:
        claims = {name: getattr(self, name, None) for name in self.claims}
        if self.held:
            claims["estimate"] = None
        require_no_more_than(self.name, self.status, **claims)

    @property
    @key("whether it is not estimated")
    def held(self) -> bool:
        """Whether it is not estimated."""
        return self.status == "held"

    @property
    def has_numbers(self) -> bool:
        """Whether its status allows it numbers: it is determined, assumed, or stated by a table."""
        return has_numbers(self.status)

    @property
    def u(self) -> float | None:
        """The standard uncertainty (GUM), another name for `std`."""
        return getattr(self, "std", None)

    def __repr__(self) -> str:
        """On one line, rounded by the standard uncertainty."""
        form = "g" if self.u is None else f".{max(1 - int(f'{self.u:.1e}'.split('e')[1]), 0)}f"
        unit = "" if self.unit == "1" else f" {self.unit}"
        numbers = (("", getattr(self, "estimate", None)), ("u ", self.u))
        parts = [f"{label}{value:{form}}{unit}" for label, value in numbers if value is not None]
        word = UNVALIDATED if self.status == "unvalidated" else self.status
        return f"<{self.name}: {', '.join([*parts, word])}>"


@record(repr=False)
class ParameterRow(StatusRow):
    """A parameter with its `estimate`, standard uncertainty `std` and 95 % interval: None where it is
    "unidentifiable"."""

    status: Annotated[Status, it("what the data determine")]
    estimate: Annotated[
        float | None, it("the mode of the posterior; the value of a held parameter; null if unidentifiable")
    ]
    std: Annotated[float | None, it("standard uncertainty at the mode; null if unidentifiable or held")]
    interval95: Annotated[
        tuple[float, float] | None,
        it(
            "95 % interval at the mode; null if unidentifiable or held; of a noise factor it is not symmetric"
        ),
    ]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.std is not None and (self.estimate is None or not self.std > 0):
            raise UnsoundResult(f"{self.name!r} has an empty std, or one without an estimate")
        if self.interval95 is not None and not self.interval95[0] < self.interval95[1]:
            raise UnsoundResult(f"the interval95 of {self.name!r} is empty")

    def require_whole(self) -> None:
        """UnsoundResult where it lacks a number that its status promises."""
        if self.has_numbers and None in (self.estimate, self.std, self.interval95):
            raise UnsoundResult(f"{self.name!r} is {self.status}, but lacks estimate, std or interval95")
