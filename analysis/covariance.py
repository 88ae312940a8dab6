"""Numbers with names: rows of an answer, covariances of what the data determine and of nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeVar, get_args

import numpy as np
from pydantic import GetCoreSchemaHandler
from pydantic_core.core_schema import CoreSchema, no_info_after_validator_function, tuple_variable_schema

from ..model.arrays import ByValue, ListedMatrix, Matrix
from ..model.errors import BadInput, UnsoundResult, missing_extra
from ..model.parsing.reading import did_you_mean
from ..model.records import internal, it, record
from .status import UNVALIDATED, Status, caveat, require_no_more_than

if TYPE_CHECKING:
    import pandas as pd


class NamedRow(Protocol):
    """What a row has at least."""

    @property
    def name(self) -> str: ...


Row = TypeVar("Row", bound=NamedRow)
Value = TypeVar("Value", bound=float | None)


def parameter_name(name: str) -> str:
    """The name of a parameter, of which pendants say J2: delta2.

    >>> parameter_name("J2"), parameter_name("psd.x")
    ('delta2', 'psd.x')
    """
    return re.sub(r"^J(?=\d+$)", "delta", str(name))


def parameter_among(names: Sequence[str], name: object, argument: str | None = None) -> str:
    """The name of a parameter among `names`, of an offset also by its joint's ("J2"); BadInput where it is
    none of them."""
    if isinstance(name, str) and parameter_name(name) in names:
        return parameter_name(name)
    joint = f"J{name}" if isinstance(name, int) else str(name).strip().upper()
    near = f"did you mean {joint!r}?" if parameter_name(joint) in names else did_you_mean(str(name), names)
    raise BadInput(
        "no parameter has this name",
        found=repr(name),
        allowed=", ".join(names),
        remedy=near,
        argument=argument,
    )


class Names(tuple[str, ...]):
    """Names of parameters; an offset is among them by its joint's name ("J2") too."""

    __slots__ = ()

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and super().__contains__(parameter_name(name))


class Rows(tuple[Row, ...]):
    """Rows with names, in their order."""

    __slots__ = ()

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        row: Any = get_args(cls.__orig_bases__[0])[0]  # type: ignore[attr-defined]
        return no_info_after_validator_function(cls, tuple_variable_schema(handler.generate_schema(row)))

    def named(self, name: str) -> Row:
        """The row of this name, of an offset also its joint's ("J2"); BadInput where there is none."""
        names = self.names
        return self[names.index(parameter_among(names, name))]

    @property
    def names(self) -> Names:
        """Of the rows."""
        return Names(row.name for row in self)


class ValuesByName(dict[str, Value]):
    """Numbers by the name of their parameter, which show the `units` beside them; else a dict.

    >>> ValuesByName({"delta2": 0.0777}, {"delta2": "deg"}, ["identified"])
    {delta2: 0.0777 deg}
    """

    def __init__(
        self,
        values: Mapping[str, Value] | Iterable[tuple[str, Value]] = (),
        units: Mapping[str, str] | None = None,
        statuses: Iterable[Status] = (),
    ) -> None:
        super().__init__(values)
        self.units = {name: (units or {}).get(name, "") for name in self}
        self._caveat = caveat(statuses)

    def __repr__(self) -> str:
        shown = []
        for name, value in self.items():
            number = "none" if value is None else f"{value:.6g} {self.units.get(name, '')}".rstrip()
            shown.append(f"{name}: {number}")
        return f"{{{', '.join(shown)}}}{self._caveat}"


def frame(data: Any, **how: Any) -> pd.DataFrame:
    """`pandas.DataFrame(data, **how)`; BadInput says how to install pandas where it is missing."""
    try:
        import pandas as pd
    except ImportError:
        raise missing_extra("a DataFrame", "notebook", needed="pandas") from None
    return pd.DataFrame(data, **how)


def noted(table: pd.DataFrame, units: Mapping[str, str], statuses: Iterable[Status]) -> pd.DataFrame:
    """The same, with the units of its columns and what stands beside unvalidated numbers in `table.attrs`."""
    table.attrs["units"] = dict(units)
    if "unvalidated" in statuses:
        table.attrs["status"] = UNVALIDATED
    return table


@dataclass(frozen=True, eq=False)
class Covariance(ByValue):
    """The covariance of the m parameters that the data determine, and of nothing else.

    Attributes
    ----------
    names, units : tuple of str
        (m,) what each row is, and its unit: deg, mm, or 1 for a noise factor.
    status : tuple of str
        (m,) "identified" or "weak"; "unvalidated" where the model does not describe the measurements.
    matrix : ndarray
        (m, m) in the products of those units; `numpy.array(covariance)` is the same.

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
    >>> "J2" in covariance, round(float(covariance.correlation.loc["delta2", "delta3"]), 3)
    (True, 0.167)
    >>> covariance["delta2", "delta4"]
    Traceback (most recent call last):
    zerobeam.model.errors.BadInput: the covariance has no row for this parameter: ...
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    status: tuple[Status, ...]
    matrix: ListedMatrix

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", Names(self.names))
        for name, status in zip(self.names, self.status, strict=True):
            require_no_more_than(name, status, covariance=self.matrix)
        if self.matrix.shape != (len(self.names),) * 2:
            raise UnsoundResult(
                f"a covariance of {len(self.names)} parameters has the shape {self.matrix.shape}"
            )

    def __repr__(self) -> str:
        caption = f"Covariance, each element in the product of the units{caveat(self.status)}"
        labels = [f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True)]
        left, width = max(map(len, labels), default=0), max([8, *map(len, self.names)]) + 2
        head = " " * left + "".join(name.rjust(width) for name in self.names)
        rows = (
            label.ljust(left) + "".join(f"{value:.2g}".rjust(width) for value in row)
            for label, row in zip(labels, self.matrix.tolist(), strict=True)
        )
        return "\n".join([caption, head, *rows])

    def __getitem__(self, names: tuple[str, str]) -> float:
        if not isinstance(names, tuple) or len(names) != 2:
            raise BadInput(
                "an element of a covariance has two names",
                found=repr(names),
                allowed='covariance["J2", "J3"]; covariance["J2", "J2"] is a variance',
            )
        first, second = names
        return float(self.matrix[self._at(first), self._at(second)])

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Matrix:
        return np.array(self.matrix, dtype=dtype)

    def select(self, names: Sequence[str]) -> Covariance:
        """The covariance of some of the parameters, in the order asked for; of one alone for one name."""
        at = [self._at(name) for name in ([names] if isinstance(names, str) else names)]
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
        table = frame(self.matrix / np.outer(self.std, self.std), index=labels, columns=labels)
        return noted(table, dict.fromkeys(labels, "1"), self.status)

    def to_frame(self) -> pd.DataFrame:
        """A pandas DataFrame labelled by name on both sides; BadInput without pandas."""
        table = frame(self.matrix, index=list(self.names), columns=list(self.names))
        return noted(table, dict(zip(self.names, self.units, strict=True)), self.status)

    def _at(self, name: str) -> int:
        if name in self.names:
            return self.names.index(parameter_name(name))
        raise BadInput(
            "the covariance has no row for this parameter: the data do not determine it, or it is held",
            found=name,
            allowed=", ".join(self.names) or "none: the data determine nothing",
        )


@record
class OffsetsWithoutPrior:
    """What the measurements say of the m offsets that they determine, without any prior: what another run of
    the same arm can be held against. `by_geometry` (m, g) is the same in every run of the arm.

    Raises UnsoundResult where an offset is of a status that allows no number.
    """

    names: Annotated[tuple[str, ...], it("of the offsets")]
    units: Annotated[tuple[str, ...], it("of each")]
    status: Annotated[tuple[Status, ...], internal]
    values: Annotated[tuple[float, ...], it("of each")]
    covariance: Annotated[tuple[tuple[float, ...], ...], it("by the noise, in products of the units")]
    geometry: Annotated[tuple[str, ...], it("names of the estimated geometry parameters")]
    by_geometry: Annotated[
        tuple[tuple[float, ...], ...], it("of each offset what each of these adds if it is one tolerance off")
    ]
    dof: Annotated[int | None, it("degrees of freedom of the noise; null where it is known")]

    def __post_init__(self) -> None:
        # A result that was read has its statuses in its rows, and is checked against those.
        for name, status, value in zip(self.names, self.status or (), self.values, strict=bool(self.status)):
            require_no_more_than(name, status, value=value)


def drawn_by_covariance(covariance: Matrix, count: int, rng: np.random.Generator) -> Matrix:
    """(count, m) normal at random with that covariance (m, m)."""
    root = root_of(covariance)
    return rng.normal(size=(count, len(root))) @ root.T


def root_of(covariance: Matrix) -> Matrix:
    """(m, m) R with R R' = C."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
