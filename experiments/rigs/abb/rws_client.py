"""Robot Web Services 1.0, at one address only, by a password that no output shows, slowly enough, and with
its refusals in words."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, NoReturn, TypeVar

from ....model.errors import BadInput, RigFault, missing_extra
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import shown
from ..transport import BoundedSocket

HOST, USER, PASSWORD = "ZEROBEAM_ABB_HOST", "ZEROBEAM_ABB_USER", "ZEROBEAM_ABB_PASSWORD"
SERVICE = "zerobeam-abb"  # of the keyring; the account is the user's name
_USER = "Default User"


class Secret:
    """A text that is in no message: only `reveal` returns it."""

    __slots__ = ("_text",)

    def __init__(self, text: str) -> None:
        self._text = text

    def reveal(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return "Secret(…)"

    __str__ = __repr__

    def __reduce__(self) -> NoReturn:
        raise TypeError("a secret is not written anywhere")


@dataclass(frozen=True)
class ControllerAccess:
    """`address` is the IPv4 address that `host` was resolved to, once: nothing else is ever talked to."""

    address: str
    port: int
    user: str
    password: Secret

    @property
    def here(self) -> str:
        """The own address that routes to the controller: the one that EGM's socket is bound to."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect((self.address, 9))  # UDP: chooses the route, sends nothing
            except OSError as error:
                raise BadInput(
                    "there is no route to the controller",
                    found=error.strerror,
                    remedy="connect this computer to the controller's network",
                ) from None
            return str(probe.getsockname()[0])


def find_access(
    environment: Mapping[str, str],
    *,
    host: str | None = None,
    port: int = 80,
    user: str | None = None,
    password: str | None = None,
) -> ControllerAccess:
    """From what was stated, else the environment, else (the password) the keyring; BadInput without."""
    host = host or environment.get(HOST)
    if not host:
        raise BadInput(
            "the controller's address is not stated", remedy=f"state --host ADDRESS, or set {HOST}"
        )
    if not 0 < port < 65536:
        raise BadInput("--port is a TCP port", found=port, allowed="1 to 65535")
    user = user or environment.get(USER) or _USER
    secret = password or environment.get(PASSWORD)
    if not secret:
        secret, why = _from_keyring(user)
        if not secret:
            raise BadInput(
                "the controller asks for a password, and none is stated",
                found=f"{PASSWORD} is not set; {why}",
                remedy=f"set {PASSWORD}, or keep it with: keyring set {SERVICE} USER",
            )
    try:
        address = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_STREAM)[0][4][0]
    except (OSError, UnicodeError):
        raise BadInput(
            "the controller's host name has no IPv4 address", remedy="state its address: --host 192.168.125.1"
        ) from None
    return ControllerAccess(str(address), port, user, Secret(secret))


def _from_keyring(user: str) -> tuple[str | None, str]:
    """The password that is kept for that user, and what is said where there is none."""
    try:
        import keyring
        from keyring import errors
    except ImportError:
        return None, "keyring is not installed"
    try:
        return keyring.get_password(SERVICE, user), "the keyring has no password for this user"
    except errors.KeyringError:
        return None, "the keyring cannot be read"


USUAL_SHARE = 0.25  # of the joints' top speeds
_IO_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")  # RAPID's names; all three go into an address


@dataclass(frozen=True)
class Signal:
    """A digital output, by the names that Robot Web Services have for it, its network and its device."""

    name: str = "zb_laser"
    network: str = "Local"
    unit: str = "DRV_1"

    def __post_init__(self) -> None:
        if not all(_IO_NAME.fullmatch(part) for part in (self.network, self.unit, self.name)):
            raise BadInput(
                "this is not a digital output of the controller",
                found=shown(str(self)),
                allowed="NETWORK/UNIT/NAME, each a letter and then letters, digits and _, 32 in all",
                remedy=f"state it as listed under /rw/iosystem/signals, such as --laser {Signal()}",
            )

    @classmethod
    def parse(cls, text: str) -> Signal:
        """From NETWORK/UNIT/NAME."""
        network, _, rest = text.partition("/")
        unit, _, name = rest.partition("/")
        return cls(name, network, unit)

    def __str__(self) -> str:
        return f"{self.network}/{self.unit}/{self.name}"


@dataclass(frozen=True)
class Caution:
    """How the arm may move: `confirm` is asked once, before the first motion, with what is going to happen.

    `share` is of the joints' top speeds, in (0, 1]. `egm_port` is the own UDP port that EGM comes to,
    `laser` the output that switches the laser.
    """

    confirm: Callable[[str], bool]
    share: float = USUAL_SHARE
    egm_port: int = 6510
    laser: Signal = Signal()

    def __post_init__(self) -> None:
        if not 0.01 <= self.share <= 1:
            raise BadInput(
                "the speed is a share of the joints' top speeds", found=self.share, allowed="0.01 to 1"
            )
        if not 0 < self.egm_port < 65536:
            raise BadInput("--egm-port is a UDP port", found=self.egm_port, allowed="1 to 65535")


def require_six_axes(robot: Robot, drives: str, remedy: str) -> None:
    """BadInput for an arm of other joints; `drives` names the rig or controller, `remedy` what to do."""
    if robot.n != 6 or any(joint.kind != "revolute" for joint in robot.joints):
        raise BadInput(
            f"{drives} drives arms of six revolute joints",
            found=f"{robot.name}: {robot.n} joints",
            remedy=remedy,
        )


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
