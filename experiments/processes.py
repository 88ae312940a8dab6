"""Work that is done side by side in processes of its own."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import TypeVar

from threadpoolctl import threadpool_limits

Job = TypeVar("Job")
Answer = TypeVar("Answer")


def side_by_side(
    work: Callable[[Job], Answer], jobs: Sequence[Job], processes: int | None = None
) -> Generator[tuple[int, Answer], None, None]:
    """The number of each job and its answer, as they come; as many `processes` as there are cores.

    `work` is a function of a module, for it is looked up there by name. What ends it early (Ctrl-C, an
    error, its `close`) breaks off the jobs that are under way. Close it: what happens between two answers
    does not reach it.
    """
    processes = min(processes or os.cpu_count() or 1, max(len(jobs), 1))
    if processes == 1:
        for number, job in enumerate(jobs):
            with threadpool_limits(limits=1):
                answer = work(job)
            yield number, answer
        return
    # Spawned, not forked: a fork takes the locks of threads along, but not the threads.
    context = get_context("spawn")
    ended, held = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_start, initargs=(ended,))
    try:
        with _interruptions_put_off():
            asked = {pool.submit(work, job): number for number, job in enumerate(jobs)}
        for answered in as_completed(asked):
            yield asked[answered], answered.result()
    except BaseException:
        held.close()  # nobody wants the answers that are still to come
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        held.close()
        ended.close()


@contextmanager
def _interruptions_put_off() -> Iterator[None]:
    """Ctrl-C waits until the end, and does not reach a process that is started here.

    A terminal sends it to all processes, to workers too that are still at their imports.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start(ended: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that waits for this one
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # by it the pool ends workers, whatever the parent ignored
    threadpool_limits(limits=1)
    threading.Thread(target=_end_with_parent, args=(ended,), daemon=True).start()


def _end_with_parent(ended: Connection) -> None:
    """A worker must not outlive the wait for its answers, and would wait for work for ever after a kill.

    The other end of `ended` is the parent's alone: closed when nobody waits any more and when it ends.
    """
    with suppress(EOFError, OSError):
        ended.recv()
    os._exit(1)
