"""The server of a folder, and how errors are said: its page at once, all else as soon as it is loaded."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from ...model.errors import BadInput, ZerobeamError
from ...model.records import to_json
from .folder import Folder
from .guard import Access, Guard, refusal
from .page import PageFiles
from .requests import error_answer
from .versions import Conflict, ConflictAnswer

if TYPE_CHECKING:
    from .routes import EndPoints


def application(folder: Folder, access: Access) -> Starlette:
    """The server of one folder."""
    page, loading = PageFiles(), _Loading(folder, access)

    async def refuse(request: Request, error: Exception) -> Response:
        assert isinstance(error, ZerobeamError)
        answer = error_answer(error, folder.without)
        if isinstance(error, Conflict):
            conflict = ConflictAnswer(error=answer.error, current=error.current)
            return JSONResponse(to_json(conflict), status_code=412)
        return JSONResponse(to_json(answer), status_code=400 if isinstance(error, BadInput) else 422)

    return Starlette(
        routes=[Route("/", page.answer), Route("/page/{path:path}", page.answer)],
        lifespan=loading.lifespan,
        middleware=[Middleware(Guard, access=access), Middleware(_Awaiting, loading=loading)],
        exception_handlers={
            ZerobeamError: refuse,
            HTTPException: _no_answer,
            ClientDisconnect: _gone,
            Exception: _fault,
        },
    )


class _Loading:
    """The end points of a folder: a thread imports them (a second) while the browser fetches the page."""

    def __init__(self, folder: Folder, access: Access) -> None:
        self.folder, self.access = folder, access

    @asynccontextmanager
    async def lifespan(self, app: Starlette) -> AsyncIterator[None]:
        self.loaded = asyncio.create_task(self._load(app))
        try:
            yield
        finally:
            await (await self.loaded).end()

    async def _load(self, app: Starlette) -> EndPoints:
        end_points = await asyncio.to_thread(self._imported)
        app.routes.extend(end_points.routes())
        return end_points

    def _imported(self) -> EndPoints:
        from .routes import EndPoints

        return EndPoints(self.folder, self.access)


class _Awaiting:
    """ASGI middleware: what is not of the page waits until the end points are loaded."""

    def __init__(self, app: ASGIApp, loading: _Loading) -> None:
        self.app, self.loading = app, loading

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["path"] != "/" and not scope["path"].startswith("/page/"):
            await asyncio.shield(self.loading.loaded)  # who asks may go, the others still wait
        await self.app(scope, receive, send)


async def _no_answer(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 400
    sentences = {404: "there is nothing of this name", 405: "this cannot be done here"}
    return refusal(status, sentences.get(status, "the request is not understood"))


async def _gone(request: Request, error: Exception) -> Response:
    return refusal(400, "the connection was closed")


async def _fault(request: Request, error: Exception) -> Response:
    traceback.print_exception(error)
    return refusal(
        500, "this is a fault of zerobeam itself", to_do="please report it, with what the terminal says"
    )
