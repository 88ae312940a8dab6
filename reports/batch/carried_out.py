"""A batch carried out: every file read, solved if it is not done already, and its folder written."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

from ...analysis.status import versions
from ...experiments.batch.rows import BatchRow, BatchSettings, Finished, key_of
from ...experiments.batch.run_files import names_of, shown_path
from ...experiments.processes import side_by_side
from ...experiments.studies.case_store import CaseStore
from ...model.arrays import Progress
from ...model.errors import BadInput, NotWritten, ZerobeamError
from ...model.files.run import read_run
from ...model.files.whole_file import write_whole
from ..output.whole_folder import names_in, write_folder
from ..run.report import REPORT, RESULT
from .batch_folder import FILES, write_batch
from .batch_page import Batch
from .solving import TOGETHER, BatchAnswer, BatchRun, Piece, failed, solved_piece

STORE = "finished.jsonl"


def batch(
    files: Sequence[Path],
    folder: Path,
    settings: BatchSettings,
    progress: Progress,
    *,
    parquet: bool = False,
    processes: int | None = None,
) -> Batch:
    """Solve the runs in `files`, each into a folder of its own in `folder`; then tables and page over all.

    A file that cannot be read or solved has a row that says so. What is done is not done again: it is
    recognised by the file's content, the arm, the settings and the program.
    """
    check_target(folder)
    with CaseStore(folder / STORE, {"batch": "runs"}, Finished, of="batch") as kept:
        found = _carried_out(files, folder, settings, progress, kept, processes)
        progress("writing", 1.0)
        done = Batch(tuple(found), settings, versions())
        write_batch(folder, done, parquet=parquet)
    return done


def check_target(folder: Path) -> None:
    """BadInput unless a batch may be written to `folder`: absent, empty, or one of ours."""
    allowed = "a folder that does not exist, is empty, or holds a batch of zerobeam"
    if folder.is_dir():
        names = names_in(folder)
        if names and STORE not in names:
            raise BadInput(
                f"the batch's folder {str(folder)!r} holds other things",
                found=", ".join(repr(name) for name in sorted(names)[:3]),
                allowed=allowed,
                remedy="name another folder, or move them away",
            )
    elif folder.exists() or folder.is_symlink():
        raise BadInput(
            f"the batch's folder {str(folder)!r} is a file", allowed=allowed, remedy="name another folder"
        )


def _carried_out(
    files: Sequence[Path],
    folder: Path,
    settings: BatchSettings,
    progress: Progress,
    kept: CaseStore[Finished],
    processes: int | None,
) -> list[BatchRow]:
    """The rows, in the order of the files."""
    earlier = list(kept.done.values())
    finished = {(own.row.name, own.key): own.row for own in earlier}
    shown = [shown_path(path, folder) for path in files]
    names = names_of(shown, {own.row.file: own.row.name for own in earlier}, FILES | {STORE})
    rows: dict[str, BatchRow] = {}
    keys: dict[str, str] = {}

    def told() -> None:
        progress(f"run {len(rows)}/{len(files)}", len(rows) / len(files))

    def left() -> Iterator[BatchRun]:
        for path, file in zip(files, shown, strict=True):
            name = names[file]
            try:
                run = read_run(path)
                keys[name] = key_of(run, settings)
            except (ZerobeamError, OSError) as error:
                rows[name] = failed(name, file, error)
                told()
                continue
            row = finished.get((name, keys[name]))
            if row is not None and (row.outcome == "failed" or _whole(folder / name, settings)):
                rows[name] = row
                told()
            else:
                yield BatchRun(name, file, run)

    # A process takes longer to start than a piece takes to solve.
    processes = min(processes or os.cpu_count() or 1, -(-len(files) // TOGETHER))
    with closing(side_by_side(solved_piece, _pieces(left(), settings), processes)) as answers:
        for _, piece in answers:
            for answer in piece:
                name = answer.row.name
                _write(folder / name, answer)
                kept.add(len(kept.done), Finished(keys[name], answer.row))
                rows[name] = answer.row
                told()
    return [rows[names[file]] for file in shown]


def _pieces(runs: Iterator[BatchRun], settings: BatchSettings) -> Iterator[Piece]:
    together: list[BatchRun] = []
    for one in runs:
        together.append(one)
        if len(together) == TOGETHER:
            yield Piece(tuple(together), settings)
            together = []
    if together:
        yield Piece(tuple(together), settings)


def _whole(folder: Path, settings: BatchSettings) -> bool:
    names = (RESULT, "report.html") if settings.report else (RESULT,)
    return all((folder / name).is_file() for name in names)


def _write(folder: Path, answer: BatchAnswer) -> None:
    """The folder of one run: whole or not at all; what was there before gives way."""
    files = answer.files()
    if not files:
        return
    there = names_in(folder) if folder.is_dir() else set()
    if list(files) == [RESULT] and there <= {RESULT}:
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise NotWritten(f"the folder cannot be made: {error.strerror}", file=folder) from None
        write_whole(folder / RESULT, files[RESULT], force=True)
        return

    def fill(aside: Path) -> None:
        for name, content in files.items():
            (aside / name).parent.mkdir(exist_ok=True)
            (aside / name).write_bytes(content)

    write_folder(folder, REPORT, fill)
