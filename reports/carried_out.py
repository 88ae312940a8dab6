"""A batch carried out: every file read, solved if it is not done already, and its folder written."""

from __future__ import annotations

import os
import tempfile
import traceback
import zlib
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ..analysis.analyse import Analysis, analyse
from ..analysis.answer.result import Result
from ..analysis.status import versions
from ..experiments.batch import Batch, BatchOffset, BatchRow, Finished, key_of, names_of, shown_path
from ..experiments.command_options import BatchSettings
from ..experiments.processes import side_by_side
from ..experiments.studies.cases import CaseStore
from ..model.arrays import Progress
from ..model.errors import BadInput, NotWritten, ZerobeamError
from ..model.files.run import Run, read_run
from ..model.files.whole_file import write_whole
from ..model.records import dumps
from ..words.message import contradicted, falls_short, headline, message
from ..words.provenance import is_simulated
from ..words.sentences import to_json
from ..words.wording import person
from .batch_page import FILES, write_batch
from .output.whole_folder import names_in, write_folder
from .run.inputs import when_and_serial
from .run.report import REPORT, RESULT, write_report

STORE = "finished.jsonl"
OF_A_PROCESS = 16  # runs at least: it takes longer to start than a few take to solve


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
        rows = _carried_out(files, folder, settings, progress, kept, processes)
        progress("writing", 1.0)
        done = Batch(tuple(rows), settings, versions())
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
    finished = {(case.row.name, case.key): case.row for case in earlier}
    shown = [shown_path(path, folder) for path in files]
    names = names_of(shown, {case.row.file: case.row.name for case in earlier}, FILES | {STORE})
    rows: dict[str, BatchRow] = {}
    keys: dict[str, str] = {}

    def tell() -> None:
        progress(f"run {len(rows)}/{len(files)}", len(rows) / len(files))

    def left() -> Iterator[BatchRun]:
        for path, file in zip(files, shown, strict=True):
            name = names[file]
            try:
                run = read_run(path)
                keys[name] = key_of(run, settings)
            except (ZerobeamError, OSError) as error:
                rows[name] = failed(name, file, error)
                tell()
                continue
            row = finished.get((name, keys[name]))
            if row is not None and (row.outcome == "failed" or _whole(folder / name, settings)):
                rows[name] = row
                tell()
            else:
                yield BatchRun(name, file, run)

    processes = min(processes or os.cpu_count() or 1, -(-len(files) // OF_A_PROCESS))
    with closing(side_by_side(partial(solved, settings=settings), left(), processes)) as answers:
        for _, answer in answers:
            name = answer.row.name
            _write(folder / name, answer)
            kept.add(len(kept.done), Finished(keys[name], answer.row))
            rows[name] = answer.row
            tell()
    return [rows[names[file]] for file in shown]


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

    def fill(new_folder: Path) -> None:
        for name, content in files.items():
            (new_folder / name).parent.mkdir(exist_ok=True)
            (new_folder / name).write_bytes(content)

    write_folder(folder, REPORT, fill)


@dataclass(frozen=True, eq=False)
class BatchRun:
    """A run with its name in the batch, and the path of its file as it is shown."""

    name: str
    file: str
    run: Run


@dataclass(frozen=True, eq=False)
class BatchAnswer:
    """The row of a run, and the files of its folder by their path in it, packed: none where it failed."""

    row: BatchRow
    packed: dict[str, bytes]

    def files(self) -> dict[str, bytes]:
        return {name: zlib.decompress(content) for name, content in self.packed.items()}


def solved(one: BatchRun, settings: BatchSettings) -> BatchAnswer:
    """The answer of a run; what goes wrong with it is said in its row, and the others go on."""
    try:
        analysis = analyse(one.run, seed=settings.seed, ess=settings.ess, sampling=settings.sampling)
        return BatchAnswer(_row(one, analysis.result), _packed(analysis, settings))
    except Exception as error:  # noqa: BLE001 - one bad run must not stop the others
        return BatchAnswer(failed(one.name, one.file, error, one.run), {})


def failed(name: str, file: str, error: Exception, run: Run | None = None) -> BatchRow:
    """The row of a run that could not be solved."""
    if isinstance(error, ZerobeamError):
        message = str(error)
        if isinstance(error, BadInput) and error.file is not None:  # it has a column of its own
            message = message.removeprefix(error.file).lstrip(",: ")
    else:
        last = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"
        message = f"a fault of zerobeam itself, please report it: {what}"
    sha256, robot = (None, None) if run is None else (run.sha256, run.robot.name)
    return BatchRow(name, file, "failed", message, sha256, robot)


def _packed(analysis: Analysis, settings: BatchSettings) -> dict[str, bytes]:
    if not settings.report:
        return {RESULT: zlib.compress(dumps(to_json(analysis.result)).encode("utf-8"), 1)}
    with tempfile.TemporaryDirectory() as scratch:
        folder = write_report(Path(scratch) / "report", analysis.result, analysis.draws).folder
        return {
            path.relative_to(folder).as_posix(): zlib.compress(path.read_bytes(), 1)
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }


def _row(one: BatchRun, result: Result) -> BatchRow:
    if not result.likelihood.converged:
        return failed(one.name, one.file, BadInput(message(result).verdict), one.run)
    fit, inputs, content = result.likelihood, result.inputs, message(result)
    nothing_entered = contradicted(result.verdict, content)
    short = falls_short(result.verdict, content)
    sentence = content.verdict if short else headline(result, person)
    if nothing_entered:
        sentence = f"{sentence} {content.action.text}"
    when, serial = when_and_serial(inputs)
    return BatchRow(
        name=one.name,
        file=one.file,
        outcome="weak" if nothing_entered else result.verdict,
        message=sentence,
        simulated=is_simulated(inputs.provenance),
        contradicted=nothing_entered,
        falls_short=short,
        sha256=inputs.sha256,
        robot=inputs.robot,
        serial=serial,
        when=when,
        measurements=inputs.shots,
        factor=float(np.sqrt(fit.chi2 / fit.dof)) if fit.dof and fit.noise_known else None,
        p_value=fit.p_value,
        misfit=() if result.misfit is None else tuple(part.kind for part in result.misfit.criteria),
        posterior=_posterior(result),
        offsets=tuple(
            BatchOffset(row.name, row.unit, row.status, row.estimate, row.std, row.interval95)
            for row in result.parameters
            if row.group == "offset"
        ),
    )


def _posterior(result: Result) -> str:
    posterior = result.posterior
    if posterior.useless is not None:
        return "nothing identifiable" if posterior.useless == "nothing known" else "not needed"
    if posterior.omitted is not None:
        return "not needed" if posterior.omitted.enough else "not sampled"
    return "sampled" if posterior.converged else "not converged"
