"""Folders are written whole or not at all; what a killed process leaves is swept; what is not ours stays."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest
from asked_to_end import ask
from child import child

from zerobeam.interruption import stoppable
from zerobeam.model.errors import BadInput
from zerobeam.reports.output import whole_folder
from zerobeam.reports.output.whole_folder import Kind, write_folder

KIND = Kind("note", frozenset({"note.json"}), "note.json", "a/note")
WRITER = """
import sys, time
from pathlib import Path
from zerobeam.reports.output.whole_folder import Kind, write_folder

def fill(aside):
    (aside / "note.json").write_text("{")
    print("writing", flush=True)
    time.sleep(600)

write_folder(Path(sys.argv[1]), Kind("note", frozenset({"note.json"}), "note.json", "a/note"), fill)
"""


def fill(aside: Path) -> None:
    (aside / "note.json").write_text('{"schema": "a/note"}')


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.skipif(sys.platform == "win32", reason="whether another process lives is not asked there")
@pytest.mark.long
def test_what_a_killed_process_left_is_removed_and_what_another_one_writes_is_not(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER]
    one, other = ([*command, str(tmp_path / name)] for name in ("one", "other"))
    with child(one) as killed, child(other) as alive:
        for process in (killed, alive):
            assert process.stdout is not None
            assert process.stdout.readline() == "writing\n"
        assert len(names(tmp_path)) == 2
        killed.kill()
        killed.wait()
        write_folder(tmp_path / "mine", KIND, fill)
        left = names(tmp_path) - {"mine"}
        assert len(left) == 1
        assert f"-{alive.pid}-" in left.pop()
        alive.kill()
        alive.wait()
        write_folder(tmp_path / "mine", KIND, fill)
    assert names(tmp_path) == {"mine"}


@pytest.mark.skipif(sys.platform == "win32", reason="whether another process lives is not asked there")
@pytest.mark.long
def test_what_a_killed_process_had_taken_away_is_put_back(tmp_path: Path) -> None:
    """It was killed between two renamings: the folder of before was hidden, and its place empty."""
    write_folder(tmp_path / "out", KIND, fill)
    script = (
        "import os, sys; from pathlib import Path; from zerobeam.reports.output import whole_folder as own\n"
    )
    script += "def fill(aside): (aside / 'note.json').write_text('new')\n"
    script += "rename = Path.rename\n"
    script += "def once(*names): rename(*names); os.kill(os.getpid(), 9)\n"
    script += "Path.rename = once\n"
    kind = "own.Kind('note', frozenset({'note.json'}), 'note.json', 'a/note')"
    script += f"own.write_folder(Path(sys.argv[1]), {kind}, fill)"
    with child([sys.executable, "-c", script, str(tmp_path / "out")]) as killed:
        assert killed.wait(timeout=60) == -signal.SIGKILL
    assert "out" not in names(tmp_path)
    write_folder(tmp_path / "other", KIND, fill)
    assert names(tmp_path) == {"out", "other"}
    assert (tmp_path / "out" / "note.json").read_text() == '{"schema": "a/note"}'


def test_an_unfinished_file_of_ours_is_no_foreign_thing(tmp_path: Path) -> None:
    write_folder(tmp_path / "out", KIND, fill)
    (tmp_path / "out" / ".note.json.abcd1234.part").write_text("{")
    write_folder(tmp_path / "out", KIND, fill)
    assert names(tmp_path / "out") == {"note.json"}
    (tmp_path / "out" / ".thesis.part").write_text("mine")
    with pytest.raises(BadInput, match="holds other things"):
        write_folder(tmp_path / "out", KIND, fill)


def test_of_what_nothing_is_known_only_what_is_a_day_old_is_removed(tmp_path: Path) -> None:
    yesterday = time.time() - 25 * 3600
    litter = [".zerobeam-new-abcd1234", f".zerobeam-new-00000000-{2**22 + 1}-abcd1234"]
    others = [".zerobeam-newly", ".zerobeam-old-abcd1234", "zerobeam-new-abcd1234"]
    for made, name in enumerate([*litter, *others]):
        (tmp_path / name).mkdir()
        (tmp_path / name / "note.json").write_text(str(made))
    (tmp_path / ".zerobeam-new-file1234").write_text("mine")
    before = names(tmp_path)
    write_folder(tmp_path / "out", KIND, fill)
    assert names(tmp_path) == before | {"out"}
    for name in before:
        os.utime(tmp_path / name, (yesterday, yesterday))
    write_folder(tmp_path / "out", KIND, fill)
    assert names(tmp_path) == before - set(litter) | {"out"}


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    link = tmp_path / ".zerobeam-new-abcd1234"
    link.symlink_to(tmp_path / "mine")
    os.utime(tmp_path / "mine", (0, 0))
    write_folder(tmp_path / "out", KIND, fill)
    assert (tmp_path / "mine" / "thesis.tex").read_text() == "mine"


def test_it_is_as_any_new_folder_and_missing_parents_are_made(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    write_folder(tmp_path / "a" / "b" / "out", KIND, fill)
    assert (tmp_path / "a" / "b" / "out").stat().st_mode == (tmp_path / "plain").stat().st_mode
    write_folder(tmp_path / "plain", KIND, fill)  # an empty one is used
    assert names(tmp_path / "plain") == {"note.json"}


def test_what_is_not_ours_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for name, file, content in (
        ("other", "thesis.tex", "mine"),
        ("alike", "note.json", '{"schema": "someone/else/1"}'),
        ("broken", "note.json", "{"),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).write_text(content)
    write_folder(tmp_path / "ours", KIND, fill)
    (tmp_path / "ours" / "notes.txt").write_text("mine")
    for name, message in (
        ("file", "is a file"),
        ("file/out", "cannot be written"),
        ("other", "thesis.tex"),
        ("alike", "not written by zerobeam"),
        ("broken", "not written by zerobeam"),
        ("ours", "notes.txt"),
    ):
        with pytest.raises(BadInput, match=message):
            write_folder(tmp_path / name, KIND, fill)
    assert (tmp_path / "file").read_text() == (tmp_path / "ours" / "notes.txt").read_text() == "mine"
    assert names(tmp_path) == {"file", "other", "alike", "broken", "ours"}


def test_a_disk_that_is_full_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_folder(tmp_path / "out", KIND, fill)

    def fail(self: Path, target: Path) -> Path:
        if self.name.startswith(".zerobeam-new"):
            raise OSError(28, "No space left on device")
        return rename(self, target)

    def full(aside: Path) -> None:
        (aside / "note.json").write_text("new")
        raise OSError(28, "No space left on device")

    with pytest.raises(BadInput, match="No space left"):
        write_folder(tmp_path / "out", KIND, full)
    rename = Path.rename
    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(BadInput, match="No space left"):
        write_folder(tmp_path / "out", KIND, lambda folder: (folder / "note.json").write_text("new"))
    assert (tmp_path / "out" / "note.json").read_text() == '{"schema": "a/note"}'
    assert names(tmp_path) == {"out"}


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written_to_is_bad_input(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(BadInput, match="cannot be written"):
        write_folder(tmp_path / "out", KIND, fill)


def test_an_interruption_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(whole_folder, "_swap", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_folder(tmp_path / "a" / "out", KIND, fill)
    assert names(tmp_path) == set()


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("where", ["mkdtemp", "rename", "rmtree"])
def test_an_interruption_at_its_seams_leaves_all_or_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: signal.Signals, where: str
) -> None:
    """Just behind the making of the folder, the renaming, the removal of the old one."""
    write_folder(tmp_path / "out", KIND, fill)
    owner = {"mkdtemp": whole_folder.tempfile, "rename": Path, "rmtree": whole_folder.shutil}[where]
    does = getattr(owner, where)

    def interrupted(*arguments: object, **named: object) -> object:
        answer = does(*arguments, **named)
        ask(how)
        return answer

    monkeypatch.setattr(owner, where, interrupted)
    with stoppable(), pytest.raises(KeyboardInterrupt):
        write_folder(tmp_path / "out", KIND, fill)
    assert names(tmp_path) == {"out"}
    assert names(tmp_path / "out") == {"note.json"}
