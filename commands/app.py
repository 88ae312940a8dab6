"""The command that starts the app; what it needs is loaded here alone."""

from __future__ import annotations

import threading
import webbrowser
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from ..model.errors import BadInput, missing_extra
from ..model.options import Option
from .console import say


def app(
    port: Annotated[int, Option("Port to listen at (0: any).", least=0, most=65535)] = 8800,
    folder: Annotated[
        Path, Option("Folder of plans and runs: nothing else is read or written.", "--dir")
    ] = Path(),
    browser: Annotated[bool, Option("Open the page in the browser.", "--open/--no-open")] = True,
    host: Annotated[
        str | None, Option("Address to listen at, for other machines. Default: this one alone.")
    ] = None,
) -> None:
    """Plan, measure, analyse and export in the browser, by the files of one folder. Ctrl-C ends it."""
    if any(find_spec(needed) is None for needed in ("starlette", "uvicorn")):
        raise missing_extra("the app", "app")
    from ..app.server.serve import leading_to, serve

    def announce(address: str) -> None:
        say(f"The app: {address}")
        say("Anyone who has this address, with its token, can do all that the app can. Ctrl-C ends it.")
        if not browser:
            return
        try:
            opened = leading_to(folder, address)
        except (OSError, BadInput) as error:
            say(f"The browser is not opened: {error}")
            return
        threading.Thread(target=webbrowser.open, args=(opened,), daemon=True).start()

    serve(folder, host, port, announce)
