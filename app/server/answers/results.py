"""Results: what a `result.json` says, checked, with what lies beside it."""

from __future__ import annotations

import hashlib
import json
from collections import OrderedDict
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from ....analysis.result import RESULT_SCHEMA
from ....model.errors import BadInput
from ....model.files.reading import parse_json, read_text, shown
from ....reports.run.inputs import origin_of
from ....reports.run.report import REPORT_NAMES
from ..folder import Folder
from ..requests import EndPoint

LARGEST_RESULT = 16 * 10**6  # bytes
MOST_MEASUREMENTS = 1000  # listed: those of the largest residuals
MOST_HASHED = 16 * 10**6  # bytes of a run file that is looked for by its SHA-256
_MOST_KEPT = 2000
_MOST_FIGURES = 200

Value = TypeVar("Value")


class _Read(BaseModel):
    """Part of a result: types are held to, keys that the page does not need are left out."""

    model_config = ConfigDict(strict=True, extra="ignore", allow_inf_nan=False)


class _Parameter(_Read):
    name: str
    unit: str
    group: str
    status: Literal["identified", "weak", "unvalidated", "unidentifiable", "held"]
    held: bool
    estimate: float | None
    std: float | None
    interval95: list[float] | None
    prior_std: float
    reason: str | None

    @model_validator(mode="after")
    def _nothing_unknown_has_a_number(self) -> _Parameter:
        if self.status == "unidentifiable" and (self.estimate is not None or self.std is not None):
            raise ValueError(f"{self.name} is unidentifiable, yet it has a number")
        return self


class _Measurement(_Read):
    shot: int
    target: str
    whitened: float
    leave_one_out: float | None
    cooks: float | None


class _Criterion(_Read):
    sentence: str


class _Misfit(_Read):
    criteria: list[_Criterion]


class _Posterior(_Read):
    converged: bool
    message: str | None


class _Entry(_Read):
    name: str
    value: str
    expanded_u: str


class _Step(_Read):
    text: str
    commands: list[str]


class _NextSteps(_Read):
    enter: list[_Entry]
    steps: list[_Step]


class _Inputs(_Read):
    run: str
    sha256: str
    robot: str
    shots: int
    targets: list[str]
    versions: dict[str, str]
    header: dict[str, Any]


class ResultFile(_Read):
    """What the page needs of a `zerobeam/result/1`; results of earlier versions lack `next_steps`."""

    verdict: Literal["pass", "weak", "degenerate", "misfit"]
    headline: str
    parameters: list[_Parameter]
    posterior: _Posterior
    shots: list[_Measurement]
    misfit: _Misfit | None = None
    diagnosis: list[_Criterion] = []
    notes: list[str]
    next_steps: _NextSteps | None = None
    inputs: _Inputs

    @model_validator(mode="after")
    def _nothing_doubtful_is_entered(self) -> ResultFile:
        if self.verdict != "pass" and self.next_steps is not None and self.next_steps.enter:
            raise ValueError(f"the verdict is {self.verdict}, yet there are values to enter")
        if (self.verdict == "misfit") != (self.misfit is not None):
            raise ValueError(f"the verdict is {self.verdict}, and `misfit` says otherwise")
        return self


class Kept:
    """What was made of files, until they change; the oldest is forgotten."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._made: OrderedDict[tuple[str, int, int], Any] = OrderedDict()

    def of(self, path: Path, make: Callable[[Path], Value]) -> Value:
        """What `make` makes of the file as it is now."""
        facts = path.stat()
        key = (str(path), facts.st_mtime_ns, facts.st_size)
        if key not in self._made:
            made = make(path)
            self._made[key] = made
            while len(self._made) > self._most:
                self._made.popitem(last=False)
        self._made.move_to_end(key)
        found: Value = self._made[key]
        return found


_RESULTS, _SUMS = Kept(4), Kept(_MOST_KEPT)


def read_result(path: Path) -> ResultFile:
    """A result file; BadInput where it is none, not whole, too large, or contradicts itself."""
    return _RESULTS.of(path, _read)


def _read(path: Path) -> ResultFile:
    text, _ = read_text(path, LARGEST_RESULT)
    try:
        answer = parse_json(text, file=path, line=1)
        schema = answer.get("schema") if isinstance(answer, dict) else None
        if schema != RESULT_SCHEMA:
            raise ValueError(f"schema {shown(schema)}")
        return ResultFile.model_validate(answer)
    except ValidationError as error:
        first = error.errors()[0]
        found = f"{'.'.join(map(str, first['loc']))}: {first['msg']}".removeprefix(": ")
    except (json.JSONDecodeError, RecursionError) as error:
        found = f"the file is no JSON, or cut off: {error}"
    except ValueError as error:
        found = str(error)
    raise BadInput(
        "this is not a whole result of zerobeam",
        found=found[:300],
        allowed=f"a result.json of schema {RESULT_SCHEMA}",
        remedy="make it again with zerobeam report",
        file=path,
    )


def result(folder: Folder, name: str) -> dict[str, Any]:
    """What a result says, the `files` of its report, and the `run` of the folder that it was made of."""
    path = folder.file(name)
    found = read_result(path)
    beside = report_files(path)
    run = run_of(folder, found.inputs.sha256, path)
    drawn = [own for own in found.parameters if own.group in ("offset", "tool", "noise")]
    ranked = sorted(range(len(found.shots)), key=lambda i: -found.shots[i].whitened)[:MOST_MEASUREMENTS]
    inputs = found.inputs
    return {
        "file": folder.called(path),
        "run": None if run is None else folder.called(run),
        "report": _called(folder, path.with_name("report.html"), beside),
        "posterior_file": _called(folder, path.with_name("posterior.nc"), beside),
        "files": [{"path": folder.called(own), "bytes": own.stat().st_size} for own in beside],
        **found.model_dump(include={"verdict", "headline", "notes", "next_steps", "posterior"}),
        "misfit": [] if found.misfit is None else [own.sentence for own in found.misfit.criteria],
        "diagnosis": [own.sentence for own in found.diagnosis],
        "parameters": [own.model_dump() for own in drawn],
        "shots": [found.shots[i].model_dump() for i in sorted(ranked)],
        "inputs": inputs.model_dump(include={"run", "sha256", "robot", "shots", "targets"})
        | {"version": inputs.versions.get("zerobeam"), **origin_of(inputs.header)},
    }


def report_files(result_file: Path) -> list[Path]:
    """The files of the report that a result belongs to: by the names that a report has, and no others."""
    found = []
    for name in sorted(REPORT_NAMES):
        path = result_file.with_name(name)
        if path.is_symlink():
            continue
        inner = sorted(islice(path.iterdir(), _MOST_FIGURES)) if path.is_dir() else [path]
        found += [own for own in inner if own.is_file() and not own.is_symlink()]
    return found if result_file.name in REPORT_NAMES else [result_file]


def _called(folder: Folder, path: Path, beside: list[Path]) -> str | None:
    return folder.called(path) if path in beside else None


def run_of(folder: Folder, sha256: str, near: Path) -> Path | None:
    """The run file of the folder that has this SHA-256, the nearest first; None where there is none."""
    for path in sorted(_runs(folder), key=lambda own: -len(_shared(own, near))):
        if sha256_of(path) == sha256:
            return path
    return None


def sha256_of(path: Path) -> str | None:
    """Of a run file; None where it is too large to be looked for, or has gone."""
    try:
        return _SUMS.of(path, _sum) if path.stat().st_size <= MOST_HASHED else None
    except OSError:
        return None


def _sum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _runs(folder: Folder) -> Iterator[Path]:
    return (folder.root / file.path for file in folder.files() if file.kind == "run")


def _shared(path: Path, near: Path) -> tuple[str, ...]:
    pairs = zip(path.parts, near.parts, strict=False)
    return tuple(one for i, (one, other) in enumerate(pairs) if path.parts[: i + 1] == near.parts[: i + 1])


END_POINTS = [
    EndPoint(
        "/api/result",
        "GET",
        "A result for people: verdict, next steps, parameters, measurements, the files of its report.",
        result,
        query=("file",),
    ),
]
