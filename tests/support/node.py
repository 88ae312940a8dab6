"""Modules of the page that need no browser, run by Node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from zerobeam.reports.output.html import TEMPLATES

DRAWING = TEMPLATES / "drawing"


def drawn(folder: Path, script: str, data: Any) -> Any:
    """What a script writes as JSON, run beside the modules of the drawing; `input` in it is the data."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node is not on this machine")
    for path in DRAWING.glob("*.js"):
        shutil.copy(path, folder / f"{path.stem}.mjs")
        (folder / f"{path.stem}.mjs").write_text(path.read_text().replace('.js";', '.mjs";'))
    (folder / "input.json").write_text(json.dumps(data))
    (folder / "main.mjs").write_text(
        'import { readFileSync } from "node:fs";\n'
        f'const input = JSON.parse(readFileSync("{folder}/input.json"));\n{script}'
    )
    done = subprocess.run([node, folder / "main.mjs"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)
