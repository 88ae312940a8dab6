"""The runs of one piece of a batch, solved: fits side by side, then each run on its own."""

from __future__ import annotations

import tempfile
import traceback
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...analysis.analyse import Analysis, analyse
from ...analysis.answer.result import Result
from ...analysis.estimation.fit import LikelihoodFit, fits_of
from ...analysis.estimation.threads import one_blas_thread
from ...analysis.solution import require_noise_data
from ...experiments.batch.rows import BatchOffset, BatchRow, BatchSettings
from ...model.errors import BadInput, ZerobeamError
from ...model.files.run import Run
from ...model.likelihood.problem import Problem
from ...words.findings import headline
from ...words.result_json import dumps, to_json
from ...words.wording import person
from ..run.inputs import when_and_serial
from ..run.report import RESULT, write_report

TOGETHER = 16  # runs of a piece: their starts climb side by side in one thread


@dataclass(frozen=True, eq=False)
class BatchRun:
    """A run with its name in the batch, and the path of its file as it is shown."""

    name: str
    file: str
    run: Run


@dataclass(frozen=True, eq=False)
class Piece:
    """Runs that are solved together; an answer does not depend on which."""

    runs: tuple[BatchRun, ...]
    settings: BatchSettings


@dataclass(frozen=True, eq=False)
class BatchAnswer:
    """The row of a run, and the files of its folder by their path in it, packed: none where it failed."""

    row: BatchRow
    packed: dict[str, bytes]

    def files(self) -> dict[str, bytes]:
        return {name: zlib.decompress(content) for name, content in self.packed.items()}


def solved_piece(piece: Piece) -> list[BatchAnswer]:
    """The answer of every run; what goes wrong with one is said in its row, and the others go on."""
    with one_blas_thread():
        fits = _fits(piece)
        return [_answer(one, piece.settings, fits.get(one.name)) for one in piece.runs]


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


def _fits(piece: Piece) -> dict[str, LikelihoodFit]:
    """The fits that can be made side by side, by the run's name; whatever fails does so again on its own."""
    problems: dict[str, Problem] = {}
    for one in piece.runs:
        if one.run.header.geometry is None:
            try:
                one.run.require_analysable()
                problem = Problem.from_run(one.run)
                require_noise_data(problem)
            except ZerobeamError:
                continue
            problems[one.name] = problem
    try:
        return dict(zip(problems, fits_of(list(problems.values()), seed=piece.settings.seed), strict=True))
    except (BadInput, ArithmeticError, ValueError, np.linalg.LinAlgError):
        return {}


def _answer(one: BatchRun, settings: BatchSettings, fit: LikelihoodFit | None) -> BatchAnswer:
    try:
        found = analyse(one.run, seed=settings.seed, ess=settings.ess, sampling=settings.sampling, fit=fit)
        return BatchAnswer(_row(one, found.result), _packed(found, settings))
    except Exception as error:  # noqa: BLE001 - one bad run must not stop the others
        return BatchAnswer(failed(one.name, one.file, error, one.run), {})


def _packed(found: Analysis, settings: BatchSettings) -> dict[str, bytes]:
    if not settings.report:
        return {RESULT: zlib.compress(dumps(to_json(found.result)).encode("utf-8"), 1)}
    with tempfile.TemporaryDirectory() as aside:
        folder = write_report(Path(aside) / "report", found.result, found.draws).folder
        return {
            path.relative_to(folder).as_posix(): zlib.compress(path.read_bytes(), 1)
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }


def _row(one: BatchRun, result: Result) -> BatchRow:
    if not result.likelihood.converged:
        return failed(one.name, one.file, BadInput(headline(result, person)), one.run)
    fit, inputs = result.likelihood, result.inputs
    when, serial = when_and_serial(inputs)
    return BatchRow(
        name=one.name,
        file=one.file,
        outcome=result.verdict,
        message=headline(result, person),
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
    own = result.posterior
    if own.nothing_known:
        return "nothing identifiable"
    if own.omitted is not None:
        return "not needed" if own.omitted.enough else "not sampled"
    return "sampled" if own.converged else "not converged"
