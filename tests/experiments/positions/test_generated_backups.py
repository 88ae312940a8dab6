"""Backups made at random: every position keeps its place, and everything else its bytes."""

import re
from pathlib import Path

import numpy as np
import pytest
from made_backups import DIALECTS, ENTERED, Dialect, MadeBackup, kept, texts_after, written

from zerobeam.experiments.converted_programs import restored
from zerobeam.experiments.positions.conversion import Conversion
from zerobeam.model.arrays import Matrix
from zerobeam.reports.positions_page import write_conversion

# 300 seeds a language; all but the first are long, by 23 in one test.
SEEDS = [range(1), *(pytest.param(range(k, k + 23), marks=pytest.mark.long) for k in range(1, 300, 23))]


@pytest.mark.parametrize("seeds", SEEDS, ids=lambda seeds: f"{seeds[0]}-{seeds[-1]}")
@pytest.mark.parametrize("language", DIALECTS)
def test_positions_keep_their_places(language: str, seeds: range, tmp_path: Path) -> None:
    for seed in seeds:
        require_kept(DIALECTS[language], seed, tmp_path / str(seed))


def require_kept(dialect: Dialect, seed: int, folder: Path) -> None:
    backup = dialect.made(seed, stepped=True)
    entered = ENTERED * np.random.default_rng(seed).choice([-1, 1], 6)
    answer = kept(written(backup, folder), dialect.robot, entered, **backup.options)
    assert answer.refused == ()
    assert answer.to_state == ()
    assert answer.open_lines == []
    assert len(answer.positions) == len(backup.positions)
    if backup.step is not None:
        require_shift(answer, backup, entered)
    after = texts_after(backup, answer)
    assert backup.kept(after, entered)
    assert not backup.kept(backup.texts, entered)
    assert not backup.kept(after, -entered)
    for one in answer.files:
        old, new = backup.texts[one.file], after[one.file]
        assert rest(old, one.file, answer) == rest(new, one.file, answer, new=True)


def require_shift(answer: Conversion, backup: MadeBackup, entered: Matrix) -> None:
    """A relative motion is listed with the shift by which it ends elsewhere."""
    assert backup.step is not None
    (line,) = (one for one in answer.listed if (one.file, one.line) == backup.step_line)
    shift = backup.shift(entered)
    assert line.kind == "relative"
    assert line.per_100_mm == (backup.step.offset is None and shift is not None)
    assert line.shift_mm == (None if shift is None else pytest.approx(shift, abs=2e-3))


def rest(text: str, file: str, answer: Conversion, *, new: bool = False) -> str:
    """A file without the numbers that were edited."""
    (edits,) = (one.edits for one in answer.files if one.file == file)
    parts, at, shift = [], 0, 0
    for edit in edits:
        start = edit.start + (shift if new else 0)
        parts.append(text[at:start])
        at = start + len(edit.new if new else edit.old)
        shift += len(edit.new) - len(edit.old)
        assert re.fullmatch(r"[-+ .\deE,]+", edit.old + edit.new)
    return "".join([*parts, text[at:]])


@pytest.mark.one_in(3)
@pytest.mark.parametrize("language", DIALECTS)
def test_keep_then_restore_gives_every_byte(language: str, tmp_path: Path) -> None:
    dialect = DIALECTS[language]
    backup = dialect.made(1, stepped=True)
    answer = kept(written(backup, tmp_path / "backup"), dialect.robot, **backup.options)
    write_conversion(tmp_path / "new", answer)
    for name, content in answer.content.items():
        assert (tmp_path / "new" / name).read_bytes() == content
    assert restored(tmp_path / "new") == {
        one.file: backup.texts[one.file].encode("latin-1") for one in answer.files
    }
