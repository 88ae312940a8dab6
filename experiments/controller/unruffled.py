"""A server that is not disturbed by clients that go away."""

from __future__ import annotations

import sys
from socketserver import BaseServer
from typing import Any


class Unruffled(BaseServer):
    """A connection that is reset, or that ends amid an answer, is closed, and nothing is said of it."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)
