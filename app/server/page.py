"""The page of the app: its files as they are sent; its head names all that the first view needs."""

from __future__ import annotations

import json
import posixpath
import re
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response

from ...reports.output.html import TEMPLATES, sheet
from ...reports.style import typeface
from .guard import page_policy, refusal
from .versions import etag, matches, version_of_bytes

_PAGE = Path(__file__).parents[1] / "page"
_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
    ".png": "image/png",
    ".woff2": "font/woff2",
}
_SHEET = re.compile(rb'<link rel="stylesheet" href="/page/([^"]+)">\n')
_MAP = re.compile(rb'<script type="importmap">(.*?)</script>\n')
_IMPORT = re.compile(rb'\bfrom\s*"([^"]+)"')
_INDEX, _FIRST, _SHEETS = "index.html", "main.js", "sheets.css"


class PageFiles:
    """Its files below /page: nothing else is ever sent from there."""

    def __init__(self) -> None:
        files = page_files()
        self.files = {name: (content, version_of_bytes(content)) for name, content in files.items()}
        self.policy = page_policy(files[_INDEX])

    async def answer(self, request: Request) -> Response:
        """A file, or the page itself where none is named."""
        name = request.path_params.get("path", _INDEX)
        if name not in self.files:
            return refusal(404, "the page has no such file")
        content, version = self.files[name]
        headers = {"etag": etag(version), "cache-control": "no-cache"}
        if name == _INDEX:
            headers["content-security-policy"] = self.policy
        if matches(request.headers.get("if-none-match", ""), version):
            return Response(status_code=304, headers=headers)
        return Response(content, media_type=_TYPES[Path(name).suffix], headers=headers)


def page_files() -> dict[str, bytes]:
    """What the page consists of, by its name below /page.

    Its own files, with all style sheets in one; of the reports the typeface, the style sheet and how arms
    and instruments are drawn. The head names every module that is loaded at first.
    """
    files = {
        path.relative_to(_PAGE).as_posix(): path
        for path in _PAGE.rglob("*")
        if path.is_file() and path.suffix in _TYPES
    }
    fonts = {f"fonts/{path.name}": path for path in typeface.FOLDER.glob("*.woff2")}
    drawing = {f"scene/{path.name}": path for path in (TEMPLATES / "drawing").glob("*.js")}
    read = {name: path.read_bytes() for name, path in (files | fonts | drawing).items()}
    read["report.css"] = sheet().encode()
    index = read[_INDEX]
    read[_SHEETS] = b"\n".join(read[name.decode()] for name in _SHEET.findall(index))
    links = [f'<link rel="stylesheet" href="/page/{_SHEETS}">']
    links += [f'<link rel="modulepreload" href="/page/{name}">' for name in _loaded_first(read)]
    head = _SHEET.sub(b"", index)
    end = _import_map(head).end()
    return read | {_INDEX: head[:end] + "\n".join([*links, ""]).encode() + head[end:]}


def _import_map(index: bytes) -> re.Match[bytes]:
    matched = _MAP.search(index)
    assert matched is not None
    return matched


def _loaded_first(files: dict[str, bytes]) -> list[str]:
    """The modules that the first one imports, and those that these do."""
    addresses: dict[str, str] = json.loads(_import_map(files[_INDEX])[1])["imports"]
    names = [_FIRST]
    for name in names:  # which grows meanwhile
        for imported in map(bytes.decode, _IMPORT.findall(files[name])):
            path = addresses.get(imported, posixpath.join(f"/page/{posixpath.dirname(name)}", imported))
            module = posixpath.normpath(path).removeprefix("/page/")
            if module in files and module not in names:
                names.append(module)
    return names[1:]
