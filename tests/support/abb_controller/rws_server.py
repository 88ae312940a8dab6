"""Robot Web Services 1.0 over HTTP: sessions, the limit of requests, the resources, XHTML and JSON.

Facts from the manual (3HAC050973-001) and from what RobotWare 6.16 was seen to answer: digest
authentication, then the session is known by the cookies `-http-session-` and `ABBCX`; at most 70 sessions,
which end when they have been idle for 5 minutes; more than 20 requests a second are answered by 503.
`?json=1` asks for JSON.
"""

import hashlib
import hmac
import json
import re
import secrets
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import BaseServer, TCPServer
from typing import Any
from urllib.parse import parse_qsl, urlsplit
from urllib.request import parse_http_list, parse_keqv_list
from xml.sax.saxutils import escape, quoteattr

from abb_controller.irc5 import (
    DOMAINS,
    INVALID_ARGUMENT,
    MODULE,
    NO_SUCH_RESOURCE,
    NO_SUCH_SIGNAL,
    NO_SUCH_SYMBOL,
    Irc5,
    RequestRefused,
    number_text,
)


class QuietServer(BaseServer):
    """A connection that is reset, or that ends amid an answer, is closed, and nothing is said of it."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


TASK, UNIT = "T_ROB1", "ROB_1"
_SYMBOL = "rw/rapid/symbol/data/RAPID/"
_SIGNAL = "rw/iosystem/signals/"
_DEVICE = "Local/DRV_1/"


@dataclass(frozen=True)
class RwsRequest:
    """`path` has no slash at either end; `action` is that of the URL, `form` what was posted."""

    method: str
    path: str
    action: str
    form: dict[str, str]
    session: str


@dataclass(frozen=True)
class ResourceState:
    """An item of an answer."""

    kind: str
    title: str
    values: dict[str, str]


def answer(controller: Irc5, request: RwsRequest) -> tuple[ResourceState, ...] | None:
    """The items of the answer, None where there is nothing to say (204). Raises RequestRefused."""
    if request.method == "GET":
        return _states_of(controller, request)
    _do(controller, request)
    return None


def _states_of(controller: Irc5, request: RwsRequest) -> tuple[ResourceState, ...]:
    path = request.path
    if path == "ctrl/identity":
        # What distinguishes it from a real one, as for any virtual controller.
        values = {"ctrl-name": "zerobeam", "ctrl-type": "Virtual Controller"}
        return (ResourceState("ctrl-identity-info", "identity", values),)
    if path == "rw/panel/ctrlstate":
        return (ResourceState("pnl-ctrlstate", "ctrlstate", {"ctrlstate": controller.state}),)
    if path == "rw/panel/opmode":
        return (ResourceState("pnl-opmode", "opmode", {"opmode": controller.mode}),)
    if path == "rw/panel/speedratio":
        return (ResourceState("pnl-speedratio", "speedratio", {"speedratio": str(controller.speed_ratio)}),)
    if path == f"rw/motionsystem/mechunits/{UNIT}/jointtarget":
        axes = {f"rax_{i}": number_text(v, 7) for i, v in enumerate(controller.joints_deg(), start=1)}
        return (
            ResourceState("ms-jointtarget", UNIT, {**axes, **{f"eax_{letter}": "0" for letter in "abcdef"}}),
        )
    if path == "rw/rapid/execution":
        values = {"ctrlexecstate": controller.execution, "cycle": controller.cycle_mode}
        return (ResourceState("rap-execution", "execution", values),)
    if path == "rw/rapid/tasks":
        values = {
            "name": TASK,
            "type": "norm",
            "taskstate": "linked",
            "excstate": "started" if controller.running else "stopped",
            "active": "On",
            "motiontask": "TRUE",
        }
        return (ResourceState("rap-task-li", TASK, values),)
    if path.startswith(_SYMBOL):
        name = _symbol(controller, path)
        return (
            ResourceState("rap-data", f"RAPID/{TASK}/{MODULE}/{name}", {"value": controller.data.text(name)}),
        )
    if path.startswith(_SIGNAL):
        name = _signal(controller, path)
        values = {"name": name, "type": "DO", "category": "", "lvalue": str(controller.signals[name])}
        return (
            ResourceState("ios-signal", path.removeprefix(_SIGNAL), {**values, "lstate": "not simulated"}),
        )
    if path == "users/rmmp/poll":
        return (ResourceState("user-rmmp-poll", "state", _privilege(controller, request.session)),)
    domains = _domains(path)
    return tuple(
        ResourceState("msh-resource", domain, _mastership(controller, domain, request.session))
        for domain in domains
    )


def _do(controller: Irc5, request: RwsRequest) -> None:
    path, action, form = request.path, request.action, request.form
    if path == "rw/panel/ctrlstate":
        _require(action == "setctrlstate", action)
        controller.set_state(form.get("ctrl-state", ""))
    elif path == "rw/panel/speedratio":
        _require(action == "setspeedratio", action)
        controller.set_speed_ratio(form.get("speed-ratio", ""))
    elif path == "rw/rapid/execution":
        if action == "start":
            controller.start(form.get("cycle", ""), request.session)
        elif action == "stop":
            controller.stop()
        else:
            _require(action == "resetpp", action)
            controller.reset_program_pointer(request.session)
    elif path.startswith(_SYMBOL):
        name = _symbol(controller, path)
        _require(action == "set" and "value" in form, action)
        controller.write(name, form["value"], request.session)
    elif path.startswith(_SIGNAL):
        name = _signal(controller, path)
        _require(action == "set", action)
        controller.set_signal(name, form.get("lvalue", ""), request.session)
    elif path == "users/rmmp":
        _require(form.get("privilege") == "modify", "privilege")
        # False: asked for, and the person at the pendant has not said yes.
        controller.remote.setdefault(request.session, False)
    else:
        domains = _domains(path)
        _require(action in ("request", "release"), action)
        (controller.request if action == "request" else controller.release)(domains, request.session)


def _require(fine: bool, value: str) -> None:
    if not fine:
        raise RequestRefused(INVALID_ARGUMENT, value[:80])


def _symbol(controller: Irc5, path: str) -> str:
    """RAPID ignores case."""
    parts = path.removeprefix(_SYMBOL).lower().split("/")
    if parts[:-1] != [TASK.lower(), MODULE] or parts[-1] not in controller.data:
        raise RequestRefused(NO_SUCH_SYMBOL)
    return parts[-1]


def _signal(controller: Irc5, path: str) -> str:
    name = path.removeprefix(_SIGNAL).removeprefix(_DEVICE)
    if name not in controller.signals:
        raise RequestRefused(NO_SUCH_SIGNAL)
    return name


def _privilege(controller: Irc5, session: str) -> dict[str, str]:
    if session not in controller.remote:
        return {"code": "-1073445870", "status": "NO SUCH REQUEST"}
    if controller.remote[session]:
        return {"code": "294915", "status": "GRANTED"}
    return {"code": "294914", "status": "PENDING"}


def _domains(path: str) -> tuple[str, ...]:
    """The domains of mastership that a path names: one, or all."""
    match = re.fullmatch(r"rw/mastership(?:/(\w+))?", path)
    if match is None or (match[1] is not None and match[1] not in DOMAINS):
        raise RequestRefused(NO_SUCH_RESOURCE)
    return DOMAINS if match[1] is None else (match[1],)


def _mastership(controller: Irc5, domain: str, session: str) -> dict[str, str]:
    holder = controller.masters.get(domain)
    return {
        "uid": "0" if holder is None else holder.split(":", 1)[0],
        "application": "" if holder is None else "RobAPI2-Client",
        "mastership": "nomaster" if holder is None else "remote",
        "mastershipheldbyme": "TRUE" if holder == session else "FALSE",
    }


REQUESTS_A_SECOND = 20
_SESSIONS = 70
_IDLE_S = 300.0
_LARGEST_BODY = 1 << 20
_UNAVAILABLE = "<html><body>Service Unavailable</body></html>"
_SESSION, _CLIENT = "-http-session-", "ABBCX"


@dataclass
class _Session:
    name: str
    number: int
    used: float


class SessionGate:
    """Authentication by digest, the sessions and the limit of their requests. Times are seconds."""

    def __init__(self, users: dict[str, str], left: Callable[[str], None], requests_a_second: int) -> None:
        self._digest, self._left, self._most = Digest(users), left, requests_a_second
        self._sessions: dict[str, _Session] = {}
        self._number = 0
        self._times: deque[float] = deque()
        self._lock = threading.Lock()

    def busy(self, now: float) -> bool:
        """Count a request; whether it is one too many."""
        with self._lock:
            while self._times and self._times[0] <= now - 1.0:
                self._times.popleft()
            if len(self._times) >= self._most:
                return True
            self._times.append(now)
            return False

    def known(self, cookies: str, now: float) -> str | None:
        """The session that the cookies name, if it is one."""
        try:
            morsel = SimpleCookie(cookies).get(_SESSION)
        except CookieError:
            return None
        with self._lock:
            for old in [s for s in self._sessions.values() if now - s.used > _IDLE_S]:
                self._end(old.name)
            session = self._sessions.get(morsel.value) if morsel is not None else None
            if session is None:
                return None
            session.used = now
            return session.name

    def opened(self, authorization: str, method: str, uri: str, now: float) -> _Session | None:
        """A new session for whoever knows a password."""
        with self._lock:
            if not self._digest.admits(authorization, method, uri):
                return None
            self._number += 1
            session = _Session(f"{self._number}::http.session::{secrets.token_hex(16)}", self._number, now)
            self._sessions[session.name] = session
            return session

    def challenge(self) -> str:
        with self._lock:
            return self._digest.challenge()

    @property
    def full(self) -> bool:
        return len(self._sessions) >= _SESSIONS

    def leave(self, name: str) -> None:
        with self._lock:
            self._end(name)

    def _end(self, name: str) -> None:
        self._sessions.pop(name, None)
        self._left(name)


class RwsServer(QuietServer, ThreadingHTTPServer):
    """Answers for a controller; `plugged` is cleared while its cable is out."""

    daemon_threads = True

    def __init__(
        self, address: tuple[str, int], controller: Irc5, users: dict[str, str], requests_a_second: int
    ) -> None:
        self.controller = controller
        self.plugged = threading.Event()
        self.plugged.set()
        self.gate = SessionGate(users, self._left, requests_a_second)
        super().__init__(address, _RwsHandler)

    def server_bind(self) -> None:
        TCPServer.server_bind(self)  # HTTPServer's would ask the name service for its own name

    def _left(self, session: str) -> None:
        with self.controller.lock:
            self.controller.leave(session)


class _RwsHandler(BaseHTTPRequestHandler):
    server: RwsServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "Appweb", ""
    # One packet an answer: two small ones would wait for the client's acknowledgement of the first.
    wbufsize = -1
    disable_nagle_algorithm = True
    timeout = 30

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: what a client asks for is not for the terminal."""

    def do_GET(self) -> None:
        body = self._body()
        try:
            urlsplit(self.path)
        except ValueError:
            self._send(400, "text/html", "<html><body>Bad Request</body></html>")
            return
        self.server.plugged.wait()
        gate, now = self.server.gate, time.monotonic()
        if gate.busy(now):
            self._send(503, "text/html", _UNAVAILABLE)
            return
        session = gate.known(self.headers.get("Cookie", ""), now)
        cookies: tuple[str, ...] = ()
        if session is None and gate.full:
            self._send(503, "text/html", _UNAVAILABLE)
            return
        if session is None:
            opened = gate.opened(self.headers.get("Authorization", ""), self.command, self.path, now)
            if opened is None:
                self._send(
                    401,
                    "text/html",
                    "<html><body>Unauthorized</body></html>",
                    ("WWW-Authenticate", gate.challenge()),
                )
                return
            session = opened.name
            cookies = (f"{_SESSION}={session}", f"{_CLIENT}={opened.number}")
        self._answer(session, body, [("Set-Cookie", f"{cookie}; path=/; httponly") for cookie in cookies])

    do_POST = do_GET

    def _answer(self, session: str, body: str, headers: list[tuple[str, str]]) -> None:
        url = urlsplit(self.path)
        query = dict(parse_qsl(url.query, keep_blank_values=True))
        form = dict(parse_qsl(body, keep_blank_values=True))
        request = RwsRequest(self.command, url.path.strip("/"), query.get("action", ""), form, session)
        as_json = query.get("json") == "1"
        if request.path == "logout":
            self.server.gate.leave(session)
            self._send(204, None, "", *headers)
            return
        states: tuple[ResourceState, ...] | None = ()
        status = 200
        error: RequestRefused | None = None
        try:
            with self.server.controller.lock:
                states = answer(self.server.controller, request)
        except RequestRefused as refused:
            status, error = refused.code.status, refused
        if states is None:
            self._send(204, None, "", *headers)
            return
        host = self.headers.get("Host", "")
        if as_json:
            self._send(status, "application/json", _json(host, states, error), *headers)
        else:
            self._send(status, "application/xhtml+xml", _xhtml(host, request.path, states, error), *headers)

    def _body(self) -> str:
        try:
            length = int(self.headers.get("Content-Length", "0"))
        except ValueError:
            length = 0
        return self.rfile.read(min(max(length, 0), _LARGEST_BODY)).decode("utf-8", "replace")

    def _send(self, status: int, kind: str | None, text: str, *headers: tuple[str, str]) -> None:
        body = text.encode()
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        if kind is not None:
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def _json(host: str, states: tuple[ResourceState, ...], error: RequestRefused | None) -> str:
    embedded: dict[str, Any] = {}
    if error is not None:
        embedded["status"] = {"code": error.code.number, "msg": error.message}
    embedded["_state"] = [{"_type": s.kind, "_title": s.title, **s.values} for s in states]
    return json.dumps({"_links": {"base": {"href": f"http://{host}/"}}, "_embedded": embedded})


def _xhtml(host: str, path: str, states: tuple[ResourceState, ...], error: RequestRefused | None) -> str:
    if error is not None:
        spans = _spans({"code": str(error.code.number), "msg": error.message})
        content = f'<div class="status">{spans}</div>'
    else:
        items = "".join(
            f"<li class={quoteattr(s.kind)} title={quoteattr(s.title)}>{_spans(s.values)}</li>"
            for s in states
        )
        content = f'<div class="state"><a href="" rel="self"/><ul>{items}</ul></div>'
    base = quoteattr(f"http://{host}/{path}/")
    return (
        '<?xml version="1.0" encoding="UTF-8"?><html xmlns="http://www.w3.org/1999/xhtml">'
        f"<head><title>{escape(path)}</title><base href={base}/></head><body>{content}</body></html>"
    )


def _spans(values: dict[str, str]) -> str:
    return "".join(f"<span class={quoteattr(name)}>{escape(value)}</span>" for name, value in values.items())


REALM = "validusers@robapi.abb"
_OPAQUE = "799d5"
_NONCES = 1000  # known at a time: the oldest is forgotten


class Digest:
    """HTTP digest authentication, the server's side: RFC 7616 with MD5 and qop=auth; passwords by user."""

    def __init__(self, users: dict[str, str]) -> None:
        self._users = dict(users)
        self._counts: dict[str, int] = {}  # of every nonce that was given: the largest count it was used with

    def challenge(self) -> str:
        """The value of WWW-Authenticate, with a new nonce."""
        nonce = secrets.token_hex(16)
        self._counts[nonce] = 0
        if len(self._counts) > _NONCES:
            del self._counts[next(iter(self._counts))]
        return (
            f'Digest realm="{REALM}", domain="/", qop="auth", nonce="{nonce}", opaque="{_OPAQUE}", '
            'algorithm="MD5", stale="FALSE"'
        )

    def admits(self, authorization: str, method: str, uri: str) -> bool:
        """Whether the value of Authorization shows that the client knows a password."""
        scheme, _, rest = authorization.partition(" ")
        if scheme.lower() != "digest":
            return False
        try:
            fields = parse_keqv_list(parse_http_list(rest))
            count = int(fields["nc"], 16)
            user, nonce, client, response = (
                fields[key] for key in ("username", "nonce", "cnonce", "response")
            )
        except (KeyError, ValueError):
            return False
        known = user in self._users and fields.get("realm") == REALM and fields.get("uri") == uri
        # A count that was there before is a request overheard and sent again.
        if not known or fields.get("qop") != "auth" or count <= self._counts.get(nonce, count):
            return False
        secret = _md5(f"{user}:{REALM}:{self._users[user]}")
        expected = _md5(f"{secret}:{nonce}:{fields['nc']}:{client}:auth:{_md5(f'{method}:{uri}')}")
        if not hmac.compare_digest(expected.encode(), response.encode()):  # of str it takes ASCII alone
            return False
        self._counts[nonce] = count
        return True


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()
