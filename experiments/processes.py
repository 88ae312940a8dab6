"""Work that is done side by side in processes of its own."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context, parent_process
from typing import TypeVar

from threadpoolctl import threadpool_limits

Job = TypeVar("Job")
Answer = TypeVar("Answer")


def side_by_side(
    work: Callable[[Job], Answer], jobs: Sequence[Job], processes: int | None = None
) -> Iterator[tuple[int, Answer]]:
    """The number of each job and its answer, as they come; as many `processes` as there are cores.

    `work` is a function of a module, for it is looked up there by name. Ctrl-C ends it with the jobs that are
    under way.
    """
    processes = min(processes or os.cpu_count() or 1, max(len(jobs), 1))
    if processes == 1:
        for number, job in enumerate(jobs):
            with threadpool_limits(limits=1):
                answer = work(job)
            yield number, answer
        return
    # Spawned, not forked: a fork takes the locks of threads along, but not the threads.
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=_start) as pool:
        asked = {pool.submit(work, job): number for number, job in enumerate(jobs)}
        try:
            for answered in as_completed(asked):
                yield asked[answered], answered.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _start() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that waits for this one
    threadpool_limits(limits=1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
