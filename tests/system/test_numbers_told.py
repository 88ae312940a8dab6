"""Every number that a reader meets in report.html and report.pdf is one of result.json, or follows from it.

The documents are read as text, knowing nothing of how they were made: each number must be the rounding of a
number of the result, of one of the few quantities that a report works out, or stand on the axis of a figure.
"""

import bisect
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pypdf
import pytest
from command_line import zerobeam
from demo_reports import demo_reports
from exact_runs import demo_runs
from pages import Page

# In the words themselves: years and clauses of the GUM, quantiles, draws that are advised, the scene's grid,
# the chances beyond which only the side is said, the turn of joint 1 that is in front of the arm.
OF_THE_WORDS = (2.5, 19.0, 50.0, 95.0, 97.5, 100.0, 101.0, 2008.0, 20_000.0, 500.0, 0.001, 0.999, 90.0)
MINOR = 0.05  # of a variance: what is less in every column is one of the "others"
NUMBER = re.compile(r"(?<![\w.])[-\u2212]?\d+(?:\.\d+)?(?:e[-\u2212]?\d+)?(?!\w|\.\d)")


def of_the_result(value: Any) -> Iterator[float]:
    """All numbers, those in texts and keys too, and how many entries a list has."""
    if isinstance(value, str):
        yield from (float(found) for found in re.findall(r"(?:(?<!\w)-)?\d+(?:\.\d+)?(?:e-?\d+)?", value))
    elif isinstance(value, int | float):
        yield float(value)
    elif isinstance(value, list | dict):
        yield float(len(value))
        for key in value if isinstance(value, dict) else ():
            yield from of_the_result(key)
        for item in value.values() if isinstance(value, dict) else value:
            yield from of_the_result(item)


def worked_out(answer: Any) -> Iterator[float]:
    """The length of a miss, expanded uncertainties, how far apart two costs are by them, shares and chances
    in percent, small sources together, what the draws cannot decide, errors of a rehearsal."""
    k = answer["coverage_factor"]
    yield from (math.hypot(*shot["miss_mm"]) for shot in answer["shots"])
    for stds in (answer["geometry"][key] or {} for key in ("consider", "at_half", "at_twice")):
        yield from (k * std for std in stds.values())
    yield from (100 * wrong[key] for wrong in answer["power"] or () for key in ("probability", "risk"))
    for direction in answer["identifiability"]["null_space"]:
        yield from map(abs, direction["combination"].values())  # its sign is set apart
    for row in answer["parameters"]:
        if row["std"] is not None:
            yield k * row["std"]
        if row["midpoint"] is not None and row["std"] is not None:
            yield (row["midpoint"] - row["estimate"]) / (k * row["std"])
        true = answer["inputs"]["header"].get("provenance", {}).get(f"true {row['name']} ({row['unit']})")
        if true is not None and row["std"] is not None:
            yield from (row["estimate"] - true, (row["estimate"] - true) / row["std"])
        if row.get("tolerance_share") is not None:
            yield 100 * row["tolerance_share"]
        if row["group"] == "geometry" and row["std"] is not None:
            yield 100 * max(1 - row["std"] / row["prior_std"], 0)
    rows = [row for row in answer["parameters"] if row["group"] == "geometry" and not row["held"]]
    yield from (len(rows), sum(row["estimate"] is None for row in rows))
    if answer["geometry"]["factors"] is not None:
        yield from (100 * u for u in answer["geometry"]["factors"]["log_u"] if u is not None)
    for budget in answer["budget"]:
        offset = budget["name"].startswith("delta")
        own = [other["rows"] for other in answer["budget"] if other["name"].startswith("delta") == offset]
        # Small in every column of the table, not in one.
        order = sorted(range(len(budget["rows"])), key=lambda i: max(abs(rows[i]["share"]) for rows in own))
        yield sum(max(abs(rows[i]["share"]) for rows in own) < MINOR for i in order)
        ranked = [budget["rows"][i] for i in order]
        for rows in (*([row] for row in ranked), *(ranked[:count] for count in range(2, len(ranked)))):
            yield 100 * sum(row["share"] for row in rows)
            square = sum(math.copysign(row["contribution"] ** 2, row["contribution"]) for row in rows)
            yield math.copysign(math.sqrt(abs(square)), square)
        if budget["check"] is not None:
            yield 2 * budget["check"]["ends_std"]


def on_axes(figures: Path) -> Iterator[float]:
    for file in figures.iterdir():
        for text in re.findall(r">([^<>]*)</(?:text|tspan)>", file.read_text(encoding="utf-8")):
            yield from (value(found) for found in NUMBER.findall(text))


def magnified(page: str) -> Iterator[float]:
    """How many times larger residuals are drawn, a round number, and what 100 mm of the axes then are."""
    for told in re.findall(r"drawn (\S+) times larger \(100 mm of the axes are (\S+)\xa0mm\)", page):
        factor, size = map(float, told)
        assert factor * size == pytest.approx(100)
        assert f"{factor:e}"[:2] in ("1.", "2.", "5.")
        yield from (factor, size)


def value(told: str) -> float:
    return float(told.replace("\u2212", "-"))


def made_up(text: str, known: list[float]) -> list[str]:
    """The numbers in a text that are no rounding of one that is known (sorted)."""
    found = []
    for told in NUMBER.findall(text):
        digits, _, power = told.partition("e")
        half = 0.5000001 * 10.0 ** (value(power or "0") - len(digits.partition(".")[2]))
        at = bisect.bisect_left(known, value(told) - half)
        if at == len(known) or known[at] > value(told) + half:
            found.append(told)
    return found


@pytest.fixture(scope="module")
def with_geometry(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("told")
    header, *shots = demo_runs()[0].path.read_text(encoding="utf-8").splitlines()
    stated = json.dumps({**json.loads(header), "geometry": {"scale": "estimated"}})
    (folder / "run.jsonl").write_text("\n".join([stated, *shots]), encoding="utf-8")
    told = zerobeam("report", folder / "run.jsonl", "-o", folder / "report", "--ess", "100")
    assert told.status in (0, 1)
    return folder / "report"


@pytest.mark.parametrize("name", ["x-pattern", "uncalibrated"])
def test_no_number_is_made_up(name: str) -> None:
    none_is_made_up(demo_reports().folder / name)


@pytest.mark.long
def test_no_number_is_made_up_of_the_geometry(with_geometry: Path) -> None:
    none_is_made_up(with_geometry)


def none_is_made_up(report: Path) -> None:
    answer = json.loads((report / "result.json").read_text(encoding="utf-8"))
    page = " ".join(Page((report / "report.html").read_text(encoding="utf-8")).text)
    sheets = pypdf.PdfReader(report / "report.pdf").pages
    paper = " ".join(sheet.extract_text() for sheet in sheets).replace("\u200b", "")
    rest = [*OF_THE_WORDS, *on_axes(report / "figures"), *map(float, range(len(sheets) + 1))]
    rest += magnified(page)
    known = sorted([*of_the_result(answer), *worked_out(answer), *rest])
    assert len(NUMBER.findall(page)) > 300
    assert made_up(page, known) == []
    assert made_up(paper, known) == []
    # The control: of another result the same words would be.
    rows = [row for row in answer["parameters"] if row["std"] is not None]
    for row in rows:
        row["estimate"] += 5 * row["std"]
        row["interval95"] = [bound + 5 * row["std"] for bound in row["interval95"]]
    other = sorted([*of_the_result({**answer, "posterior": None, "scene": None}), *rest])
    assert len(made_up(page, other)) >= len(rows)
