"""Every block of the documentation is run, or read as the file that it is, and prints what the page says.

In the short form posteriors are drawn shorter, plans are chosen from fewer postures where a page does not say
how many, no report is written, and of all pages the README is run; the long tests run all as it stands.
"""

import builtins
import contextlib
import io
import json
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from command_line import zerobeam
from documents import NOT_RUN, PAGES, Block, blocks, joined, prepare, prose, read, told_commands
from ruamel.yaml import YAML
from whole_ways import WAYS, StandIn

from zerobeam.experiments.rigs.simulated.cell_file import read_cell
from zerobeam.experiments.sensors.sensors_file import read_calibration, read_sensors_file
from zerobeam.experiments.studies.sweeps.study_file import read_study
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import check_header
from zerobeam.model.files.measurements import PlantTolerances, read_header
from zerobeam.model.files.plan import Obstacles, read_plan
from zerobeam.model.files.robot_file import load_robot, read_robot
from zerobeam.model.files.run import read_run

# Read by the command or the header that names them.
BY_OTHERS = (".csv", ".conf", ".ls", ".dat", ".log", ".urdf", ".py", ".drl")
LANGUAGES = {"sh", "console", "bat", "python", "yaml", "json", "csv", "xml", "text", "text output"}
# What a block of commands may begin with that is no zerobeam: installing, and what make knows.
NOT_OURS = ("make", "python3 -m venv", "source .venv/", ".venv/", ".venv\\", "py -3", "pip install")
NOT_OURS += ("zerobeam --install-completion",)
SHORT = {
    ("analyse",): ("--ess", "100"),
    ("report",): ("--ess", "100"),
    ("plan", "optimal"): ("--candidates", "300"),
}
SLOW = {
    f"docs/{name}.md"
    for name in (
        "tutorial",
        "how-to/uncalibrated-tool",
        "how-to/ur5e",
        "how-to/kr6",
        "how-to/cluster",
        "how-to/instruments",
    )
} | set(WAYS)
# A page whose recordings are not ours to ship: where the reader puts what of the shared data.
RECORDED = {"docs/tutorial.md": {"panda.urdf": "mukca/urdf/panda.urdf", "panda_2": "mukca/panda_2"}}
# Untitled examples that another block of their page reads.
UNTITLED = {"zerobeam/psd-calibration/1": "psd-a.yaml", "zerobeam/sensors/1": "sensors.yaml"}


def schema_of(text: str) -> str:
    content = YAML(typ="safe").load(text)
    return str(content.get("schema", "")) if isinstance(content, dict) else ""


@pytest.fixture
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[str], Path]:
    """A folder with all that a page's reader has there."""

    def of(name: str) -> Path:
        for here, there in RECORDED.get(name, {}).items():
            (tmp_path / here).symlink_to(request.getfixturevalue("shared_data") / there)
        prepare(read(name), tmp_path)
        for block in blocks(read(name)):
            if block.language == "yaml" and block.title is None and schema_of(block.text) in UNTITLED:
                (tmp_path / UNTITLED[schema_of(block.text)]).write_text(block.text, encoding="utf-8")
        return tmp_path

    return of


# --- running ----------------------------------------------------------------------------------------


def shortened(words: list[str], written: bool) -> list[str]:
    """Arguments of a command with what keeps it short; a report not to be `written` is only computed."""
    if words[0] == "report" and not written:
        at = words.index("-o")
        words = ["analyse", *words[1:at], *words[at + 2 :]]
    for command, added in SHORT.items():
        if tuple(words[: len(command)]) == command and added[0] not in words:
            return [*words, *added]
    return words


def require_printed(stated: list[str], printed: str, what: str) -> None:
    """Assert that the stated lines are printed in their order, one below the other but for `…`."""
    # A reader copies a space where the program keeps a number and its unit together.
    lines = [line.replace("\u00a0", " ").rstrip() for line in printed.splitlines()]
    at, apart = 0, False
    for line in (line.rstrip() for line in stated):
        if line == "…":
            apart = True
            continue
        assert line in lines[at:], f"{what}\ndoes not print\n{line}\nbut\n{printed}"
        found = lines.index(line, at)
        assert apart or found == at, f"{what}\nprints {lines[at]!r} before\n{line}"
        at, apart = found + 1, False
    assert apart or at == len(lines), f"{what}\nalso prints\n{lines[at:]}"


@contextlib.contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """In the folder, which modules are imported from too; nobody waits and nobody is asked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(str(folder))
        patch.setattr(time, "sleep", lambda _: None)
        patch.setattr(builtins, "input", lambda _: "")
        yield
    for path in folder.glob("*.py"):
        sys.modules.pop(path.stem, None)


def carry_out(
    text: str,
    folder: Path,
    *,
    short: bool = False,
    written: bool = True,
    after: Callable[[list[str]], None] = lambda words: None,
) -> int:
    """Run the blocks of a page in their order; how many commands and programs there were. `after` takes the
    words of each command that has run."""
    count, printed, names = 0, "", {"__name__": "__main__"}
    with working_in(folder):
        for block in blocks(text):
            for command in block.commands:
                assert command.words[0] == "zerobeam", command.text
                answer = zerobeam(*shortened(command.words[1:], written) if short else command.words[1:])
                assert answer.status == block.status, (command.text, answer)
                if command.printed is not None:
                    require_printed(command.printed, answer.out, command.text)
                after(command.words[1:])
                count += 1
            if block.language == "python" and block.title is None and not block.not_run:
                with contextlib.redirect_stdout(io.StringIO()) as caught:
                    exec(compile(block.text, "block", "exec"), names)
                printed = caught.getvalue()
                count += 1
            if block.language == "text output":
                require_printed(block.text.splitlines(), printed, "the program above")
    return count


def runs(name: str) -> bool:
    programs = ("python", None)  # one with a title is a file
    return any(block.commands or (block.language, block.title) == programs for block in blocks(read(name)))


RUN = [name for name in PAGES if runs(name)]


def test_most_pages_have_something_to_run() -> None:
    assert {"README.md", "docs/files.md", "docs/tutorial.md"} <= set(RUN)
    led = {f"docs/how-to/{name}.md" for name in ("by-hand", "app", "live")}  # led by a person; until Ctrl-C
    led |= {"docs/how-to/own-instrument.md"}  # a package of its own: test_own_instrument.py
    led |= {"docs/how-to/after-mastering.md"}  # a backup of the reader's own: test_positions_command.py
    assert {name for name in PAGES if name.startswith("docs/how-to/")} - led <= set(RUN)


@pytest.mark.parametrize("name", sorted(set(RUN) - SLOW))
@pytest.mark.at_length(r"^docs/")
def test_the_blocks_of_a_page_run_in_their_order(name: str, place: Callable[[str], Path]) -> None:
    assert carry_out(read(name), place(name), short=True, written=False) >= 1


@pytest.mark.long
def test_an_instrument_of_the_page_of_instruments(place: Callable[[str], Path]) -> None:
    """Of the pages left out: one kind, from the header to the answer."""
    name = "docs/how-to/instruments.md"
    (section,) = (part for part in read(name).split("\n## ") if part.startswith("Pose camera"))
    assert carry_out(section, place(name), short=True) == 3


@pytest.mark.long
@pytest.mark.parametrize("name", RUN)
def test_they_run_as_they_stand(name: str, place: Callable[[str], Path]) -> None:
    folder = place(name)
    stand_in = StandIn(name, folder)
    assert carry_out(read(name), folder, after=stand_in.after) >= 1
    assert stand_in.programs == (2 if name in WAYS else 0)


@pytest.mark.long
def test_a_page_with_a_controller_that_nothing_was_entered_into_fails(place: Callable[[str], Path]) -> None:
    name = "docs/how-to/fanuc.md"
    folder = place(name)
    stand_in = StandIn(name, folder, enters=False)
    with pytest.raises(AssertionError, match=r"zerobeam verify run\.jsonl after\.jsonl"):
        carry_out(read(name), folder, after=stand_in.after)
    assert stand_in.programs == 2


@pytest.mark.parametrize("name", WAYS)
def test_a_page_of_a_whole_way_is_short(name: str) -> None:
    text = prose(read(name))
    assert len(text.split()) <= 600
    assert "Nobody has tried this on a real controller" in text
    assert all(len(part.split()) <= 25 for part in re.split(r"(?<=[.:!?*])\s+|\n\n|\n\d\. ", text))


def test_a_command_that_fails_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="no such file"):
        carry_out("```sh\nzerobeam check nothing.yaml\n```\n", tmp_path)


def test_a_line_that_is_not_printed_is_noticed(tmp_path: Path) -> None:
    def page(*printed: str) -> str:
        return "\n".join(["```console", "$ zerobeam --version", *printed, "```", ""])

    (version,) = zerobeam("--version").out.splitlines()
    for right in ([version], ["…"], ["…", version], [version, "…"]):
        assert carry_out(page(*right), tmp_path) == 1
    with pytest.raises(AssertionError, match="does not print"):
        carry_out(page("zerobeam 99"), tmp_path)
    with pytest.raises(AssertionError, match="also prints"):
        carry_out(page(), tmp_path)
    with pytest.raises(AssertionError, match=r"does not print"):
        carry_out(page(version, version), tmp_path)


def test_a_program_that_fails_or_prints_otherwise_is_noticed(tmp_path: Path) -> None:
    program = "```python\nprint(2)\n```\n```text output\n{}\n```\n"
    assert carry_out(program.format(2), tmp_path) == 1
    with pytest.raises(AssertionError, match="does not print"):
        carry_out(program.format(3), tmp_path)
    with pytest.raises(ZeroDivisionError):
        carry_out("```python\n1 / 0\n```\n", tmp_path)


def test_a_block_of_commands_is_read_as_a_person_reads_it() -> None:
    (shell,) = blocks("```sh status=1\nzerobeam check a.yaml \\\n  --json  # why\n```\n")
    assert shell.status == 1
    assert [command.words for command in shell.commands] == [["zerobeam", "check", "a.yaml", "--json"]]
    (console,) = blocks('```console\n$ zerobeam check "a b"\nPass.\n```\n')
    assert [tuple(command) for command in console.commands] == [(["zerobeam", "check", "a b"], ["Pass."])]
    (make,) = blocks("```sh\nmake demo\n```\n")
    assert make.commands == []
    (real,) = blocks("```sh\n# not run: a controller is needed\nzerobeam run p.yaml --rig abb\n```\n")
    assert real.commands == []
    assert list(told_commands("```sh\n# not run: why\nzerobeam check …\n```\n\n    zerobeam demo\n")) == [
        ["demo"],
        ["check"],
    ]


# --- reading ----------------------------------------------------------------------------------------


def test_every_block_is_of_a_kind_that_is_tested() -> None:
    for name in PAGES:
        for block in blocks(read(name)):
            assert block.language in LANGUAGES, (name, block)
            if block.language in ("sh", "bat", "console") and not block.commands and not block.not_run:
                assert all(line.startswith(NOT_OURS) for line in joined(block.text)), (name, block.text)
            if block.language in ("csv", "xml"):
                assert block.title, (name, block.text)
            if block.not_run:
                assert len(block.text.splitlines()[0]) > len(NOT_RUN), (name, "says no reason")


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", PAGES)
def test_every_file_of_a_page_is_valid(name: str, place: Callable[[str], Path]) -> None:
    if not any(block.title or block.language in ("yaml", "json") for block in blocks(read(name))):
        pytest.skip("the page states no file")
    folder = place(name)
    with working_in(folder):
        for command in (command for block in blocks(read(name)) for command in block.commands):
            makes_robot = command.words[1] == "robot" or command.words[2:3] == ["ur-calibration"]
            if makes_robot and "-o" in command.words:  # a robot file that a header names
                assert zerobeam(*command.words[1:]).status == 0
    for block in blocks(read(name)):
        if block.title is not None:
            require_valid(folder / block.title)
        elif block.language == "json":
            json.loads(block.text)
        elif block.language == "yaml" and schema_of(block.text) in UNTITLED:
            require_valid(folder / UNTITLED[schema_of(block.text)])


def require_valid(path: Path) -> None:
    """BadInput unless the file is what it says it is; without a schema, a header that fits its robot."""
    if path.suffix in BY_OTHERS:
        return
    if path.suffix == ".jsonl":
        run = read_run(path)
        run.require_analysable()
        assert not run.warnings
        return
    text = path.read_text(encoding="utf-8")
    if text.startswith("floor_mm"):
        Obstacles.model_validate(YAML(typ="safe").load(text))
        return
    if text.startswith("tolerance:"):
        PlantTolerances.model_validate(YAML(typ="safe").load(text))
        return
    schema = schema_of(text)
    reader: Callable[[Path], object] | None = {
        "zerobeam/plan/1": read_plan,
        "zerobeam/robot/1": read_robot,
        "zerobeam/cell/1": read_cell,
        "zerobeam/study-file/1": read_study,
        "zerobeam/sensors/1": read_sensors_file,
        "zerobeam/psd-calibration/1": read_calibration,
    }.get(schema)
    assert reader or not schema, f"{path.name}: nobody reads {schema}"
    if reader is None:
        require_header(path)
    else:
        reader(path)


def require_header(path: Path) -> None:
    header = read_header(path)
    robot = load_robot(header.robot, path.parent, file=path)
    check_header(header, robot, file=path, line=lambda _: None)


def test_a_file_that_is_wrong_is_noticed(tmp_path: Path) -> None:
    for name, text in (
        ("header.yaml", "robot: irb1600\n"),
        ("plan.yaml", "schema: zerobeam/plan/1\n"),
        ("cell.yaml", "schema: zerobeam/cell/1\nlasers: 2\n"),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
        with pytest.raises(BadInput):
            require_valid(tmp_path / name)


def fragments(name: str) -> list[Block]:
    """Untitled YAML without a schema: keys of a header."""
    return [
        b for b in blocks(read(name)) if b.language == "yaml" and b.title is None and not schema_of(b.text)
    ]


def test_examples_of_single_keys_fit_into_a_header(tmp_path: Path) -> None:
    assert not [name for name in PAGES if fragments(name) and name != "docs/files.md"]
    found = [block.text for block in fragments("docs/files.md")]
    assert found
    for i, fragment in enumerate(found):
        path = tmp_path / f"{i}.yaml"
        path.write_text(f"robot: irb1600\n{fragment}", encoding="utf-8")
        require_header(path)
        path.write_text(f"robot: irb1600\n{fragment.replace('kind:', 'kinds:')}", encoding="utf-8")
        with pytest.raises(BadInput, match="unknown key 'kinds'"):
            require_header(path)
