"""What takes long to make and is asked for by tests of several files: made by whichever worker is first."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Made = TypeVar("Made")


def made_once(name: str, make: Callable[[], Made]) -> Made:
    """What `make` gives, or what it gave another worker of this session, from the file that was left then.

    Two that ask at the same time both make it; the file is whole at any time. Outside pytest nothing is kept.
    """
    folder = os.environ.get("ZEROBEAM_TESTS_MADE")
    if folder is None:
        return make()
    file = Path(folder) / f"{name}.pickle"
    if file.exists():
        result: Made = pickle.loads(file.read_bytes())
        return result
    made = make()
    part = file.with_name(f"{file.name}.{os.getpid()}")
    part.write_bytes(pickle.dumps(made))
    part.replace(file)
    return made
