"""Work that worker processes of a cluster can import."""

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


def ends_its_worker(number):
    """What takes the whole process along, as the kernel does where memory is short."""
    if number == 30:
        os._exit(9)
    return number
