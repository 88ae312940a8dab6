"""The rooms of the house: what import-linter (contracts in pyproject.toml, run by `make lint`) cannot say."""

import ast
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = {"app", "model", "analysis", "words", "experiments", "reports", "face", "commands"}
# Habit 4 of CONTRIBUTING.md: a name says what a thing is, never how it was made.
EMPTY_NAMES = {"utils", "util", "helper", "helpers", "manager", "common", "misc"}


def modules() -> list[Path]:
    """Every Python file of the package, relative to the root."""
    files = [*ROOT.glob("*.py"), *(file for room in ROOMS for file in (ROOT / room).rglob("*.py"))]
    return sorted(file.relative_to(ROOT) for file in files)


@cache
def sources() -> dict[str, str]:
    """The text of every module."""
    return {str(module): (ROOT / module).read_text(encoding="utf-8") for module in modules()}


@cache
def trees() -> dict[str, ast.Module]:
    return {module: ast.parse(source) for module, source in sources().items()}


def unread(module: Path, tree: ast.Module) -> list[str]:
    """The imports of a module that are not relative, and those that cannot be read off the text."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module or ""]
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            # The root's public names are imported late, from a table that test_package.py holds to them;
            # makers are found by their folders, and commands by their names. Two pass on what others import.
            late = {"__init__.py", "commands/program.py", "experiments/makers/maker.py"}
            late |= {"analysis/posterior/lean_emcee.py"}
            if name in {"import_module", "__import__"} and module.as_posix() not in late:
                found.append(f"{module}:{node.lineno}: an import that cannot be read off the text")
            continue
        else:
            continue
        if any(name.split(".")[0] in ROOMS | {"zerobeam", "tests", "cli"} for name in names):
            found.append(f"{module}:{node.lineno}: an import that is not relative")
    return found


def test_every_import_of_ours_is_relative_and_in_the_text() -> None:
    faults = [fault for module, tree in trees().items() for fault in unread(Path(module), tree)]
    assert faults == []


@pytest.mark.parametrize(
    "source",
    [
        "import zerobeam.model",
        "from zerobeam.model.kinematics.robot import Robot",
        "from model.robot import Robot",
        "def late():\n    from tests import anything",
        "import importlib\nimportlib.import_module('zerobeam.' + 'reports')",
    ],
)
def test_another_import_is_caught(source: str) -> None:
    assert len(unread(Path("analysis/bad.py"), ast.parse(source))) == 1


def test_the_contracts_of_the_rooms_catch_what_they_are_for(tmp_path: Path) -> None:
    house = tmp_path / "zerobeam"
    for module in modules():
        (house / module).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / module, house / module)
    bad = {
        "model/bad1.py": "from ..analysis.answer.result import Result",
        "model/bad2.py": "from .. import analyse",
        "model/files/bad3.py": "from ...analysis.answer import result",
        "model/files/bad4.py": "from . import bad5",
        "model/files/bad5.py": "from .bad4 import other",
        "analysis/bad6.py": "def late():\n    from ..experiments.rigs import rig",
        "analysis/bad7.py": "import typing\nif typing.TYPE_CHECKING:\n    from ..reports.output import pdf",
        "experiments/bad8.py": "from ..reports.output.pdf import write",
        "experiments/bad9.py": "from ..commands import console",
        "reports/run/bad10.py": "from ...cli import main",
        "reports/run/bad11.py": "from ...commands.console import out",
        "words/bad12.py": "from ..experiments.rigs import rig",
        "reports/style/bad13.py": "from ..run import figures",
        "reports/bad14.py": "",
        "commands/bad15.py": "from .. import analyse",
    }
    for module, source in bad.items():
        (house / module).write_text(source)
    with (house / "cli.py").open("a") as file:
        file.write("from .analysis.analyse import analyse\n")
    with (house / "__init__.py").open("a") as file:
        file.write("from .cli import main\n")
    pytest.importorskip("importlinter", reason="needs newer versions than the lowest")
    ran = subprocess.run(
        [Path(sys.executable).parent / "lint-imports", "--no-cache", "--config", ROOT / "pyproject.toml"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 1, ran.stderr
    told = ran.stdout
    assert [module for module in bad if not re.search(rf"\b{Path(module).stem}\b", told)] == []
    assert "zerobeam.cli -> zerobeam.analysis.analyse" in told
    assert "zerobeam -> zerobeam.cli" in told


# Names that say how a value was come by, or nothing: CONTRIBUTING.md, Habits.
BANNED_NAMES = {
    *("aside", "asked", "begun", "chance", "found", "given", "miss", "miss_mm", "miss_size", "odd", "own"),
    *("place", "said", "seen", "stated", "told", "walk", "wanted"),
}
# Arguments that programs of others pass by name: `BadInput(found=…)`, `BeamPorts(told=…)`.
ALLOWED_ARGUMENTS = {"found", "told"}
UNTYPED = 30  # `dict[str, Any]`: where a foreign format ends


def banned(tree: ast.Module) -> set[str]:
    """The banned names of variables, parameters, functions and classes that a module binds. The fields of a
    class are no such names: most are keys of a file."""
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    fields = {id(item.target) for each in classes for item in each.body if isinstance(item, ast.AnnAssign)}
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and id(node) not in fields:
            names.add(node.id)
        elif isinstance(node, ast.arg) and node.arg not in ALLOWED_ARGUMENTS:
            names.add(node.arg)
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            names.add(node.name)
    return {name for name in names if name.strip("_").lower() in BANNED_NAMES}


def test_a_name_says_what_the_thing_is() -> None:
    names = {module: banned(tree) for module, tree in trees().items()}
    assert {module: bad for module, bad in names.items() if bad} == {}


@pytest.mark.parametrize(
    "source", ["own = 1", "def f(_given): ...", "for found in x: ...", "class Seen: ..."]
)
def test_a_banned_name_is_caught(source: str) -> None:
    assert len(banned(ast.parse(source))) == 1


def test_no_class_name_is_there_twice() -> None:
    bodies = (node for tree in trees().values() for node in tree.body)
    names = Counter(node.name for node in bodies if isinstance(node, ast.ClassDef))
    assert [name for name, count in names.items() if count > 1] == []


def test_untyped_dictionaries_are_few() -> None:
    assert sum(source.count("dict[str, Any]") for source in sources().values()) <= UNTYPED


def test_the_rooms_are_those_of_the_design() -> None:
    assert {init.parent.name for init in ROOT.glob("*/__init__.py")} == ROOMS


def test_no_other_python_file_stands_at_the_root() -> None:
    assert {file.name for file in ROOT.glob("*.py")} == {
        "__init__.py",
        "cli.py",
        "interruption.py",
        "setup.py",
    }


def test_a_module_is_named_for_what_it_is() -> None:
    assert [str(module) for module in modules() if module.stem in EMPTY_NAMES] == []


def test_a_file_name_stands_once() -> None:
    names = Counter(module.name for module in modules() if module.name != "__init__.py")
    assert [name for name, count in names.items() if count > 1] == []


def test_no_file_of_the_product_is_called_a_test() -> None:
    assert [str(module) for module in modules() if re.search(r"^test_|_test$", module.stem)] == []
