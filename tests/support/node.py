"""Modules of the page that need no browser, run by Node."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from zerobeam import app
from zerobeam.reports.output.html import TEMPLATES

DRAWING = TEMPLATES / "drawing"
PAGE = Path(app.__file__).parent / "page"

# What the modules ask a browser for as they are loaded: an address, a store, and nobody who presses anything.
_BROWSER = """
globalThis.location = { hash: "", search: "", pathname: "/" };
globalThis.addEventListener = () => {};
globalThis.localStorage = { getItem: () => null, setItem: () => {}, removeItem: () => {} };
globalThis.fetch = () => Promise.reject(new TypeError("no server"));
"""


def _run(folder: Path, script: str, data: Any) -> Any:
    """What the script writes as JSON; `input` in it is the data."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node is not on this machine")
    (folder / "input.json").write_text(json.dumps(data))
    (folder / "main.mjs").write_text(
        'import { readFileSync } from "node:fs";\n'
        f'const input = JSON.parse(readFileSync("{folder}/input.json"));\n{script}'
    )
    done = subprocess.run(
        [node, "--preserve-symlinks", folder / "main.mjs"], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def drawn(folder: Path, script: str, data: Any) -> Any:
    """What a script writes as JSON, run beside the modules of the drawing; `input` in it is the data."""
    for path in DRAWING.glob("*.js"):
        shutil.copy(path, folder / f"{path.stem}.mjs")
        (folder / f"{path.stem}.mjs").write_text(path.read_text().replace('.js";', '.mjs";'))
    return _run(folder, script, data)


def paged(folder: Path, module: str, expression: str, data: Any = None) -> Any:
    """The value of an expression, in which `m` is a module of the page and `input` the data."""
    (folder / "package.json").write_text('{"type": "module"}')
    (folder / "page").symlink_to(PAGE, target_is_directory=True)
    for name, file in _imports().items():
        package, below = re.fullmatch(r"((?:@\w+/)?[\w-]+)/?(.*)", name).groups()  # type: ignore[union-attr]
        at = folder / "node_modules" / package
        at.mkdir(parents=True, exist_ok=True)
        about = at / "package.json"
        exports = json.loads(about.read_text())["exports"] if about.exists() else {}
        exports[f"./{below}" if below else "."] = f"./{Path(file).name}"
        about.write_text(json.dumps({"type": "module", "exports": exports}))
        shutil.copy(PAGE / file, at)
    script = f"""{_BROWSER}
const m = await import("./page/{module}");
process.stdout.write(JSON.stringify(await ({expression})));
process.exit(0);"""
    return _run(folder, script, data)


def _imports() -> dict[str, str]:
    """The libraries of the page, by the names under which it imports them."""
    found = re.search(r'<script type="importmap">(.*?)</script>', (PAGE / "index.html").read_text())
    assert found is not None
    return {
        name: file.removeprefix("/page/")
        for name, file in json.loads(found[1])["imports"].items()
        if not name.startswith(("three", "uplot"))
    }
