"""Work that worker processes of a cluster can import."""

from __future__ import annotations

import os
import time


def slow_once(job):
    """What hangs the first time, and is there at once the second: as on a worker that has stopped."""
    number, mark = job
    if number == 3:
        try:
            os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return number
        time.sleep(30)
    return number
