"""The options that the commands share, and the history opened for one of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated

import typer

from ...model.errors import BadInput, missing_extra
from ..console import err, plain

if TYPE_CHECKING:
    from ...experiments.history.database import Database
    from ...experiments.history.store import Damaged

Url = Annotated[
    str | None,
    typer.Option(
        "--db",
        envvar="ZEROBEAM_HISTORY",
        help="SQLite file, or postgresql://user@host/database. Default: history.sqlite in your data folder.",
        metavar="URL",
        show_default=False,
    ),
]
Serial = Annotated[
    str, typer.Argument(help="Serial number of the arm.", metavar="SERIAL", show_default=False)
]
Model = Annotated[
    str | None,
    typer.Option(help="Model of the arm, where several have this serial number.", show_default=False),
]


@contextmanager
def opened(db: str | None, *, create: bool = False) -> Iterator[Database]:
    if any(find_spec(needed) is None for needed in ("sqlalchemy", "alembic")):
        raise missing_extra("a history", "history")
    from ...experiments.history.database import open_history

    history = open_history(db, create=create)
    try:
        yield history
    finally:
        history.engine.dispose()


@contextmanager
def damage_named() -> Iterator[Damaged]:
    """Damaged results and events are named as errors, the rest goes on; at the end the exit status is 2."""
    errors: list[BadInput] = []

    def name(error: BadInput) -> None:
        errors.append(error)
        err.print(f"error: {plain(error)}", markup=False, soft_wrap=True)

    yield name
    if errors:
        raise typer.Exit(BadInput.exit_status)
