"""The row of an answer: one parameter, with no number that its status does not allow."""

from __future__ import annotations

from typing import Annotated

from ..model.errors import UnsoundResult
from ..model.records import it, key, record
from .covariance import row_text
from .status import Status, require_no_more_than


@record
class ParameterRow:
    """The parameter `name` in its `unit`, with its `estimate`, standard uncertainty `std` and 95 % interval.

    They are None where it is "unidentifiable"; a "held" one has no number but the value that it is
    held at, its `estimate`.

    Raises UnsoundResult where a number is claimed that the status does not allow, or is none.
    """

    name: Annotated[str, it("of the parameter, as `delta2` (docs/conventions.md)")]
    unit: Annotated[
        str, it("`deg`, `mm`, or `1` for a factor on the noise: 1.2 means 1.2 times the stated noise")
    ]
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
        claims = {"std": self.std, "interval95": self.interval95}
        if not self.held:
            claims["estimate"] = self.estimate
        require_no_more_than(self.name, self.status, **claims)
        if self.std is not None and (self.estimate is None or not self.std > 0):
            raise UnsoundResult(f"{self.name!r} has an empty std, or one without an estimate")
        if self.interval95 is not None and not self.interval95[0] < self.interval95[1]:
            raise UnsoundResult(f"the interval95 of {self.name!r} is empty")

    @property
    @key("whether it is not estimated")
    def held(self) -> bool:
        """Whether it is not estimated."""
        return self.status == "held"

    @property
    def u(self) -> float | None:
        """The standard uncertainty (GUM), another name for `std`."""
        return self.std

    def __repr__(self) -> str:
        return row_text(self.name, self.unit, self.status, self.estimate, self.std)
