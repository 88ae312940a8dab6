"""Who may ask: this machine's own pages, or with `--host` who knows the token. In front of all end points."""

from __future__ import annotations

import hmac
import ipaddress
import socket
from collections.abc import Callable
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST_BODY = 64 * 10**6  # bytes
COOKIE = "zerobeam-token"
_ALONE = "frame-ancestors 'self'"
_IN_NOTEBOOKS = (
    f"{_ALONE} http://localhost:* https://localhost:* http://127.0.0.1:* https://127.0.0.1:* vscode-webview:"
)
_HEADERS = {
    "content-security-policy": "default-src 'self'; base-uri 'none'; form-action 'self'; object-src 'none';"
    f" {_ALONE}",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class TooLarge(Exception):
    """The body of a request is longer than `LARGEST_BODY`."""


@dataclass(frozen=True)
class Access:
    """`host`: the address that is listened at; `token`: what a browser has to know, None on loopback;
    `framed`: whether a notebook of this machine may show the page within its own."""

    host: str = "127.0.0.1"
    token: str | None = None
    framed: bool = False

    def named(self, host: str) -> bool:
        """Whether a page of ours can have been asked for by this Host header.

        Another site's name that was made to lead here (DNS rebinding) cannot: an address is no name.
        """
        name = (
            host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() and not host.endswith("]") else host
        )
        name = name.removeprefix("[").removesuffix("]").lower()
        if name == "localhost":
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return self.token is not None and name in {self.host.lower(), socket.gethostname().lower()}
        return address.is_loopback or self.token is not None


def refusal(status: int, what: str, *, allowed: str | None = None, to_do: str | None = None) -> JSONResponse:
    """A refusal in the form of all errors."""
    facts = {"what": what, "found": None, "allowed": allowed, "to_do": to_do, "key": None}
    return JSONResponse({"error": facts}, status_code=status)


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
        begun = False

        async def guarded(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
                if self.access.framed:
                    policy = "content-security-policy"
                    headers[policy] = headers[policy].replace(_ALONE, _IN_NOTEBOOKS)
            await send(message)

        answer = self._refused(scope) or self._let_in(scope)
        if answer is not None:
            await answer(scope, receive, guarded)
            return
        try:
            await self.app(scope, _counted(receive), guarded)
        except TooLarge:
            if begun:
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

    def _let_in(self, scope: Scope) -> Response | None:
        """None for who may go on; a token in the address becomes a cookie, without which nothing is said."""
        token = self.access.token
        if token is None or _same(_cookie(Headers(scope=scope).get("cookie", "")), token):
            return None
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if scope["path"] == "/" and scope["method"] == "GET" and _same(given, token):
            answer = RedirectResponse("/", status_code=303)
            answer.set_cookie(COOKIE, token, httponly=True, samesite="strict")
            return answer
        return refusal(401, "a token is needed", to_do="open the address that zerobeam app printed")


def _cookie(header: str) -> str:
    try:
        found = SimpleCookie(header).get(COOKIE)
    except CookieError:
        return ""
    return "" if found is None else found.value


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


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
