"""The documentation: its commands run, its files are read, its keys and links are those that there are.

A fenced block with `title="name"` is a file of that name. A block of language `sh` or `console` whose first
command is `zerobeam` is run, in the order of its page, in a folder with that page's files; it must end with
status 0, or with the one that its fence states (`status=1`).
"""

from __future__ import annotations

import dataclasses
import os
import re
import shlex
import subprocess
import sys
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer.main
from pydantic import BaseModel
from ruamel.yaml import YAML

from zerobeam.analysis.check import Check
from zerobeam.analysis.result import Result
from zerobeam.cli import app
from zerobeam.experiments.obstacles import Obstacles
from zerobeam.experiments.plan_making import MadePlan
from zerobeam.experiments.rigs.cell_file import Cell, read_cell
from zerobeam.experiments.schema import SCHEMA_NAMES, json_schema
from zerobeam.model.errors import BadInput
from zerobeam.model.header import Header, check_header, read_header
from zerobeam.model.plan import read_plan
from zerobeam.model.robot_file import load_robot, read_robot
from zerobeam.model.run import read_run

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FILES = ROOT / "docs" / "files.md"
NAMES = [page.name for page in PAGES]


class Block(NamedTuple):
    """A fenced block: `title` of the file that it is, `status` that its commands end with."""

    language: str
    title: str | None
    status: int
    text: str

    @property
    def commands(self) -> list[list[str]]:
        """Arguments of each `zerobeam …` of a block of commands; none for other blocks."""
        if self.language not in ("sh", "console"):
            return []
        lines = self.text.replace("\\\n", " ").splitlines()
        if self.language == "console":
            lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
        if not lines or not lines[0].startswith("zerobeam"):
            return []
        words = [shlex.split(line, comments=True) for line in lines]
        return [line for line in words if line]


def blocks(text: str) -> list[Block]:
    found = []
    for fence, body in re.findall(r"^```(\S[^\n]*)\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL):
        title = re.search(r'title="([^"]+)"', fence)
        status = re.search(r"status=(\d+)", fence)
        found.append(
            Block(fence.split()[0], title and title.group(1), int(status.group(1)) if status else 0, body)
        )
    return found


def prepare(text: str, folder: Path) -> list[Path]:
    paths = []
    for block in blocks(text):
        if block.title is not None:
            path = folder / block.title
            assert path.parent == folder
            assert not path.exists(), f"{block.title} stands twice"
            path.write_text(block.text, encoding="utf-8")
            paths.append(path)
    return paths


def carry_out(text: str, folder: Path) -> int:
    """Run the commands of a page in a folder with its files; how many there were."""
    prepare(text, folder)
    count = 0
    for block in blocks(text):
        for command, *arguments in block.commands:
            assert command == "zerobeam", command
            done = subprocess.run(
                [sys.executable, "-c", "from zerobeam.cli import main; main()", *arguments],
                cwd=folder,
                capture_output=True,
                encoding="utf-8",
                env={**os.environ, "PYTHONUTF8": "1"},
                check=False,
            )
            told = f"zerobeam {shlex.join(arguments)}\n{done.stdout}{done.stderr}"
            assert done.returncode == block.status, told
            assert "Traceback" not in done.stderr, told
            count += 1
    return count


def read(page: Path) -> str:
    return page.read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "least"), [("README.md", 5), ("files.md", 8)])
def test_the_commands_of_a_page_run_in_their_order(name: str, least: int, tmp_path: Path) -> None:
    assert carry_out(read(PAGES[NAMES.index(name)]), tmp_path) >= least


def test_no_other_page_has_commands_that_are_not_run() -> None:
    others = [page for page in PAGES if page.name not in ("README.md", "files.md")]
    assert not [block.commands for page in others for block in blocks(read(page)) if block.commands]


def test_a_command_of_a_page_that_fails_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="no such file"):
        carry_out("```sh\nzerobeam check nothing.yaml\n```\n", tmp_path)


def test_a_block_of_commands_is_read_as_a_person_reads_it() -> None:
    (shell,) = blocks("```sh status=1\nzerobeam check a.yaml \\\n  --json  # why\n```\n")
    assert shell.status == 1
    assert shell.commands == [["zerobeam", "check", "a.yaml", "--json"]]
    (console,) = blocks('```console\n$ zerobeam check "a b"\nPass.\n```\n')
    assert console.commands == [["zerobeam", "check", "a b"]]
    (make,) = blocks("```sh\nmake demo\n```\n")
    assert make.commands == []


@pytest.mark.parametrize("name", NAMES)
def test_every_file_of_a_page_is_valid(name: str, tmp_path: Path) -> None:
    for path in prepare(read(PAGES[NAMES.index(name)]), tmp_path):
        text = path.read_text(encoding="utf-8")
        if path.suffix in (".csv", ".ls", ".dat"):
            continue  # what these mean stands in the command that imports them
        if "zerobeam/run/1" in text:
            run = read_run(path)
            run.require_analysable()
            assert not run.warnings
        elif "zerobeam/plan/1" in text:
            assert not read_plan(path).warnings
        elif "zerobeam/robot/1" in text:
            read_robot(path)
        elif "zerobeam/cell/1" in text:
            read_cell(path)
        else:
            check(path)


def check(path: Path) -> None:
    """A header with all that only its robot can tell; BadInput if it is not one."""
    header = read_header(path)
    robot = load_robot(header.robot, path.parent, file=path)
    check_header(header, robot, file=path, line=lambda _: None)


def test_examples_of_single_keys_fit_into_a_header(tmp_path: Path) -> None:
    fragments = [b.text for b in blocks(read(FILES)) if b.language == "yaml" and b.title is None]
    assert fragments
    for i, fragment in enumerate(fragments):
        path = tmp_path / f"{i}.yaml"
        path.write_text(f"robot: irb1600\n{fragment}", encoding="utf-8")
        check(path)
        path.write_text(f"robot: irb1600\n{fragment.replace('kind:', 'kinds:')}", encoding="utf-8")
        with pytest.raises(BadInput, match="unknown key 'kinds'"):
            check(path)


# --- what the pages name ----------------------------------------------------------------------------


def commands_of(group: Any) -> Iterator[str]:
    for name, command in group.commands.items():
        yield name
        for below in commands_of(command) if hasattr(command, "commands") else ():
            yield f"{name} {below}"


def test_every_command_that_a_page_names_exists() -> None:
    known = set(commands_of(typer.main.get_command(app)))
    named: set[str] = set()
    for page in [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]:
        text = read(page)
        code = [block.text for block in blocks(text)] + re.findall(r"`([^`\n]+)`", text)
        command = r"\bzerobeam ((?:(?:import|study|export) )?[a-z][a-z0-9]*)\b"
        named |= set(re.findall(command, "\n".join(code)))
    assert named <= known, named - known
    # Three alone are groups of commands; every command that does something is documented.
    assert known - named <= {"import", "study", "export"}


def test_every_make_target_that_a_page_names_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, flags=re.MULTILINE))
    for page in [*PAGES, ROOT / "CONTRIBUTING.md"]:
        named = set(re.findall(r"(?:^ *|`)make ([a-z-]+)", read(page), flags=re.MULTILINE))
        assert named <= targets, (page.name, named - targets)


def words_in_code(text: str) -> set[str]:
    """The words of a page that stand in `code`."""
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    return {word for code in re.findall(r"`([^`\n]+)`", prose) for word in re.findall(r"\w+", code)}


def properties(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for value in schema.values():
            yield from properties(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from properties(value)


def fields(kind: Any) -> Iterator[str]:
    """Names of the fields of a dataclass and of the dataclasses in it."""
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        for field in dataclasses.fields(kind):
            yield field.name
            yield from fields(hints[field.name])
    elif isinstance(kind, types.UnionType) or typing.get_origin(kind) is not None:
        for part in typing.get_args(kind):
            yield from fields(part)


@pytest.mark.parametrize("name", SCHEMA_NAMES)
def test_every_key_of_a_file_is_documented(name: str) -> None:
    missing = set(properties(json_schema(name))) - words_in_code(read(FILES))
    assert not missing


@pytest.mark.parametrize("kind", [Check, Result])
def test_every_key_of_an_answer_is_documented(kind: type) -> None:
    # In the file the two fits stand under `fits`.
    missing = set(fields(kind)) - words_in_code(read(FILES))
    assert not missing


def test_every_key_of_a_proposal_is_documented() -> None:
    keys = set(MadePlan("x", None, None, None, None, None).as_json())
    assert len(keys) > 10
    assert not keys - words_in_code(read(FILES))


def test_the_example_of_an_obstacles_file_is_read() -> None:
    (example,) = [b.text for b in blocks(read(FILES)) if b.text.startswith("floor_mm")]
    stated = Obstacles.model_validate(YAML(typ="safe").load(example))
    assert [box.name for box in stated.boxes] == ["table"]


def test_documented_defaults_are_those_of_the_code() -> None:
    rows = re.findall(r"^\| `([\w.<>]+)` \|[^|]*\| (\d[\d .]*)[^|]*\|", read(FILES), flags=re.MULTILINE)
    assert len(rows) >= 15
    for key, documented in rows:
        place = key.split(".")
        model = Header if place[0] in Header.model_fields else Cell
        assert default_of(model, place) == float(documented.replace(" ", "")), key


def default_of(model: type[BaseModel], place: list[str]) -> Any:
    field = model.model_fields[place[0]]
    if len(place) == 1:
        return field.default
    inner = [
        part for part in (field.annotation, *typing.get_args(field.annotation)) if isinstance(part, type)
    ]
    (below,) = [part for part in inner if issubclass(part, BaseModel)]
    return default_of(below, [name for name in place[1:] if "<" not in name])


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page."""
    prose = re.sub(r"^```.*?^```$", "", read(page), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", prose, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    page = PAGES[NAMES.index(name)]
    for link in re.findall(r"\]\(([^)\s]+)\)", read(page)):
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        there = page.parent / path if path else page
        assert there.is_file(), link
        if anchor:
            assert anchor in anchors(there), link
