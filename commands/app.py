"""The command that starts the app; what it needs is loaded here alone."""

from __future__ import annotations

import threading
import webbrowser
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from ..model.errors import BadInput, missing_extra
from .console import say


def app(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen at (0: any).")] = 8800,
    folder: Annotated[
        Path, typer.Option("--dir", help="Folder of plans and runs: nothing else is read or written.")
    ] = Path(),
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")] = True,
    host: Annotated[
        str | None,
        typer.Option(
            help="Address to listen at, for other machines. Default: this one alone.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Look at robots and plans in the browser, offline. Ctrl-C ends it."""
    if any(find_spec(needed) is None for needed in ("starlette", "uvicorn")):
        raise missing_extra("the app", "app")
    from ..app.server.serve import leading_to, serve

    def announce(address: str) -> None:
        say(f"The app: {address}")
        say("Who has this address, with its token, may do all that the app does. Ctrl-C ends it.")
        if not browser:
            return
        try:
            opened = leading_to(folder, address)
        except (OSError, BadInput) as error:
            say(f"The browser is not opened: {error}")
            return
        threading.Thread(target=webbrowser.open, args=(opened,), daemon=True).start()

    serve(folder, host, port, announce)
