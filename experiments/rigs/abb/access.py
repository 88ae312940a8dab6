"""Who may talk to an ABB controller, and where: host, user and a password that no output shows."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NoReturn

from ....model.errors import BadInput

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
class Access:
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
) -> Access:
    """From what was stated, else the environment, else (the password) the keyring; BadInput without."""
    host = host or environment.get(HOST)
    if not host:
        raise BadInput(
            "the controller's address is not stated", remedy=f"state --host ADDRESS, or set {HOST}"
        )
    if not 0 < port < 65536:
        raise BadInput("--port is a TCP port", found=port, allowed="1 to 65535")
    user = user or environment.get(USER) or _USER
    stated = password or environment.get(PASSWORD)
    if not stated:
        stated, why = _from_keyring(user)
        if not stated:
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
    return Access(str(address), port, user, Secret(stated))


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
