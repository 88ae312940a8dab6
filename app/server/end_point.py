"""An end point that calculates: what it is asked, which function answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel


@dataclass(frozen=True)
class EndPoint:
    """`answer` is called with the folder, and with what was sent as the model `sent`, or with the texts of
    the query by the names in `asked` (empty where one is missing). It returns JSON or raises a ZerobeamError.
    A coroutine function waits for a process of its own; others are called one at a time.
    """

    path: str
    method: str
    says: str
    answer: Callable[..., Any]
    sent: type[BaseModel] | None = None
    asked: tuple[str, ...] = ()
