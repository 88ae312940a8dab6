"""The end points of the app: what is asked for goes to `answers`, one at a time."""

from __future__ import annotations

import asyncio
import functools
import inspect
import json
import zipfile
from collections.abc import Awaitable, Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route

from ...model.errors import BadInput
from ...model.files.whole_file import write_whole
from ...model.parsing.confinement import confined
from ...model.parsing.reading import LARGEST_YAML, parse_json, read_text
from ...words.sentences import to_json
from .answers.results import report_files
from .end_points import description
from .folder import Folder
from .guard import LARGEST_BODY, SHOWN, Access, refusal
from .index import Index, kind_of, read_result
from .jobs import Jobs
from .requests import END_POINTS, Arguments, EndPoint, Precondition, require_plain
from .versions import (
    WrittenFile,
    etag,
    matches,
    replacing,
    version_of,
    version_of_bytes,
)

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
