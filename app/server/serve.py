"""The server as a process: it listens, says where, and ends with Ctrl-C."""

from __future__ import annotations

import asyncio
import atexit
import html
import ipaddress
import os
import socket
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from ...model.errors import BadInput, ZerobeamError
from .application import application
from .folder import Folder
from .guard import Access

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
