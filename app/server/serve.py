"""The application with its page, and its process: it listens, says where, and ends with Ctrl-C."""

from __future__ import annotations

import asyncio
import atexit
import html
import ipaddress
import json
import os
import posixpath
import re
import socket
import sys
import threading
import traceback
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import h11
import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from ...model.errors import BadInput, ZerobeamError
from ...model.records import to_json
from ...reports.output.html import TEMPLATES, sheet
from ...reports.style import theme
from .guard import Access, Guard, page_policy, refusal
from .index import Folder
from .requests import error_answer
from .versions import Conflict, ConflictAnswer, etag, matches, version_of_bytes

_PAGE = Path(__file__).parents[1] / "page"
_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
    ".png": "image/png",
    ".woff2": "font/woff2",
}
_SHEET = re.compile(rb'<link rel="stylesheet" href="/page/([^"]+)">\n')
_MAP = re.compile(rb'<script type="importmap">(.*?)</script>\n')
_IMPORT = re.compile(rb'\bfrom\s*"([^"]+)"')
_INDEX, _FIRST, _SHEETS = "index.html", "main.js", "sheets.css"


class PageFiles:
    """Its files below /page: nothing else is ever sent from there."""

    def __init__(self) -> None:
        files = page_files()
        self.files = {name: (content, version_of_bytes(content)) for name, content in files.items()}
        self.policy = page_policy(files[_INDEX])

    async def answer(self, request: Request) -> Response:
        """A file, or the page itself where none is named."""
        name = request.path_params.get("path", _INDEX)
        if name not in self.files:
            return refusal(404, "the page has no such file")
        content, version = self.files[name]
        headers = {"etag": etag(version), "cache-control": "no-cache"}
        if name == _INDEX:
            headers["content-security-policy"] = self.policy
        if matches(request.headers.get("if-none-match", ""), version):
            return Response(status_code=304, headers=headers)
        return Response(content, media_type=_TYPES[Path(name).suffix], headers=headers)


def page_files() -> dict[str, bytes]:
    """What the page consists of, by its name below /page.

    Its own files, with all style sheets in one; of the reports the theme, the style sheet and how arms
    and instruments are drawn. The head names every module that is loaded at first.
    """
    files = {
        path.relative_to(_PAGE).as_posix(): path
        for path in _PAGE.rglob("*")
        if path.is_file() and path.suffix in _TYPES
    }
    fonts = {f"fonts/{path.name}": path for path in theme.FOLDER.glob("*.woff2")}
    drawing = {f"scene/{path.name}": path for path in (TEMPLATES / "drawing").glob("*.js")}
    read = {name: path.read_bytes() for name, path in (files | fonts | drawing).items()}
    read["report.css"] = sheet().encode()
    index = read[_INDEX]
    read[_SHEETS] = b"\n".join(read[name.decode()] for name in _SHEET.findall(index))
    links = [f'<link rel="stylesheet" href="/page/{_SHEETS}">']
    links += [f'<link rel="modulepreload" href="/page/{name}">' for name in _loaded_first(read)]
    head = _SHEET.sub(b"", index)
    end = _import_map(head).end()
    return read | {_INDEX: head[:end] + "\n".join([*links, ""]).encode() + head[end:]}


def _import_map(index: bytes) -> re.Match[bytes]:
    matched = _MAP.search(index)
    assert matched is not None
    return matched


def _loaded_first(files: dict[str, bytes]) -> list[str]:
    """The modules that the first one imports, and those that these do."""
    addresses: dict[str, str] = json.loads(_import_map(files[_INDEX])[1])["imports"]
    names = [_FIRST]
    for name in names:  # which grows meanwhile
        for imported in map(bytes.decode, _IMPORT.findall(files[name])):
            path = addresses.get(imported, posixpath.join(f"/page/{posixpath.dirname(name)}", imported))
            module = posixpath.normpath(path).removeprefix("/page/")
            if module in files and module not in names:
                names.append(module)
    return names[1:]


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


MOST_CONNECTIONS = 500  # more are told to come later
PATIENCE_S = 10.0  # for the head of a request
_BESIDE_S = 30.0  # until a server of a notebook answers, or has ended


def serve(root: Path, host: str | None, port: int, announce: Callable[[str], None]) -> None:
    """Serve the app of a folder until the process is asked to end; then KeyboardInterrupt.

    `announce` is given the address, with the token, as soon as it answers. `host` None: this machine alone.
    """
    folder = Folder(root)
    access = Access() if host is None else Access(host)
    with listening(access.host, port) as open_socket:
        address = _address(access, open_socket)
        _AnnouncingServer(_config(folder, access), lambda: announce(address)).run([open_socket])


def serve_beside(root: Path) -> str:
    """Serve the app of a folder from a thread of this process, for its notebook: the address, with the token.

    It ends with the process, and its jobs with it.
    """
    from . import routes  # noqa: F401  now: not by a thread beside what the notebook imports next

    folder, access, answers = Folder(root), Access(framed=True), threading.Event()
    open_socket = listening(access.host, 0)
    server = _AnnouncingServer(_config(folder, access), answers.set)
    thread = threading.Thread(target=server.run, args=([open_socket],), name="zerobeam app", daemon=True)
    thread.start()

    def end() -> None:
        server.should_exit = True
        thread.join(_BESIDE_S)
        open_socket.close()

    atexit.register(end)
    if not answers.wait(_BESIDE_S):
        raise ZerobeamError("the server of the app did not start")
    return _address(access, open_socket)


def _address(access: Access, open_socket: socket.socket) -> str:
    host = f"[{access.host}]" if ":" in access.host else access.host
    return f"http://{host}:{open_socket.getsockname()[1]}/?token={access.token}"


def _config(folder: Folder, access: Access) -> uvicorn.Config:
    return uvicorn.Config(
        application(folder, access),
        http=_Impatient,
        ws="none",
        loop="asyncio",
        log_level="critical",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        limit_concurrency=MOST_CONNECTIONS,
        timeout_graceful_shutdown=1,
    )


class _Impatient(H11Protocol):
    """Hangs up where the head of a request does not come soon: who stays silent would keep others out."""

    _waiting: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._forget()
        elif self._waiting is None:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        self._forget()
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._waiting = self.loop.call_later(PATIENCE_S, self.transport.close)

    def _forget(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
        self._waiting = None


class _AnnouncingServer(uvicorn.Server):
    """Says when it answers."""

    def __init__(self, config: uvicorn.Config, announce: Callable[[], None]) -> None:
        super().__init__(config)
        self._announce = announce

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._announce()


def listening(host: str, port: int) -> socket.socket:
    """A socket at an address, which is free; BadInput where it is not."""
    try:
        family = socket.AF_INET6 if ipaddress.ip_address(host).version == 6 else socket.AF_INET
    except ValueError:
        family = socket.AF_INET
    # TCP by name: else asyncio leaves Nagle's algorithm on, and a body waits 40 ms for the ACK of its head.
    opened = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if (
            hasattr(socket, "SO_REUSEADDR")
            and socket.SO_REUSEADDR
            and not hasattr(socket, "SO_EXCLUSIVEADDRUSE")
        ):
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((host, port))
    except OSError as error:
        opened.close()
        raise BadInput(
            f"the app cannot listen at {host}, port {port}",
            found=error.strerror or str(error),
            remedy="another --port, or --port 0 for any that is free",
        ) from None
    return opened


_LEADS_ON = """<!doctype html>
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url={address}">
<title>zerobeam</title>
<p><a href="{address}">Open the app</a>, if it does not open by itself.</p>
"""


def leading_to(folder: Path, address: str) -> str:
    """The address of a file that leads to `address`: this user alone can read it; it goes with the process.

    It is in `.zerobeam` below the folder: browsers in a container of their own read no temporary folders. On
    Windows and macOS a browser is not given its address by a command line, and `address` is returned. OSError
    or BadInput where the file cannot be written.
    """
    if sys.platform in ("win32", "darwin"):
        return address
    file = Folder(folder).private(f"open-{urlsplit(address).port}.html")
    file.parent.mkdir(exist_ok=True)
    file.unlink(missing_ok=True)
    with os.fdopen(
        os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8"
    ) as opened:
        opened.write(_LEADS_ON.format(address=html.escape(address, quote=True)))
    atexit.register(file.unlink, missing_ok=True)
    return file.as_uri()
