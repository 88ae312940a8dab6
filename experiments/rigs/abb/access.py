"""How an ABB controller is reached, with a password that no output shows, and how carefully it is driven."""

from __future__ import annotations

import re
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NoReturn

from ....model.errors import BadInput
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import shown

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
