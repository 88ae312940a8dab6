"""The rooms of the house: which may import which, and what stands where (section 6 of the design)."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

MAY_IMPORT = {
    "model": {"model"},
    "analysis": {"model", "analysis"},
    "experiments": {"model", "analysis", "experiments"},
    "reports": {"model", "analysis", "reports"},
    "__init__": {"model", "analysis", "experiments", "reports"},
    "commands": {"model", "analysis", "experiments", "reports", "commands"},
    "cli": {"model", "commands"},
}
ROOMS = {"model", "analysis", "experiments", "reports", "commands"}
# The version is the one fact of the root that every room may ask for.
FROM_ROOT = {"__version__"}
# Habit 4 of CONTRIBUTING.md: a name says what a thing is, never how it was made.
EMPTY_NAMES = {"utils", "util", "helper", "helpers", "manager", "common", "misc"}


def modules() -> list[Path]:
    """Every Python file of the package, relative to the root."""
    files = [*ROOT.glob("*.py"), *(file for room in ROOMS for file in (ROOT / room).rglob("*.py"))]
    return sorted(file.relative_to(ROOT) for file in files)


def faults(module: Path, source: str) -> list[str]:
    """What the imports in `source` do that the room of `module` (relative to the root) must not."""
    found = []
    room = module.parts[0].removesuffix(".py")
    package = module.parts[:-1]  # below zerobeam
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                top = alias.name.split(".")[0]
                if top in ROOMS | {"zerobeam", "tests", "cli"}:
                    found.append(f"line {node.lineno}: absolute import of {alias.name}")
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            if (node.module or "").split(".")[0] in ROOMS | {"zerobeam", "tests", "cli"}:
                found.append(f"line {node.lineno}: absolute import from {node.module}")
        elif isinstance(node, ast.ImportFrom):
            if node.level > len(package) + 1:
                found.append(f"line {node.lineno}: import from outside the package")
                continue
            base = package[: len(package) - node.level + 1]
            path = (*base, *(node.module.split(".") if node.module else ()))
            targets = {path[0]} if path else {alias.name for alias in node.names} - FROM_ROOT
            for target in sorted(targets - MAY_IMPORT[room]):
                found.append(f"line {node.lineno}: {room} imports {target}")
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            # The root's public names are imported late, from a table that test_package.py holds to them.
            if name in {"import_module", "__import__"} and room != "__init__":
                found.append(f"line {node.lineno}: an import that cannot be read off the text")
    return found


@pytest.mark.parametrize("module", modules(), ids=str)
def test_a_module_imports_only_what_its_room_may(module: Path) -> None:
    assert faults(module, (ROOT / module).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("model/bad.py", "from ..analysis.result import Result"),
        ("model/bad.py", "from .. import reports"),
        ("model/bad.py", "from .. import analyse"),
        ("model/deep/bad.py", "from ...analysis import result"),
        ("model/deep/bad.py", "from ....elsewhere import thing"),
        ("analysis/bad.py", "def late():\n    from ..experiments import rigs"),
        (
            "analysis/bad.py",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ..reports import pdf",
        ),
        ("experiments/bad.py", "from ..reports.pdf import write"),
        ("reports/bad.py", "from ..experiments.rigs import Simulated"),
        ("reports/bad.py", "from ..cli import main"),
        ("reports/bad.py", "from ..commands.console import out"),
        ("__init__.py", "from .cli import main"),
        ("cli.py", "from .analysis import analyse"),
        ("analysis/bad.py", "import zerobeam.model"),
        ("analysis/bad.py", "from zerobeam.model.robot import Robot"),
        ("analysis/bad.py", "from model.robot import Robot"),
        ("analysis/bad.py", "import importlib\nimportlib.import_module('zerobeam.' + 'reports')"),
        ("cli.py", "from .tests import anything"),
    ],
)
def test_a_forbidden_import_is_caught(module: str, source: str) -> None:
    assert len(faults(Path(module), source)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("model/good.py", "import numpy\nfrom . import errors\nfrom .errors import BadInput"),
        ("model/deep/good.py", "from ..errors import BadInput\nfrom ... import __version__"),
        ("analysis/good.py", "from ..model.robot import Robot\nfrom .. import __version__"),
        ("reports/good.py", "from ..analysis.result import Result"),
        ("cli.py", "from .commands import judging\nfrom . import __version__"),
        ("commands/good.py", "from ..experiments import rigs\nfrom ..reports import pdf"),
    ],
)
def test_an_allowed_import_is_let_through(module: str, source: str) -> None:
    assert faults(Path(module), source) == []


def test_the_rooms_are_those_of_the_design() -> None:
    assert {init.parent.name for init in ROOT.glob("*/__init__.py")} == ROOMS


def test_no_other_python_file_stands_at_the_root() -> None:
    assert {file.name for file in ROOT.glob("*.py")} == {"__init__.py", "cli.py"}


def test_a_module_is_named_for_what_it_is() -> None:
    assert [str(module) for module in modules() if module.stem in EMPTY_NAMES] == []
