"""All end points, and their description (OpenAPI 3.1) for programs that ask them."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, Field, TypeAdapter

from ...model.files.plan import PlanFile
from ...model.parsing.validation import as_tuple
from ...model.records import it
from .answers import (  # noqa: F401 - each enters its end points
    calibrations,
    dragging,
    forms,
    home,
    imports,
    plans,
    posteriors,
    refits,
    results,
    robot_library,
    run_history,
    unfinished_runs,
)
from .index import FolderFile
from .job_commands import job_command
from .jobs import JobBrief, Jobs, JobWhole
from .requests import END_POINTS, ErrorAnswer, end_point
from .versions import ConflictAnswer, WrittenFile


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


_ID = {"name": "id", "in": "path", "required": True, "schema": {"type": "string"}}
_FILE = {"name": "file", "in": "query", "required": True, "schema": {"type": "string"}}
_IF_MATCH = {
    "name": "If-Match",
    "in": "header",
    "required": False,
    "description": "the version of the file that is replaced; a new file needs none",
    "schema": {"type": "string"},
}
_MADE = {("/api/file", "put")}
_MADE |= {(point.path, point.method.lower()) for point in END_POINTS if point.status == 201}
_CHANGES = {"name": "X-Zerobeam", "in": "header", "required": True, "schema": {"const": "1"}}
_REF = "#/components/schemas/{model}"
Schema = dict[str, Any]  # a part of an OpenAPI document


@dataclass(frozen=True)
class _Operation:
    """What may be asked of a path: what is sent, what comes back (None: no JSON)."""

    path: str
    method: str
    says: str
    sent: type[BaseModel] | None = None
    parameters: tuple[Schema, ...] = ()
    returned: TypeAdapter[Any] | None = None


_OTHERS = [
    _Operation("/api/files", "get", "The files below the folder.", returned=TypeAdapter(list[FolderFile])),
    _Operation("/api/file", "get", "A file, as it is.", parameters=(_FILE,)),
    _Operation(
        "/api/archive", "get", "A zip archive of the report that a result belongs to.", parameters=(_FILE,)
    ),
    _Operation(
        "/api/file",
        "put",
        "Writes a file as it is sent: a new one, or in place of one that is no run and no result.",
        parameters=(_FILE, _IF_MATCH),
        returned=TypeAdapter(WrittenFile),
    ),
    _Operation(
        "/api/jobs/{id}/events",
        "get",
        "Server-sent events of a job: progress, log, run, end; from behind Last-Event-ID.",
        parameters=(_ID,),
    ),
]


@cache
def description() -> Schema:
    """The OpenAPI document, made of the models that read what is sent and write what comes back."""
    queries = [
        (
            *({**_ID, "name": name} for name in point.in_path),
            *({**_FILE, "name": name} for name in point.query),
            *((_IF_MATCH,) if point.conditional else ()),
        )
        for point in END_POINTS
    ]
    operations = [
        _Operation(point.path, point.method.lower(), point.says, point.sent, query, point.returned)
        for point, query in zip(END_POINTS, queries, strict=True)
    ] + _OTHERS
    sent = {each.sent for each in operations if each.sent is not None} | {
        PlanFile,
        ErrorAnswer,
        ConflictAnswer,
    }
    adapters: list[tuple[str, Literal["validation"], TypeAdapter[Any]]] = [
        (model.__name__, "validation", TypeAdapter[Any](model))
        for model in sorted(sent, key=lambda model: model.__name__)
    ]
    adapters += [
        (f"{each.method} {each.path}", "validation", each.returned)
        for each in operations
        if each.returned is not None
    ]
    whole: Any = TypeAdapter.json_schemas(adapters, by_alias=True, ref_template=_REF)
    made, definitions = whole[0], whole[1].get("$defs", {})
    for definition in definitions.values():
        sent_plan = definition.get("properties", {}).get("plan", {})
        if sent_plan.get("type") == "object":  # the content of a plan file, which is checked as one
            definition["properties"]["plan"] = {"$ref": _REF.format(model="PlanFile")}
    paths: dict[str, Schema] = {}
    for each in operations:
        content = made.get((f"{each.method} {each.path}", "validation"), {})
        paths.setdefault(each.path, {})[each.method] = _described(each, content)
    return {
        "openapi": "3.1.0",
        "info": {"title": "zerobeam app", "version": version("zerobeam")},
        "paths": dict(sorted(paths.items())),
        "components": {"schemas": definitions},
    }


def _described(operation: _Operation, content: Schema) -> Schema:
    """An operation whose answer has the schema `content` (empty: none is stated)."""
    kind = "text/event-stream" if operation.path.endswith("/events") else "application/json"
    made = (operation.path, operation.method) in _MADE
    answer = {"description": operation.says, "content": {kind: {"schema": content} if content else {}}}
    refusal = {"description": "A refusal.", "content": _json_of(ErrorAnswer)}
    described: Schema = {
        "summary": operation.says,
        "parameters": [*operation.parameters, *([_CHANGES] if operation.method != "get" else [])],
        "responses": {"201" if made else "200": answer, "default": refusal},
    }
    if _IF_MATCH in operation.parameters:
        conflict = {"description": "The file is another version.", "content": _json_of(ConflictAnswer)}
        described["responses"]["412"] = conflict
    if operation.sent is not None:
        described["requestBody"] = {"required": True, "content": _json_of(operation.sent)}
    return described


def _json_of(model: type) -> Schema:
    return {"application/json": {"schema": {"$ref": _REF.format(model=model.__name__)}}}
