"""The end points of the app, and how errors are said: what is asked for goes to `answers`, one at a time."""

from __future__ import annotations

import asyncio
import functools
import json
import traceback
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from ...model.errors import BadInput, ZerobeamError
from ...model.files.reading import LARGEST_YAML, parse_json
from ...reports.output.template import TEMPLATES, sheet
from ...reports.style import typeface
from . import answers
from .asked import AskedCheck, AskedJob, AskedPlan, AskedRobot, asked, error_json, require_plain
from .folder import Folder
from .guard import Access, Guard, refusal
from .job_commands import job_command
from .jobs import Job, Jobs
from .openapi import description

Answer = TypeVar("Answer")

_PAGE = Path(__file__).parents[1] / "page"
_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".woff2": "font/woff2",
}


def application(folder: Folder, access: Access) -> Starlette:
    """The server of one folder."""
    server = _Server(folder)
    routes = [
        Route("/", server.page),
        Route("/page/{path:path}", server.page),
        Route("/api/robots", server.robots),
        Route("/api/robot", server.robot, methods=["POST"]),
        Route("/api/files", server.files),
        Route("/api/plan", server.plan),
        Route("/api/plan", server.write_plan, methods=["PUT"]),
        Route("/api/check", server.check, methods=["POST"]),
        Route("/api/jobs", server.jobs_told),
        Route("/api/jobs", server.begin_job, methods=["POST"]),
        Route("/api/jobs/{id}", server.job),
        Route("/api/jobs/{id}", server.end_job, methods=["DELETE"]),
        Route("/api/jobs/{id}/events", server.job_events),
        Route("/openapi.json", server.described),
    ]
    return Starlette(
        routes=routes,
        lifespan=server.lifespan,
        middleware=[Middleware(Guard, access=access)],
        exception_handlers={
            ZerobeamError: server.refuse,
            HTTPException: _no_answer,
            ClientDisconnect: _gone,
            Exception: _fault,
        },
    )


def page_files() -> dict[str, bytes]:
    """What the page consists of, by its name below /page: nothing else is ever sent from there.

    Its own files, and of the reports the typeface, the style sheet and the scene that can be turned.
    """
    own = {
        path.relative_to(_PAGE).as_posix(): path
        for path in _PAGE.rglob("*")
        if path.is_file() and path.suffix in _TYPES
    }
    fonts = {f"fonts/{path.name}": path for path in typeface.FOLDER.glob("*.woff2")}
    scene = {name: TEMPLATES / name for name in ("scene.js", "scene.css")}
    read = {name: path.read_bytes() for name, path in (own | fonts | scene).items()}
    return read | {"report.css": sheet().encode()}


class _Server:
    """The end points. The calculations have one thread: two at a time would take each twice as long."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self.page_files = page_files()
        self.jobs = Jobs(folder)
        self.turn = asyncio.Lock()
        self.thread = ThreadPoolExecutor(1, "calculation")

    async def page(self, request: Request) -> Response:
        name = request.path_params.get("path", "index.html")
        content = self.page_files.get(name)
        if content is None:
            return refusal(404, "the page has no such file")
        return Response(content, media_type=_TYPES[Path(name).suffix])

    async def robots(self, request: Request) -> Response:
        return JSONResponse(await self._calculated(request, answers.robots))

    async def robot(self, request: Request) -> Response:
        wanted = asked(AskedRobot, await _content(request))
        return JSONResponse(await self._calculated(request, answers.robot, self.folder, wanted))

    async def files(self, request: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self.folder.files))

    async def plan(self, request: Request) -> Response:
        name = request.query_params.get("file", "")
        return JSONResponse(await self._calculated(request, answers.plan, self.folder, name))

    async def write_plan(self, request: Request) -> Response:
        wanted = asked(AskedPlan, await _content(request))
        return JSONResponse(await self._calculated(request, answers.write, self.folder, wanted))

    async def check(self, request: Request) -> Response:
        wanted = asked(AskedCheck, await _content(request))
        return JSONResponse(await self._calculated(request, answers.check, self.folder, wanted))

    async def jobs_told(self, request: Request) -> Response:
        return JSONResponse([job.brief() for job in self.jobs.all()])

    async def begin_job(self, request: Request) -> Response:
        wanted = asked(AskedJob, await _content(request))
        job = self.jobs.begin(job_command(self.folder, wanted.command))
        return JSONResponse({"id": str(job.number)}, status_code=201)

    async def job(self, request: Request) -> Response:
        return JSONResponse(self._job(request).whole())

    async def end_job(self, request: Request) -> Response:
        job = self._job(request)
        self.jobs.cancel(job)
        return JSONResponse(job.brief())

    async def job_events(self, request: Request) -> Response:
        last = request.headers.get("last-event-id", "")
        after = int(last) if last.isdecimal() and len(last) < 12 else 0
        return StreamingResponse(self._job(request).events(after), media_type="text/event-stream")

    async def described(self, request: Request) -> Response:
        return JSONResponse(description())

    def _job(self, request: Request) -> Job:
        job = self.jobs.of(request.path_params["id"])
        if job is None:
            raise HTTPException(404)
        return job

    @asynccontextmanager
    async def lifespan(self, app: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            await self.jobs.end_all()
            self.thread.shutdown(wait=False, cancel_futures=True)

    async def refuse(self, request: Request, error: Exception) -> Response:
        assert isinstance(error, ZerobeamError)
        status = 400 if isinstance(error, BadInput) else 422
        return JSONResponse(error_json(error, self.folder.without), status_code=status)

    async def _calculated(self, request: Request, what: Callable[..., Answer], *of: Any) -> Answer:
        async with self.turn:
            if await request.is_disconnected():  # while others were answered: a page asks anew at every move
                raise ClientDisconnect
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(self.thread, functools.partial(what, *of))


async def _content(request: Request) -> Any:
    """The JSON that was sent: at most as long as a file of ours, numbers finite, each key once."""
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > LARGEST_YAML:
            raise BadInput(
                "what was sent is too large", allowed=f"at most {LARGEST_YAML // 10**6} MB of JSON"
            )
        parts.append(part)
    try:
        content = parse_json(b"".join(parts).decode("utf-8"), file=Path(), line=1)
        require_plain(content)
        return content
    except BadInput as error:
        raise BadInput(error.what, found=error.found, allowed=error.allowed, remedy=error.remedy) from None
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BadInput(f"what was sent is no JSON: {error}", allowed="JSON in UTF-8") from None


async def _no_answer(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 400
    said = {404: "there is nothing of this name", 405: "this cannot be done here"}
    return refusal(status, said.get(status, "the request is not understood"))


async def _gone(request: Request, error: Exception) -> Response:
    return refusal(400, "the connection was closed")


async def _fault(request: Request, error: Exception) -> Response:
    traceback.print_exception(error)
    return refusal(
        500, "this is a fault of zerobeam itself", to_do="please report it, with what the terminal says"
    )
