"""What the browser is told to open. The token is in no command line: other accounts can read those."""

from __future__ import annotations

import atexit
import html
import os
import sys
from pathlib import Path
from urllib.parse import urlsplit

from .folder import Folder

_LEADS_ON = """<!doctype html>
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url={address}">
<title>zerobeam</title>
<p><a href="{address}">Open the app</a>, if it does not open by itself.</p>
"""


def leading_to(folder: Path, address: str) -> str:
    """The address of a file that leads to `address`: this user alone can read it; it goes with the process.

    It is in `.zerobeam` below the folder: browsers in a container of their own read no temporary folders. On
    Windows and macOS a browser is not given its address by a command line, and `address` is returned. OSError
    or BadInput where the file cannot be written.
    """
    if sys.platform in ("win32", "darwin"):
        return address
    file = Folder(folder).private(f"open-{urlsplit(address).port}.html")
    file.parent.mkdir(exist_ok=True)
    file.unlink(missing_ok=True)
    with os.fdopen(
        os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8"
    ) as opened:
        opened.write(_LEADS_ON.format(address=html.escape(address, quote=True)))
    atexit.register(file.unlink, missing_ok=True)
    return file.as_uri()
