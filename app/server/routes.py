"""The end points of the app, and their description (OpenAPI 3.1): what is asked for goes to `answers`, one at
a time."""

from __future__ import annotations

import asyncio
import functools
import inspect
import json
import zipfile
from collections.abc import Awaitable, Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal, Union
from urllib.parse import quote

from pydantic import BaseModel, BeforeValidator, Field, TypeAdapter
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route

from ...experiments.procedure.events import RunEvent
from ...model.errors import BadInput
from ...model.files.plan import PlanFile
from ...model.files.whole_file import write_whole
from ...model.parsing.confinement import confined
from ...model.parsing.reading import LARGEST_YAML, parse_json, read_text
from ...model.parsing.validation import as_tuple
from ...model.records import it
from ...words.sentences import to_json
from .answers import (  # noqa: F401 - each enters its end points
    calibrations,
    folder_runs,
    forms,
    home,
    imports,
    plans,
    posteriors,
    refits,
    results,
    robot_library,
)
from .answers.results import report_files
from .guard import LARGEST_BODY, SHOWN, Access, refusal
from .index import Folder, FolderFile, Index, kind_of, read_result
from .job_commands import job_command
from .jobs import JobBrief, Jobs, JobWhole
from .requests import END_POINTS, Arguments, EndPoint, ErrorAnswer, Precondition, end_point, require_plain
from .versions import ConflictAnswer, WrittenFile, etag, matches, replacing, version_of, version_of_bytes


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


_EVENTS: Any = Union[tuple(RunEvent.__subclasses__())]  # noqa: UP007 - of as many as there are
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
        returned=TypeAdapter(_EVENTS),
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


PATIENCE_S = 120.0  # for the body of a request
MOST_FILES = 2000  # listed
_SHOWN_TEXT = 10**6  # bytes
_ALONE = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline';"
    " img-src data:; font-src data:; frame-ancestors 'self'"
)


class EndPoints:
    """Their routes. The calculations have one thread: two at a time would take each twice as long."""

    def __init__(self, folder: Folder, access: Access) -> None:
        self.folder, self.access = folder, access
        self.jobs = Jobs(folder)
        self.turn = asyncio.Lock()
        self.apart = asyncio.Semaphore(2)
        self.uploads = asyncio.Semaphore(2)
        self.places = asyncio.Semaphore(16)  # of requests that are in memory whole
        self.thread = ThreadPoolExecutor(1, "calculation")

    def routes(self) -> list[Route]:
        """What is asked of the server, but for its page."""
        return [
            *(Route(point.path, self.calculation(point), methods=[point.method]) for point in END_POINTS),
            Route("/api/files", self.files),
            Route("/api/file", self.download),
            Route("/api/file", self.upload, methods=["PUT"]),
            Route("/api/archive", self.archive),
            Route("/report/{path:path}", self.report),
            Route(f"{SHOWN}{{ticket}}/{{path:path}}", self.shown),
            Route("/api/jobs/{id}/events", self.job_events),
            Route("/openapi.json", self.described),
        ]

    async def end(self) -> None:
        """The jobs end, and no calculation begins any more."""
        await self.jobs.end_all()
        self.thread.shutdown(wait=False, cancel_futures=True)

    def calculation(self, point: EndPoint) -> Callable[[Request], Awaitable[Response]]:
        async def arguments(request: Request) -> Arguments:
            content = None if point.sent is None else await _content(request)
            named = {**request.query_params, **request.path_params}
            return point.arguments(named, content, request.headers)

        async def answered(request: Request) -> Response:
            if point.of is Jobs:  # nobody waits for what is calculated
                answer = point.answer(self.jobs, **await arguments(request))
                return _with_version(
                    to_json(await answer if inspect.isawaitable(answer) else answer), point.status
                )
            async with self.places:
                return await self._calculated(request, point, await arguments(request))

        return answered

    async def files(self, request: Request) -> Response:
        def listed() -> JSONResponse:
            return JSONResponse([to_json(file) for file in Index(self.folder).files[:MOST_FILES]])

        return _unless_known(request, await asyncio.to_thread(listed))

    async def download(self, request: Request) -> Response:
        path = self.folder.file(request.query_params.get("file", ""))
        version = await asyncio.to_thread(version_of, path)
        headers = {"etag": etag(version)}
        if matches(request.headers.get("if-none-match", ""), version):
            return Response(status_code=304, headers=headers)
        return FileResponse(path, media_type="application/octet-stream", filename=path.name, headers=headers)

    async def archive(self, request: Request) -> Response:
        """The files of a result's report as a zip archive."""
        path = self.folder.file(request.query_params.get("file", ""))
        await asyncio.to_thread(read_result, path)
        start, name = path.parent, path.parent.name if path.parent != self.folder.root else "report"
        files = [
            (report_file, f"{name}/{report_file.relative_to(start).as_posix()}")
            for report_file in report_files(path)
        ]
        disposition = f"attachment; filename*=utf-8''{quote(name)}.zip"
        headers = {"content-disposition": disposition}
        return StreamingResponse(archive(files), media_type="application/zip", headers=headers)

    async def upload(self, request: Request) -> Response:
        """A new file, or in place of one that is no run and no result; who comes while two are under way
        waits, for each is in memory until it is whole."""
        precondition = Precondition.of(request.headers)
        path = self.folder.inside(request.query_params.get("file", ""))
        there = path.exists()
        if there and (not path.is_file() or kind_of(path) in ("run", "result")):
            self.folder.new(self.folder.called(path))
        async with self.uploads:
            content = await _body(request, LARGEST_BODY)
            await asyncio.to_thread(self._replace, path, content, precondition)
        written = WrittenFile(file=self.folder.called(path), bytes=len(content), version=version_of(path))
        return JSONResponse(to_json(written), status_code=200 if there else 201)

    def _replace(self, path: Path, content: bytes, precondition: Precondition) -> None:
        with replacing(path, precondition, lambda: _text_of(path)) as force:
            write_whole(path, content, force=force)

    async def report(self, request: Request) -> Response:
        """The way to a page of the folder, with a ticket for the links in it."""
        name = self.folder.called(self.folder.file(request.path_params["path"]))
        return RedirectResponse(f"{SHOWN}{self.access.ticket(name)}/{quote(name)}", status_code=303)

    async def shown(self, request: Request) -> Response:
        """A page of the folder, alone in a sandbox: its scripts reach neither this page nor the server."""
        path = self.folder.file(request.path_params["path"])
        if not self.access.admits(request.path_params["ticket"], self.folder.called(path)):
            return refusal(403, "this page was not opened from the app", to_do="open it in the app")
        if path.suffix.lower() != ".html":
            return FileResponse(path, media_type="application/octet-stream", filename=path.name)
        return FileResponse(path, media_type="text/html", headers={"content-security-policy": _ALONE})

    async def job_events(self, request: Request) -> Response:
        job = self.jobs.of(request.path_params["id"])
        last = request.headers.get("last-event-id", "")
        after = int(last) if last.isdecimal() and len(last) < 12 else 0
        return StreamingResponse(job.events(after), media_type="text/event-stream")

    async def described(self, request: Request) -> Response:
        return JSONResponse(description())

    async def _calculated(self, request: Request, point: EndPoint, of: Arguments) -> Response:
        if inspect.iscoroutinefunction(point.answer):  # by a process of its own: nobody waits for it
            async with self.apart:
                return _with_version(to_json(await point.answer(self.folder, **of)), point.status)
        async with self.turn:
            if await request.is_disconnected():  # while others were answered: a page asks anew at every move
                raise ClientDisconnect
            loop = asyncio.get_running_loop()
            work = functools.partial(self._confined, point, of)
            return _with_version(await loop.run_in_executor(self.thread, work), point.status)

    def _confined(self, point: EndPoint, of: Arguments) -> Any:
        """The answer; files that files name are refused where they are not below the folder."""
        with confined(self.folder.root):
            return to_json(point.answer(self.folder, **of))


def _with_version(answer: Any, status: int) -> JSONResponse:
    """An answer, with the version of the file that it is made of as its ETag."""
    version = answer.get("version") if isinstance(answer, dict) else None
    headers = {} if version is None else {"etag": etag(version)}
    return JSONResponse(answer, status, headers)


def _unless_known(request: Request, answer: JSONResponse) -> Response:
    """The answer with its ETag; without a body where that is what the request has."""
    version = version_of_bytes(bytes(answer.body))
    answer.headers["etag"] = etag(version)
    if matches(request.headers.get("if-none-match", ""), version):
        return Response(status_code=304, headers={"etag": etag(version)})
    return answer


def _text_of(path: Path) -> str | None:
    """The text of a file that is shown beside another version of it; None of what is no text."""
    try:
        return read_text(path, _SHOWN_TEXT)[0]
    except BadInput:
        return None


async def _body(request: Request, largest: int) -> bytes:
    parts, size = [], 0
    try:
        async with asyncio.timeout(PATIENCE_S):
            async for part in request.stream():
                size += len(part)
                if size > largest:
                    raise BadInput("what was sent is too large", allowed=f"at most {largest // 10**6} MB")
                parts.append(part)
    except TimeoutError:
        raise BadInput("what was sent did not come to an end", allowed=f"{PATIENCE_S:.0f} s") from None
    return b"".join(parts)


async def _content(request: Request) -> Any:
    """The JSON that was sent: at most as long as a file of ours, numbers finite, each key once."""
    body = await _body(request, LARGEST_YAML)
    try:
        content = parse_json(body.decode("utf-8"), file=Path(), line=1)
        require_plain(content)
        return content
    except BadInput as error:
        raise error.restated(file=None, line=None) from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BadInput(f"what was sent is no JSON: {error}", allowed="JSON in UTF-8") from None


_PART = 2**18  # bytes read at once
_PACKED = {".html", ".json", ".jsonl", ".svg", ".csv"}  # by what is worth it; the others are packed already


def archive(files: Iterable[tuple[Path, str]]) -> Iterator[bytes]:
    """The bytes of a zip archive of files, each with its name in it; one that has gone is left out."""
    sink = _Sink()
    with zipfile.ZipFile(sink, "w") as whole:  # type: ignore[call-overload]
        for path, name in files:
            try:
                file = path.open("rb")
            except OSError:
                continue
            packed = zipfile.ZIP_DEFLATED if path.suffix.lower() in _PACKED else zipfile.ZIP_STORED
            with file:
                entry = zipfile.ZipInfo.from_file(path, name, strict_timestamps=False)
                entry.compress_type = packed
                with whole.open(entry, "w", force_zip64=True) as inside:
                    while part := file.read(_PART):
                        inside.write(part)
                        yield sink.taken()
            yield sink.taken()
    yield sink.taken()


class _Sink:
    """What a zip archive is written to: a stream that cannot go back."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def taken(self) -> bytes:
        """What was written since the last call."""
        parts, self._parts = self._parts, []
        return b"".join(parts)
