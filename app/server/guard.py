"""Who may ask: pages that were opened with the token, and programs that state it. In front of all end points.

Other accounts of this machine reach the server as well as its user does, so that no address is trusted.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...model.records import to_json
from .requests import ErrorAnswer, ErrorFacts

LARGEST_BODY = 64 * 10**6  # bytes
SHOWN = "/shown/"  # pages of the folder, by a ticket: a page in a sandbox sends no cookie with its links
_ALONE = "frame-ancestors 'self'"
_IN_NOTEBOOKS = (
    f"{_ALONE} http://localhost:* https://localhost:* http://127.0.0.1:* https://127.0.0.1:* vscode-webview:"
)
_POLICY = "default-src 'self'; base-uri 'none'; form-action 'self'; object-src 'none';"
_IMPORT_MAP = re.compile(rb"""<script type=(?:"importmap"|'importmap'|importmap)>(.*?)</script>""", re.DOTALL)
_HEADERS = {
    "content-security-policy": f"{_POLICY} {_ALONE}",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


# What a browser shows that has no token, or that of a server that has ended.
_CLOSED = Path(__file__).parents[1] / "page" / "closed.html"
_CLOSED_POLICY = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; {_ALONE}"


def page_policy(page: bytes) -> str:
    """The policy of a page: scripts are files of the server; its import maps, which must stand in the page,
    are let in by their hashes."""
    digests = (hashlib.sha256(inline).digest() for inline in _IMPORT_MAP.findall(page))
    hashes = "".join(f" 'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    return f"{_POLICY} script-src 'self'{hashes}; {_ALONE}"


class TooLarge(Exception):
    """The body of a request is longer than `LARGEST_BODY`."""


@dataclass(frozen=True)
class Access:
    """`host`: the address that is listened at; `token`: what a browser or program has to state; `framed`:
    whether a notebook of this machine may show the page within its own."""

    host: str = "127.0.0.1"
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)
    framed: bool = False

    def named(self, host: str) -> bool:
        """Whether a page of ours can have been asked for by this Host header.

        Another site's name that was made to lead here (DNS rebinding) cannot: an address is no name.
        """
        name = host.rpartition(":")[0] if _port(host) is not None else host
        name = name.removeprefix("[").removesuffix("]").lower()
        if name == "localhost":
            return True
        alone = _is_loopback(self.host)
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return not alone and name in {self.host.lower(), socket.gethostname().lower()}
        return address.is_loopback or not alone

    def knows(self, token: str) -> bool:
        """Whether this is the token."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    def ticket(self, page: str) -> str:
        """What lets a page of the app's folder be seen, and what its links lead to beside and below it: their
        requests have no cookie, since the page is in a sandbox. `page` is its path below the app's folder."""
        return self._signed(_scope(page))

    def admits(self, ticket: str, page: str) -> bool:
        """Whether a ticket, of this page or of one above it, lets it be seen."""
        scopes = {page, *(str(parent) for parent in PurePosixPath(page).parents)} - {"."}
        return any(hmac.compare_digest(ticket.encode(), self._signed(one).encode()) for one in scopes)

    def _signed(self, scope: str) -> str:
        return hmac.new(self.token.encode(), scope.encode(), hashlib.sha256).hexdigest()[:32]


def _scope(page: str) -> str:
    """The folder of a page; of a page that is not in one below the app's, the page alone."""
    parent = str(PurePosixPath(page).parent)
    return page if parent == "." else parent


def refusal(status: int, what: str, *, allowed: str | None = None, to_do: str | None = None) -> JSONResponse:
    """A refusal in the form of all errors."""
    answer = ErrorAnswer(error=ErrorFacts(what=what, allowed=allowed, to_do=to_do))
    return JSONResponse(to_json(answer), status_code=status)


class Guard:
    """ASGI middleware: refuses what no page of ours sends, and cuts off bodies that are too long."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self.app, self.access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        answering = False

        async def guarded(message: Message) -> None:
            nonlocal answering
            if message["type"] == "http.response.start":
                answering = True
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
                if self.access.framed:
                    policy = "content-security-policy"
                    headers[policy] = headers[policy].replace(_ALONE, _IN_NOTEBOOKS)
                for cookie in self._cookies(scope) if enters and answer is None else ():
                    headers.append("set-cookie", cookie)
            await send(message)

        enters = self._enters(scope)
        answer = self._refused(scope) or (None if enters else self._let_in(scope))
        if answer is not None:
            await answer(scope, receive, guarded)
            return
        try:
            await self.app(scope, _counted(receive), guarded)
        except TooLarge:
            if answering:
                raise
            await _too_large()(scope, receive, guarded)

    def _refused(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self.access.named(hosts[0]):
            return refusal(
                403, "this server does not answer to that name", allowed="localhost, or its address"
            )
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > LARGEST_BODY:
            return _too_large()
        if scope["path"].startswith("/api/") and headers.get("sec-fetch-site") in {"cross-site", "same-site"}:
            return refusal(403, "the request comes from a page of another site")
        if scope["method"] in {"GET", "HEAD"}:
            return None
        if headers.get("x-zerobeam") != "1":
            return refusal(403, "the request lacks the header X-Zerobeam: 1")
        origin = headers.get("origin")
        if origin is not None and origin != f"http://{hosts[0]}":
            return refusal(403, "the request comes from a page of another site")
        return None

    def _enters(self, scope: Scope) -> bool:
        """Whether the page is opened by an address with the token: its browser gets the cookie."""
        token = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return scope["path"] == "/" and scope["method"] == "GET" and self.access.knows(token)

    def _let_in(self, scope: Scope) -> Response | None:
        """None for who may go on: by the cookie, or a program by its header."""
        headers = Headers(scope=scope)
        kind, _, credential = headers.get("authorization", "").partition(" ")
        tokens = [
            *_values(headers.get("cookie", ""), _cookie(headers)),
            credential if kind == "Bearer" else "",
        ]
        if any(self.access.knows(token) for token in tokens):
            return None
        if scope["path"].startswith(SHOWN):  # the end point looks at the ticket
            return None
        if scope["method"] == "GET" and "text/html" in headers.get("accept", ""):
            policy = {"content-security-policy": _CLOSED_POLICY}
            return HTMLResponse(_CLOSED.read_bytes(), status_code=401, headers=policy)
        return refusal(401, "a token is needed", to_do="open the address that zerobeam app printed")

    def _cookies(self, scope: Scope) -> list[str]:
        cookie = f"{_cookie(Headers(scope=scope))}={self.access.token}; HttpOnly; Path=/"
        # A notebook may be at another name of this machine, which is another site: a cookie of its frames.
        framed = [f"{cookie}; SameSite=None; Secure; Partitioned"] if self.access.framed else []
        return [f"{cookie}; SameSite=Strict", *framed]


def _port(host: str) -> int | None:
    """The port in a Host header; None where it states none."""
    port = host.rpartition(":")[2]
    return int(port) if port.isascii() and port.isdigit() and len(port) < 6 and ":" in host else None


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _cookie(headers: Headers) -> str:
    """The cookie's name, by the port that is asked: browsers send a machine's cookies to all its ports."""
    return f"zerobeam-{_port(headers['host']) or 80}"


def _values(header: str, name: str) -> list[str]:
    """The values of a cookie; there may be several of one name."""
    pairs = (part.strip().partition("=") for part in header.split(";"))
    return [value for key, _, value in pairs if key == name]


def _too_large() -> Response:
    megabytes = LARGEST_BODY // 10**6
    answer = refusal(413, "what was sent is too large", allowed=f"at most {megabytes} MB")
    answer.headers["connection"] = "close"
    return answer


def _counted(receive: Receive) -> Callable[[], Any]:
    """The same messages; TooLarge as soon as they are too long together, whatever length was stated."""
    size = 0

    async def counted() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > LARGEST_BODY:
            raise TooLarge
        return message

    return counted
