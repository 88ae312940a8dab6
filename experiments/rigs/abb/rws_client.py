"""Robot Web Services 1.0, at one address only, slowly enough, and with its refusals in words."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, TypeVar

from ....model.errors import RigFault, missing_extra
from ..transport import BoundedSocket
from .access import ControllerAccess

T = TypeVar("T")

# The controller refuses more than 20 requests a second (manual of Robot Web Services, 3HAC050973-001).
_SPACING_S = 1 / 15
_CONNECT_S, ANSWER_S = 2.0, 1.0
_BUSY_S = (0.2, 0.4, 0.8, 1.6)  # waits before a request that was refused with 503 is made again

# Return codes (same manual), in words and with what to do.
_REFUSALS = {
    -1073442809: "RAPID is not in a state for that; look at the event log of the FlexPendant",
    -1073445862: "another client holds the write access: release it there (RobotStudio: Release Write "
    "Access), or log the other client off",
    -1073445859: "this client has no write access: release that of another (RobotStudio: Release Write "
    "Access), or give this user the grants",
    -1073445860: "it is not allowed in this operating mode: turn the key to automatic and confirm on the "
    "FlexPendant",
    -1073445881: "the controller rejects it: is it in automatic, are the grants of this user wide enough, is "
    "another client at work?",
}
_NOT_FOUND = {-1073414146, -1073445866}
_CODE = re.compile(r'"code"\s*:\s*"?(-?\d+)|class="code">\s*(-?\d+)')


class _Busy(Exception):
    """503: too many requests or sessions."""


def require_extra() -> None:
    """BadInput with the command that installs it, where the extra is missing."""
    if find_spec("abb_robot_client") is None:
        raise missing_extra("the ABB rig", "abb")


class RwsSession:
    """Requests to one controller by the library's `RWS`; every way in which one fails is a RigFault.

    It is not safe for threads: the rig asks from one only.
    """

    def __init__(self, access: ControllerAccess) -> None:
        require_extra()
        import requests
        from abb_robot_client import rws

        base = f"http://{access.address}:{access.port}"
        self._requests, self._error = requests, rws.ABBException
        self._rws = rws.RWS(base, access.user, access.password.reveal())
        session = self._rws._session
        session.trust_env = False  # no proxy and no .netrc: nobody else hears of it
        session.max_redirects = 0
        session.headers["Accept-Encoding"] = "identity"  # what is packed may be far larger than it looks
        session.adapters.clear()
        session.mount(base + "/", _gate(requests))
        session.hooks["response"].append(_judge)

    def ask(self, what: str, call: Callable[[Any], T]) -> T:
        """The answer of the library's RWS to `call`; `what` names the request in messages."""
        for wait in (*_BUSY_S, None):
            try:
                return call(self._rws)
            except _Busy:
                if wait is None:
                    raise RigFault(
                        f"{what}: the controller is too busy (503): it has too many requests or sessions. "
                        "Close other clients, or wait five minutes for their sessions to end"
                    ) from None
                time.sleep(wait)
            except self._requests.exceptions.RequestException as error:
                raise RigFault(f"{what}: {self._unreached(error)}") from None
            except RigFault as fault:
                raise RigFault(f"{what}: {fault}") from None
            except (self._error, LookupError, TypeError, ValueError, AttributeError):
                raise RigFault(
                    f"{what}: the answer is none of Robot Web Services 1.0. Is it an IRC5 (RobotWare 6), and "
                    "is --port that of its web server?"
                ) from None
        raise AssertionError

    def close(self) -> None:
        """Log out, if that can be done: the controller has few sessions."""
        self._rws.close()

    def _unreached(self, error: Exception) -> str:
        kinds = self._requests.exceptions
        if isinstance(error, kinds.ReadTimeout):
            return f"no answer for {ANSWER_S:g} s; look at the cable and the arm"
        if isinstance(error, (kinds.ConnectTimeout, kinds.ConnectionError)):
            return "the controller cannot be reached; look at the cable, --host and --port"
        return f"the request failed ({type(error).__name__})"


def _gate(requests: Any) -> Any:
    """The one way out: with answers that end, and no faster than the controller allows.

    It is mounted at the controller's address; for any other the session has no adapter at all.
    """

    from urllib3.connection import HTTPConnection
    from urllib3.connectionpool import HTTPConnectionPool

    class Connection(HTTPConnection):
        def _new_conn(self) -> socket.socket:
            return BoundedSocket(super()._new_conn(), "the controller's answer", RigFault, ANSWER_S)

        def getresponse(self) -> Any:
            self.sock.begin(ANSWER_S)  # type: ignore[union-attr]
            return super().getresponse()

    class Pool(HTTPConnectionPool):
        ConnectionCls = Connection

    class Gate(requests.adapters.HTTPAdapter):  # type: ignore[misc]
        free = 0.0

        def init_poolmanager(self, *arguments: Any, **options: Any) -> None:
            super().init_poolmanager(*arguments, **options)
            self.poolmanager.pool_classes_by_scheme = {"http": Pool}

        def send(self, request: Any, **options: Any) -> Any:
            time.sleep(max(0.0, self.free - time.monotonic()))
            self.free = time.monotonic() + _SPACING_S
            response = super().send(request, **{**options, "timeout": (_CONNECT_S, ANSWER_S)})
            if response.headers.get("Content-Encoding", "identity") != "identity":
                response.close()
                raise RigFault("the controller's answer is packed, and was asked for as it is")
            return response

    return Gate()


def _judge(response: Any, **_: Any) -> None:
    """Called with each answer, after the digest's own round: raises for those that refuse."""
    if response.status_code < 300:
        return
    status, text = response.status_code, response.text[:10_000]
    response.close()
    if status == 503:
        raise _Busy
    if status == 401:
        raise RigFault("the controller does not know this user and password; state others")
    match = _CODE.search(text)
    code = int(match.group(1) or match.group(2)) if match else None
    if code in _REFUSALS:
        raise RigFault(f"{_REFUSALS[code]} (code {code})")
    if status == 404 or code in _NOT_FOUND:
        raise RigFault("the controller does not have it: is it loaded, or configured, under this name?")
    raise RigFault(f"the controller refuses (HTTP {status}, code {code})")
