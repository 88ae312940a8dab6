"""What is asked of jobs: commands that are carried out beside the answers."""

from __future__ import annotations

import asyncio
from typing import Annotated

from pydantic import BeforeValidator, Field

from ...model.parsing.validation import as_tuple
from ...model.records import it
from .job_commands import job_command
from .jobs import JobBrief, Jobs, JobWhole
from .requests import end_point


@end_point("GET /api/jobs", "The jobs, the newest first.")
def all_jobs(jobs: Jobs) -> list[JobBrief]:
    return [job.brief() for job in jobs.all()]


@end_point("POST /api/jobs", "Begins a command in a process of its own: its id.", status=201)
async def begin(
    jobs: Jobs,
    command: Annotated[
        tuple[str, ...],
        BeforeValidator(as_tuple),
        Field(min_length=1, max_length=100),
        it("a command as it is typed after `zerobeam`, word by word"),
    ],
    password: Annotated[
        str | None, Field(max_length=1000, repr=False), it("of an ABB controller; it is kept nowhere")
    ] = None,
) -> dict[str, str]:
    words = await asyncio.to_thread(job_command, jobs.folder, command)
    return {"id": str(jobs.begin(words, password).number)}


@end_point("GET /api/jobs/{id}", "A job: state, share, time left, log, exit status, answer.")
def whole(jobs: Jobs, id: str) -> JobWhole:
    return jobs.of(id).whole()


@end_point("DELETE /api/jobs/{id}", "Asks a job to end, as Ctrl-C does.")
def cancel(jobs: Jobs, id: str) -> JobBrief:
    job = jobs.of(id)
    jobs.cancel(job)
    return job.brief()


@end_point(
    "POST /api/jobs/{id}/line",
    "Answers a job that asks: joints or words of a run by hand, yes or no before a robot moves.",
)
async def line(
    jobs: Jobs, id: str, text: Annotated[str, Field(max_length=10_000), it("one line, or several")]
) -> JobBrief:
    job = jobs.of(id)
    await jobs.answer(job, text)
    return job.brief()
