"""The row of an answer, with no number that its status does not allow."""

from __future__ import annotations

from typing import Annotated, ClassVar

from ..model.errors import UnsoundResult
from ..model.records import it, key, record
from .status import UNVALIDATED, RepeatStatus, Status, has_numbers, require_no_more_than


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
