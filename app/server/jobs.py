"""Commands under way, each in a process of its own: progress, log, answer, and the end at any time."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Annotated, Any, Literal

from starlette.exceptions import HTTPException

from ...analysis.answer.answer_message import Action
from ...analysis.answer.result import parse_result
from ...experiments.rigs.abb.rws_client import PASSWORD
from ...interruption import ATTENDED
from ...model.errors import BadInput
from ...model.parsing.confinement import WITHIN
from ...model.records import it, record, to_json
from ...words.numbers import TimeLeft
from .answers.actions import action_of_result
from .answers.results import first_page
from .index import Folder
from .job_commands import StartedRuns, run_file

AT_ONCE = 2  # jobs under way; others wait
MOST_JOBS = 50  # kept; the oldest that have ended are forgotten
MOST_EVENTS = 5000  # of one job that can be told again: those that stay true
MOST_PASSING = 400  # and those that the next ones outrun
MOST_LOG = 500  # lines
LARGEST_ANSWER = 64 * 10**6  # bytes
_LONGEST_LINE = 2**24  # bytes
_PATIENCE_S = 10.0  # from a request to end until the process is killed
_PROGRAM = "import sys; from zerobeam.cli import main; sys.argv[0] = 'zerobeam'; main()"
_COMMAND = [sys.executable, "-P", "-c", _PROGRAM]  # nothing is imported from the folder
_PASSING = ("progress", "shot", "phase", "spot", "arm")  # events, of a job or a run, that are soon outrun
_LAST = "picture"  # the one of which only the last is kept: it is large
PROGRESS = "ZEROBEAM_PROGRESS"  # what makes a command tell its progress in lines (`commands/console.py`)


_NumberedEvent = tuple[int, str, Any]  # number, kind, data


@record(kw_only=True)
class JobBrief:
    """A job without its log and answer."""

    id: str
    command: list[str]
    state: Literal["waiting", "running", "done", "stopped", "failed"]
    share: Annotated[float, it("of the work that is done")]
    stage: str
    passed_s: Annotated[float | None, it("since it began, seconds")]
    left_s: Annotated[float | None, it("until its end, seconds, where that can be estimated")]
    left_at_least: Annotated[bool, it("whether it takes longer than that: it has not advanced for long")]
    status: Annotated[int | None, it("exit status of the command")]
    asks: Annotated[Literal["lines", "confirm"] | None, it("`confirm`: it waits for yes or no")]


@record(kw_only=True)
class JobWhole(JobBrief):
    """A job."""

    log: Annotated[list[str], it("the last lines of standard error")]
    answer: Annotated[Any, it("the JSON that the command printed")]
    front: Annotated[str | None, it("of an analysis: tables, bars and null-space motion of page one, HTML")]


class AppJob:
    """One command: `state` is waiting, running, done (it gave its answer), stopped or failed."""

    def __init__(self, number: int, command: Sequence[str]) -> None:
        self.number, self.command = number, list(command)
        self.state: Literal["waiting", "running", "done", "stopped", "failed"] = "waiting"
        self.share, self.stage = 0.0, ""
        self.started_at: float | None = None
        self.took_s: float | None = None
        self.log: deque[str] = deque(maxlen=MOST_LOG)
        self.status: int | None = None
        self.answer: Any = None
        self.front: str | None = None
        self.process: asyncio.subprocess.Process | None = None
        self.cancelled = False
        self.task: asyncio.Task[None] | None = None
        self.asks: Literal["lines", "confirm"] | None = None
        self.time_left = TimeLeft(time.monotonic())
        self._kept: deque[_NumberedEvent] = deque(maxlen=MOST_EVENTS)
        self._passing: deque[_NumberedEvent] = deque(maxlen=MOST_PASSING)
        self._picture: _NumberedEvent | None = None
        self._last = 0
        self._told_all = False
        self._news = asyncio.Condition()

    @property
    def ended(self) -> bool:
        return self.state not in ("waiting", "running")

    def brief(self) -> JobBrief:
        """Without log and answer."""
        passed = self.took_s
        if passed is None and self.started_at is not None:
            passed = time.monotonic() - self.started_at
        left = self.time_left.left(time.monotonic()) if self.state == "running" else None
        return JobBrief(
            id=str(self.number),
            command=self.command,
            state=self.state,
            share=round(self.share, 4),
            stage=self.stage,
            passed_s=None if passed is None else round(passed, 1),
            left_s=None if left is None else round(left.seconds, 1),
            left_at_least=left is not None and left.at_least,
            status=self.status,
            asks=self.asks,
        )

    def whole(self) -> JobWhole:
        """With log and answer."""
        return JobWhole(**vars(self.brief()), log=list(self.log), answer=self.answer, front=self.front)

    async def tell(self, kind: str, data: Any) -> None:
        """Add an event, for all who follow."""
        name = data["event"] if kind == "run" else kind
        async with self._news:
            self._last += 1
            event = (self._last, kind, data)
            if name == _LAST:
                self._picture = event
            else:
                (self._passing if name in _PASSING else self._kept).append(event)
            self._told_all = kind == "end"
            self._news.notify_all()

    def _since(self, after: int) -> list[_NumberedEvent]:
        """What can be told again, from behind number `after`."""
        pictures = [] if self._picture is None else [self._picture]
        return sorted(
            (entry for entry in (*self._kept, *self._passing, *pictures) if entry[0] > after),
            key=lambda event: event[0],
        )

    async def events(self, after: int, every_s: float = 15.0) -> AsyncIterator[bytes]:
        """Server-sent events, from behind number `after` until the end; a comment where all is still."""
        while True:
            fresh = self._since(after)
            for number, kind, data in fresh:
                yield f"id: {number}\nevent: {kind}\ndata: {json.dumps(data, allow_nan=False)}\n\n".encode()
                after = number
            if fresh:
                continue
            if self._told_all:
                return
            async with self._news:
                if self._last <= after and not self._told_all:
                    try:
                        await asyncio.wait_for(self._news.wait(), every_s)
                    except TimeoutError:
                        pass
                    else:
                        continue
            if self._last <= after and not self._told_all:
                yield b": still under way\n\n"


class Jobs:
    """All jobs of a server, `AT_ONCE` of them under way."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self.runs = StartedRuns(folder)
        self._jobs: dict[str, AppJob] = {}
        # Who followed a job of a server that was killed must not be told of another one of the same number.
        self._number = int(time.time())
        self._places = asyncio.Semaphore(AT_ONCE)

    def all(self) -> list[AppJob]:
        """The newest first."""
        return list(reversed(self._jobs.values()))

    def of(self, number: str) -> AppJob:
        """The job of a number; HTTPException where there is none."""
        if number not in self._jobs:
            raise HTTPException(404)
        return self._jobs[number]

    def begin(self, command: Sequence[str], password: str | None = None) -> AppJob:
        """A new job; `command` is as `job_command` gives it, `password` that of an ABB controller."""
        if len(self._jobs) >= MOST_JOBS:
            oldest = next((number for number, job in self._jobs.items() if job.ended), None)
            if oldest is None:
                raise BadInput("too many jobs are waiting", allowed=MOST_JOBS, remedy="wait, or end some")
            del self._jobs[oldest]
        self._number += 1
        job = AppJob(self._number, command)
        self._jobs[str(job.number)] = job
        job.task = asyncio.get_running_loop().create_task(self._carry_out(job, password))
        return job

    async def answer(self, job: AppJob, text: str) -> None:
        """Write lines to a job that reads them; BadInput where it asks nothing, or not this."""
        process = job.process
        if job.asks is None or process is None or process.stdin is None or job.ended or job.cancelled:
            raise BadInput("this job asks nothing now", remedy="wait until it asks")
        text = text.strip("\r\n")
        if "\0" in text:
            raise BadInput("a line holds what no keyboard writes", found="NUL")
        if job.asks == "confirm":
            if text not in ("yes", "no"):
                raise BadInput("this is no answer", found=text[:50], allowed="yes or no")
            job.asks = None
            await job.tell("progress", to_json(job.brief()))
        process.stdin.write("".join(f"{line}\n" for line in text.splitlines() or [""]).encode())
        with contextlib.suppress(ConnectionError):
            await process.stdin.drain()

    async def end_all(self) -> None:
        """End every job, and wait for it."""
        under_way = [job for job in self._jobs.values() if not job.ended]
        for job in under_way:
            self.cancel(job)
        await asyncio.gather(*(job.task for job in under_way if job.task is not None), return_exceptions=True)

    def cancel(self, job: AppJob) -> None:
        """Ask a job to end as Ctrl-C does; what it has recorded stays. It is killed where it does not."""
        if job.ended or job.cancelled:
            return
        job.cancelled = True
        if job.process is None:
            return
        _interrupt(job.process)
        process = job.process
        asyncio.get_running_loop().call_later(_PATIENCE_S, lambda: _kill(process))

    async def _carry_out(self, job: AppJob, password: str | None) -> None:
        # Who measures does not wait until something is calculated.
        measures = job.command[0] == "run"
        try:
            async with contextlib.nullcontext() if measures else self._places:
                if not job.cancelled:
                    await self._run(job, password)
        except Exception as error:
            job.log.append(f"the command could not be carried out: {error}")
            job.state = "failed"
            raise
        finally:
            if not job.ended:
                job.state = "stopped" if job.cancelled else "failed"
            job.took_s = None if job.started_at is None else time.monotonic() - job.started_at
            await job.tell("end", to_json(job.whole()))

    async def _run(self, job: AppJob, password: str | None) -> None:
        job.state, job.started_at = "running", time.monotonic()
        job.time_left = TimeLeft(job.started_at)
        measures = job.command[0] == "run"
        secret = {} if password is None else {PASSWORD: password}
        job.process = process = await asyncio.create_subprocess_exec(
            *_COMMAND,
            *job.command,
            cwd=self.folder.root,
            env=os.environ | {PROGRESS: "lines", ATTENDED: "1", WITHIN: str(self.folder.root)} | secret,
            stdin=subprocess.PIPE,  # also what ends with the server, however that ends
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            limit=_LONGEST_LINE,
            start_new_session=True,  # Ctrl-C in the terminal is for the server, which tells its jobs
        )
        assert process.stdout is not None
        assert process.stderr is not None
        if job.cancelled:  # meanwhile
            _interrupt(process)
        answers = self._events(job, process.stdout) if measures else _answer(job, process.stdout)
        try:
            await asyncio.gather(answers, self._log(job, process.stderr))
            job.status = await process.wait()
        finally:
            _kill(process)
        # Python itself ends with 1 where it is interrupted before the command has begun.
        if job.status in (0, 1) and not (job.cancelled and job.answer is None):
            job.state = "done"
            if not measures:  # a run that is paused is not through
                job.share = 1.0
        else:
            job.state = "stopped" if job.cancelled else "failed"
        job.asks = None

    async def _events(self, job: AppJob, stream: asyncio.StreamReader) -> None:
        """The events of a run, a line each; the last is its answer."""
        under_way, done, of = False, 0, 1
        async for line in stream:
            try:
                event = json.loads(line)
            except ValueError:
                continue
            kind = event["event"]
            if kind == "begin":
                under_way, done, of = True, len(event["recorded"]), event["postures"]
                job.time_left = TimeLeft(time.monotonic(), done / of)
                if event["rig"] in ("manual", "live"):
                    job.asks = "lines"
                await asyncio.to_thread(self.runs.begin, job.command)
            elif kind == "confirm":
                job.asks = "confirm"
            elif kind == "end":
                job.answer = event
                left = (
                    set(range(of)) - set(event["shots"]) - {refusal["shot"] for refusal in event["refused"]}
                )
                if not left or event["why"] is not None:
                    await asyncio.to_thread(self.runs.end, job.command)
            done += {"recorded": 1, "refused": 1, "withdrawn": -1}.get(kind, 0)
            if under_way:
                job.share = min(1.0, done / of)
                job.time_left.advanced(time.monotonic(), job.share)
            if kind == "end":
                event = event | {"action": await asyncio.to_thread(self._offered, job, event)}
            await job.tell("run", event)
            if kind in ("begin", "confirm", "recorded", "refused", "withdrawn"):
                await job.tell("progress", to_json(job.brief()))

    def _offered(self, job: AppJob, event: Mapping[str, Any]) -> Any:
        """The button of a run's message: its command as the app's folder calls the files."""
        action = Action(**event["message"]["action"])
        run = self.folder.inside(run_file(job.command))
        return to_json(action_of_result(self.folder, action, run, analysed=False))

    async def _log(self, job: AppJob, stream: asyncio.StreamReader) -> None:
        """What a command says on standard error: progress, or a line for the log."""
        async for raw in stream:
            line = self.folder.without(raw.decode("utf-8", "replace").rstrip("\n"))
            event = _progress(line)
            if event is None:
                job.log.append(line[:2000])
                await job.tell("log", line[:2000])
            else:
                job.share, job.stage = max(job.share, event[0]), event[1]
                job.time_left.advanced(time.monotonic(), job.share)
                await job.tell("progress", to_json(job.brief()))


async def _answer(job: AppJob, stream: asyncio.StreamReader) -> None:
    """What a command prints: JSON, or lines for the log."""
    parts, size = [], 0
    while part := await stream.read(2**16):
        size += len(part)
        if size <= LARGEST_ANSWER:
            parts.append(part)
    text = b"".join(parts).decode("utf-8", "replace")
    try:
        job.answer = json.loads(text) if text.strip() and size <= LARGEST_ANSWER else None
        if job.command[0] == "analyse" and job.answer is not None:
            job.front = first_page(parse_result(text))
    except ValueError:
        job.log.extend(text.splitlines())


def _progress(line: str) -> tuple[float, str] | None:
    if not line.startswith('{"progress": '):
        return None
    try:
        event = json.loads(line)
        return float(event["progress"]), str(event["stage"])
    except (ValueError, KeyError, TypeError):
        return None


def _interrupt(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        if sys.platform == "win32":
            process.terminate()
        else:
            process.send_signal(signal.SIGINT)


def _kill(process: asyncio.subprocess.Process) -> None:
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
