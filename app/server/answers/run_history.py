"""The runs of the folder by the serial number of their robot, with what their results say."""

from __future__ import annotations

from typing import Annotated, ClassVar

from ....analysis.answer.answer_message import Grade
from ....analysis.answer.result import Result
from ....analysis.row import StatusRow
from ....analysis.status import Verdict
from ....model.errors import BadInput
from ....model.records import if_any, it, record
from ....reports.run.inputs import origin_of
from ....words.message import read_message, result_words
from ....words.wording import clipped
from ..folder import Folder
from ..index import Facts, Head, Index, Unread
from ..requests import end_point
from ..versions import version_of_sum

MOST_RUNS = 300  # the newest
MOST_RESULTS = 300
_WIDTH = 80  # letters of a text that a header states


@record(kw_only=True)
class BriefOffset(StatusRow):
    """An offset of a result, which is not held."""

    absent: ClassVar[tuple[str, ...]] = ("held",)

    estimate: float | None
    std: float | None


@record(kw_only=True)
class BriefResult:
    """A result of the folder."""

    file: str
    verdict: Annotated[Verdict | None, if_any] = None
    grade: Annotated[Grade | None, it("how it is coloured"), if_any] = None
    words: Annotated[str | None, it("verdict and worth in words"), if_any] = None
    offsets: Annotated[list[BriefOffset] | None, if_any] = None
    error: Annotated[str | None, it("why it cannot be read"), if_any] = None


@record(kw_only=True)
class BriefRun:
    """A run of the folder: what its header states, and its results, the newest first."""

    file: str
    robot: Annotated[str | None, if_any] = None
    serial: Annotated[str | None, if_any] = None
    when: Annotated[str | None, if_any] = None
    who: Annotated[str | None, if_any] = None
    instrument: Annotated[str | None, if_any] = None
    origin: Annotated[str | None, if_any] = None
    error: Annotated[str | None, it("why it cannot be read"), if_any] = None
    results: list[BriefResult]


@record(kw_only=True)
class FolderHistory:
    """The runs of the folder, and the results of no run here; `left_out` counts what is not listed."""

    runs: list[BriefRun]
    results: list[BriefResult]
    left_out: int


@end_point("GET /api/history", "The folder's runs by serial number, and their results.")
def history(folder: Folder) -> FolderHistory:
    """The runs and results of the folder, the newest first."""
    index = Index(folder)
    runs, results = index.of_kinds("run"), index.of_kinds("result")
    by_version: dict[str | None, list[BriefResult]] = {}
    for file in results[:MOST_RESULTS]:
        facts = index.facts(file)
        of = version_of_sum(facts.inputs.sha256) if isinstance(facts, Result) else None
        by_version.setdefault(of, []).append(_brief(file.path, facts))
    rows = [
        BriefRun(file=file.path, **_of_header(index.facts(file)), results=by_version.get(file.version, []))
        for file in runs[:MOST_RUNS]
    ]
    versions = {file.version for file in runs[:MOST_RUNS]}
    loose = [brief for of, briefs in by_version.items() if of not in versions for brief in briefs]
    left_out = max(0, len(runs) - MOST_RUNS) + max(0, len(results) - MOST_RESULTS)
    return FolderHistory(runs=rows, results=loose, left_out=left_out)


def _of_header(facts: Facts) -> dict[str, str]:
    """What the header of a run states, or why it cannot be read."""
    if not isinstance(facts, Head):
        return {"error": facts.why if isinstance(facts, Unread) else "the file is no run any more"}
    robot = facts.header.get("robot")
    name = robot.get("urdf") if isinstance(robot, dict) else robot
    try:
        origin = origin_of(facts.header)
    except (BadInput, KeyError, TypeError):
        return {"error": "the instruments of this run cannot be read"}
    return {key: clipped(text, _WIDTH) for key, text in {"robot": str(name), **origin}.items()}


def _brief(name: str, facts: Facts) -> BriefResult:
    if not isinstance(facts, Result):
        why = facts.why if isinstance(facts, Unread) else "the file is no result any more"
        return BriefResult(file=name, error=why)
    return BriefResult(
        file=name,
        verdict=facts.verdict,
        grade=read_message(facts).grade,
        words=result_words(facts),
        offsets=[
            BriefOffset(name=row.name, unit=row.unit, status=row.status, estimate=row.estimate, std=row.std)
            for row in facts.offsets
            if not row.held
        ],
    )
