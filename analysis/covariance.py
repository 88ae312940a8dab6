"""Numbers with names: rows of an answer, covariances of what the data determine and of nothing else."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from ..model.arrays import Matrix
from ..model.errors import BadInput, missing_extra
from ..model.parsing.reading import did_you_mean
from .status import Status, UnsoundResult, require_no_more_than

if TYPE_CHECKING:
    import pandas as pd


class NamedRow(Protocol):
    """What a row has at least."""

    @property
    def name(self) -> str: ...


Row = TypeVar("Row", bound=NamedRow)


def parameter_name(name: str) -> str:
    """The name of a parameter, of which pendants say J2: delta2.

    >>> parameter_name("J2"), parameter_name("psd.x")
    ('delta2', 'psd.x')
    """
    return re.sub(r"^J(?=\d+$)", "delta", str(name))


class Rows(tuple[Row, ...]):
    """Rows with names, in their order."""

    __slots__ = ()

    def named(self, name: str) -> Row:
        """The row of this name, of an offset also its joint's ("J2"); BadInput where there is none."""
        for row in self:
            if row.name == parameter_name(name):
                return row
        names = [row.name for row in self]
        raise BadInput(
            "no parameter has this name",
            found=name,
            allowed=", ".join(names),
            remedy=did_you_mean(str(name), names),
        )


def frame(data: Any, **how: Any) -> pd.DataFrame:
    """`pandas.DataFrame(data, **how)`; BadInput says how to install pandas where it is missing."""
    try:
        import pandas as pd
    except ImportError:
        raise missing_extra("a DataFrame", "notebook", needed="pandas") from None
    return pd.DataFrame(data, **how)


@dataclass(frozen=True, eq=False)
class Covariance:
    """The covariance of the m parameters that the data determine, and of nothing else.

    Attributes
    ----------
    names, units : tuple of str
        (m,) what each row is, and its unit: deg, mm, or 1 for a noise factor.
    status : tuple of str
        (m,) "identified" or "weak"; "unvalidated" where the model does not describe the measurements.
    matrix : ndarray
        (m, m) in the products of those units.

    Raises
    ------
    UnsoundResult
        A parameter is of another status.

    Examples
    --------
    >>> import numpy as np
    >>> import zerobeam as zb
    >>> both = ("identified", "identified")
    >>> covariance = zb.Covariance(("delta2", "delta3"), ("deg", "deg"), both, np.array([[4, 1], [1, 9.0]]))
    >>> covariance["delta2", "delta3"], covariance.std.tolist()
    (1.0, [2.0, 3.0])
    >>> covariance.correlation.loc["delta2", "delta3"].round(3)
    np.float64(0.167)
    >>> covariance["delta2", "delta4"]
    Traceback (most recent call last):
    zerobeam.model.errors.BadInput: the covariance has no row for this parameter: ...
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    status: tuple[Status, ...]
    matrix: Matrix

    def __post_init__(self) -> None:
        for name, status in zip(self.names, self.status, strict=True):
            require_no_more_than(name, status, covariance=self.matrix)
        if self.matrix.shape != (len(self.names),) * 2:
            raise UnsoundResult(
                f"a covariance of {len(self.names)} parameters has the shape {self.matrix.shape}"
            )

    def __repr__(self) -> str:
        width = max([8, *map(len, self.names)]) + 2
        head = " " * width + "".join(name.rjust(width) for name in self.names)
        rows = (
            name.ljust(width) + "".join(f"{value:.2g}".rjust(width) for value in row)
            for name, row in zip(self.names, self.matrix.tolist(), strict=True)
        )
        return "\n".join([head, *rows])

    def __getitem__(self, names: tuple[str, str]) -> float:
        first, second = names
        return float(self.matrix[self._at(first), self._at(second)])

    def select(self, names: Sequence[str]) -> Covariance:
        """The covariance of some of the parameters, in the order asked for."""
        at = [self._at(name) for name in names]
        return Covariance(
            tuple(self.names[i] for i in at),
            tuple(self.units[i] for i in at),
            tuple(self.status[i] for i in at),
            self.matrix[np.ix_(at, at)],
        )

    @property
    def std(self) -> Matrix:
        """(m,) standard uncertainties."""
        return np.sqrt(np.diag(self.matrix))

    @property
    def correlation(self) -> pd.DataFrame:
        """(m, m) correlation coefficients, labelled by name on both sides; BadInput without pandas."""
        labels = list(self.names)
        return frame(self.matrix / np.outer(self.std, self.std), index=labels, columns=labels)

    def to_frame(self) -> pd.DataFrame:
        """A pandas DataFrame labelled by name on both sides; BadInput without pandas."""
        return frame(self.matrix, index=list(self.names), columns=list(self.names))

    def _at(self, name: str) -> int:
        if parameter_name(name) in self.names:
            return self.names.index(parameter_name(name))
        raise BadInput(
            "the covariance has no row for this parameter: the data do not determine it, or it is held",
            found=name,
            allowed=", ".join(self.names) or "none: the data determine nothing",
        )


@dataclass(frozen=True)
class OffsetsWithoutPrior:
    """What the measurements say of the m offsets that they determine, without any prior: what another run of
    the same arm can be held against.

    `covariance` (m, m) is by the noise alone, in the products of the units; `by_geometry` (m, g) is what each
    freed parameter of the geometry adds if it is one tolerance off: the same in every run of the arm. `dof`
    are those that the noise is estimated from, None where it is known.

    Raises UnsoundResult where an offset is of a status that allows no number.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    status: tuple[Status, ...]
    values: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    geometry: tuple[str, ...]
    by_geometry: tuple[tuple[float, ...], ...]
    dof: int | None

    def __post_init__(self) -> None:
        for name, status, value in zip(self.names, self.status, self.values, strict=True):
            require_no_more_than(name, status, value=value)
