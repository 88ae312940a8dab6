"""HTTP digest authentication (RFC 7616, with MD5 and qop=auth as the controller has it), the server's
side."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from urllib.request import parse_http_list, parse_keqv_list

REALM = "validusers@robapi.abb"
_OPAQUE = "799d5"
_NONCES = 1000  # known at a time: the oldest is forgotten


class Digest:
    """Who may come in: passwords by user."""

    def __init__(self, users: dict[str, str]) -> None:
        self._users = dict(users)
        self._counts: dict[str, int] = {}  # of every nonce that was given: the largest count it was used with

    def challenge(self, stale: bool = False) -> str:
        """The value of WWW-Authenticate, with a new nonce."""
        nonce = secrets.token_hex(16)
        self._counts[nonce] = 0
        if len(self._counts) > _NONCES:
            del self._counts[next(iter(self._counts))]
        return (
            f'Digest realm="{REALM}", domain="/", qop="auth", nonce="{nonce}", opaque="{_OPAQUE}", '
            f'algorithm="MD5", stale="{str(stale).upper()}"'
        )

    def admits(self, authorization: str, method: str, uri: str) -> bool:
        """Whether the value of Authorization shows that the client knows a password."""
        scheme, _, rest = authorization.partition(" ")
        if scheme.lower() != "digest":
            return False
        try:
            said = parse_keqv_list(parse_http_list(rest))
            count = int(said["nc"], 16)
            user, nonce, client, response = (said[key] for key in ("username", "nonce", "cnonce", "response"))
        except (KeyError, ValueError):
            return False
        known = user in self._users and said.get("realm") == REALM and said.get("uri") == uri
        # A count that was there before is a request overheard and sent again.
        if not known or said.get("qop") != "auth" or count <= self._counts.get(nonce, count):
            return False
        secret = _md5(f"{user}:{REALM}:{self._users[user]}")
        wanted = _md5(f"{secret}:{nonce}:{said['nc']}:{client}:auth:{_md5(f'{method}:{uri}')}")
        if not hmac.compare_digest(wanted, response):
            return False
        self._counts[nonce] = count
        return True


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()
