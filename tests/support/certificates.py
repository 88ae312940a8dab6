"""What the tests of certificates need: a history with one result, and a key."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from histories import write_result

from zerobeam.experiments.history.certified import make_key
from zerobeam.experiments.history.database import Database, open_history
from zerobeam.experiments.history.store import add, results
from zerobeam.experiments.history.stored_result import StoredResult, read_entry


def no_passphrase() -> str:
    raise AssertionError("a passphrase is asked for")


def a_key(folder: Path) -> Path:
    """A private key without a passphrase; the public one is beside it."""
    private = folder / "plant.key"
    if not private.exists():
        make_key(private, None)
    return private


def kept(folder: Path, *answers: Mapping[str, Any], url: str | None = None) -> Database:
    """A history of these results."""
    history = open_history(url or str(folder / "history.sqlite"), create=True)
    for number, answer in enumerate(answers):
        own = read_entry(write_result(folder / f"{number}.json", dict(answer)), lambda sha256: None)
        assert own is not None
        add(history, [own])
    return history


def only(history: Database) -> StoredResult:
    (own,) = results(history)
    return own
