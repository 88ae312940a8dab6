"""Which offsets are determined, in one sentence; and why each can be trusted or not, in a few words: the
last column of the one table of an answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from ..analysis.observability.causes import AsGoodAs, Cause, Held, Unconverged
from ..analysis.status import Status
from ..model.likelihood.parameters import HeldBy
from . import numbers
from .entries import NONE_ESTIMATED
from .observability import part_of, size_of
from .wording import NOT_DETERMINED, WEAK, Namer, be, joints, listed, person, status_words

_HELD_BY: dict[HeldBy, str] = {
    "base frame": "held: base frame",
    "tool rotation": "held: free tool",
    "first link": "held: base frame",
    "free tool": "held: free tool",
    "header": "held by the header",
}


def offsets_sentence(
    rows: Sequence[_Offset],
    k: float,
    name: Namer = person,
    after: Status | None = None,
    of: str = "U",
) -> str:
    """Which offsets are determined, in one short sentence, the gravest first: `J2 to J5 are identified,
    U ≤ 0.17° (k = 2); J6 assumed.` Their table says why. The status `after` which it follows is not said
    again. `of` names what U is of, where the table has that of another quantity."""
    by_status = {status: [row for row in rows if row.status == status] for status in _ORDER}
    parts: list[str] = []
    for status, of_status in by_status.items():
        if not of_status:
            continue
        subject = listed(joints([row.name for row in of_status], name))
        verb = "" if parts else f" {be(of_status)}"
        text = subject if status == after else f"{subject}{verb} {status_words(status)}"
        if status == "identified" and not by_status["weak"] and not by_status["unidentifiable"]:
            text += f", {_at_most(of_status, k, of)} ({numbers.coverage(k)})"
        if status == "weak" and not by_status["unidentifiable"]:
            text += f", {_at_most(of_status, k, of)}"
        parts.append(text)
    return f"{'; '.join(parts)}." if parts else NONE_ESTIMATED


class _Offset(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def status(self) -> Status: ...
    @property
    def std(self) -> float | None: ...


_ORDER: tuple[Status, ...] = ("unidentifiable", "weak", "identified", "assumed")


def verdict_sentence(
    word: str, verdict: str, rows: Sequence[_Offset], k: float, name: Namer = person, of: str = "U"
) -> str:
    """The `word` of a verdict and the offsets; a word that is theirs too is said once."""
    if verdict == "weak" and any(row.status == "weak" for row in rows):
        return f"{word}: {offsets_sentence(rows, k, name, 'weak', of)}"
    return f"{word}. {offsets_sentence(rows, k, name, of=of)}"


def _at_most(rows: Sequence[_Offset], k: float, of: str) -> str:
    """The largest expanded uncertainty of offsets, by unit."""
    largest: dict[str, float] = {}
    for row in rows:
        largest[row.unit] = max(largest.get(row.unit, 0.0), k * (row.std or 0.0))
    values = " and ".join(numbers.spread(u, numbers.unit_of(unit)) for unit, u in largest.items())
    return f"{of} ≤ {values}"


class _Row(_Offset, Protocol):
    @property
    def cause(self) -> Cause | None: ...


def tolerances_of(header: Mapping[str, object]) -> dict[str, float]:
    """Up to which u an offset counts as identified, by unit, of a header's plain values."""
    tolerance = header.get("tolerance")
    keys = {"deg": "offset_deg", "mm": "length_mm"}
    of_unit = {unit: tolerance.get(key) for unit, key in keys.items()} if isinstance(tolerance, dict) else {}
    return {unit: float(value) for unit, value in of_unit.items() if isinstance(value, int | float)}


def above(limit: float, k: float, unit: str) -> str:
    """That U is above `k` times the tolerance of an offset: `U > 0.2°`."""
    return f"U > {numbers.exact(k * limit, unit)}"


def without_estimate(row: _Row) -> str:
    """What stands in place of an estimate that there is not."""
    return "no estimate" if isinstance(row.cause, Unconverged) else NOT_DETERMINED


def trusted(row: _Row, k: float, tolerances: Mapping[str, float]) -> str:
    """Yes or no, and by what; `tolerances` (u, by unit) decide what is weakly observable."""
    cause = row.cause
    match row.status:
        case "held":
            return _HELD_BY[cause.by] if isinstance(cause, Held) else "held"
        case "identified" if isinstance(cause, AsGoodAs):
            parts = [f"the stated {one.part}" for one in cause.of]
            return f"yes, by {listed(list(dict.fromkeys(parts)))}"
        case "identified":
            return "yes"
        case "assumed" if isinstance(cause, AsGoodAs):
            of = [one.part if cause.weak else part_of(one).removeprefix("the ") for one in cause.of]
            parts = [f"{part} assumed {size_of(one)}" for part, one in zip(of, cause.of, strict=True)]
            return f"no: {'weak, ' if cause.weak else ''}{listed(list(dict.fromkeys(parts)))}"
        case "assumed":
            return "no: assumed"
        case "weak":
            limit = tolerances.get(row.unit)
            if limit is None or row.std is None:
                return f"no: {WEAK}"
            # The status is that of the data alone: a prior can bring u below the tolerance.
            return f"no: {WEAK}, {above(limit, k, row.unit) if row.std > limit else 'without its prior'}"
        case "unvalidated":
            return "no: the model does not fit"
        case "unidentifiable" if isinstance(cause, Unconverged):
            return "no: the fit did not converge"
        case "unidentifiable":
            return "no: unidentifiable"
