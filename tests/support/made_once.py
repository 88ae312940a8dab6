"""What takes long to make and is asked for by tests of several files: made by whichever worker is first."""

import os
import pickle
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Made = TypeVar("Made")


def made_once(name: str, make: Callable[[], Made]) -> Made:
    """What `make` gives, or what it gave another worker of this session, from the file that was left then.

    Who asks while another makes it waits; the file is whole at any time. Outside pytest nothing is kept.
    """
    folder = os.environ.get("ZEROBEAM_TESTS_MADE")
    if folder is None:
        return make()
    file = Path(folder) / f"{name}.pickle"
    making = file.with_name(f"{file.name}.making")
    while not file.exists():
        try:
            making.touch(exist_ok=False)
        except FileExistsError:  # gone without the file: the other has failed
            time.sleep(0.05)
            continue
        try:
            if not file.exists():
                made = make()
                part = file.with_name(f"{file.name}.{os.getpid()}")
                part.write_bytes(pickle.dumps(made))
                part.replace(file)
                return made
        finally:
            making.unlink()
    result: Made = pickle.loads(file.read_bytes())
    return result
