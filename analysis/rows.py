"""Rows of an answer: by their order, by name, and as a pandas table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from ..model.errors import BadInput, missing_extra
from ..model.files.reading import did_you_mean

if TYPE_CHECKING:
    import pandas as pd


class Named(Protocol):
    """What a row has at least."""

    @property
    def name(self) -> str: ...


Row = TypeVar("Row", bound=Named)


class Rows(tuple[Row, ...]):
    """Rows with names, in their order."""

    __slots__ = ()

    def named(self, name: str) -> Row:
        """The row of this name; BadInput where there is none."""
        for row in self:
            if row.name == name:
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
