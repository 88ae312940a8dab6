"""The place Result: what its end points say is what the commands and the report's files say."""

import io
import json
import os
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

import zerobeam as zb
from zerobeam.app.server.routes import archive
from zerobeam.reports.output.html import fragment
from zerobeam.reports.run.front import front as page_one
from zerobeam.words.message import message


@pytest.fixture
def there(root: Path, reported: Path) -> Path:
    """The app's folder with the runs and reports in it."""
    shutil.copytree(reported, root, dirs_exist_ok=True)
    (root / "run.jsonl").unlink()
    return root


def _result(client: TestClient, file: str = "good/result.json") -> Any:
    return client.get("/api/result", params={"file": file}).json()


def test_a_result_is_what_its_file_says(client: TestClient, there: Path) -> None:
    stated = json.loads((there / "good/result.json").read_text())
    shown = _result(client)
    for key in ("verdict", "message", "coverage_factor", "headline", "notes", "next_steps"):
        assert shown[key] == stated[key]
    assert [row["name"] for row in shown["next_steps"]["enter"]]
    rows = {row["name"]: row for row in stated["parameters"]}
    for row in shown["parameters"]:
        assert row == {key: rows[row["name"]][key] for key in row}
    assert [row["shot"] for row in shown["shots"]] == [row["shot"] for row in stated["shots"]]
    assert shown["run"] == "good.jsonl"
    assert shown["report"] == "good/report.html"
    files = {path.relative_to(there).as_posix() for path in (there / "good").rglob("*") if path.is_file()}
    assert {row["path"] for row in shown["files"]} == files


def test_nothing_may_be_entered_of_what_is_not_determined(client: TestClient, there: Path) -> None:
    shown = _result(client, "x-pattern/result.json")
    assert shown["verdict"] == "degenerate"
    assert shown["next_steps"]["enter"] == []
    assert shown["next_steps"]["steps"][0]["text"].startswith("Enter nothing yet")
    unknown = [row for row in shown["parameters"] if row["status"] == "unidentifiable"]
    assert unknown
    assert all(row["estimate"] is row["std"] is row["interval95"] is None for row in unknown)
    rows = re.findall(r"<tr.*?</tr>", shown["front"], re.DOTALL)
    row = next(each for each in rows if "<bdi>J2</bdi>" in each)
    assert "not determined" in row
    assert "°" not in row.replace("U > 0.2°", "")


def test_the_motion_that_the_readings_leave_open_is_shown(client: TestClient, there: Path) -> None:
    front = _result(client, "x-pattern/result.json")["front"]
    assert front.count('<figure class="motion">') == 1
    assert "both ends fit the readings equally; no position here is an estimate" in front
    assert "<animate" in front
    assert re.search(_FORBIDDEN, front) is None
    assert 'class="motion"' not in _result(client)["front"]


_FORBIDDEN = r"<(script|style)|\bstyle=|\bon\w+="  # by the page's policy


def test_the_first_page_is_that_of_the_report(client: TestClient, there: Path) -> None:
    """Tables and bars, though read from the file; without style or script, which the page does not allow."""
    front = _result(client)["front"]
    assert re.search(_FORBIDDEN, front) is None
    result = zb.analyse(zb.read_run(there / "good.jsonl"), ess=100).result
    assert _texts(front) == _texts(fragment(page_one(result, message(result)), {}))
    assert "corrected reading" not in front  # of a simulated run nothing is entered
    assert "would enter" in front
    assert "TCP error, median (95 % stay below)" in front


def _texts(page: str) -> list[str]:
    return [text for text in re.split(r"<[^>]*>|\n", page) if text.strip()]


# How each stands in the list of the history: with its error, or not at all where it is none of ours.
ODD: dict[str, tuple[Callable[[str], str], list[str]]] = {
    "cut off": (lambda text: text[: len(text) // 2], ["good/result.json"]),
    "of an unknown verdict": (lambda text: text.replace('"pass"', '"fine"'), ["good/result.json"]),
    "not ours": (lambda text: '{"schema": "other"}', []),
    "nested": (lambda text: "[" * 100_000, []),
}


@pytest.mark.parametrize("kind", ODD)
def test_an_odd_result_gets_one_clear_error(client: TestClient, there: Path, kind: str) -> None:
    """What else a result may not be is tested in analysis/answer/test_result.py."""
    file, (change, listed) = there / "good/result.json", ODD[kind]
    file.write_text(change(file.read_text()))
    answer = client.get("/api/result", params={"file": "good/result.json"})
    assert answer.status_code == 400
    assert answer.json()["error"]["what"].startswith("good/result.json")
    assert str(there) not in answer.text
    history = client.get("/api/history").json()
    assert [row["file"] for row in history["results"] if "error" in row] == listed


def test_a_result_of_before_there_were_next_steps_offers_none(client: TestClient, there: Path) -> None:
    file = there / "good/result.json"
    answer = json.loads(file.read_text())
    del answer["next_steps"]
    file.write_text(json.dumps(answer))
    assert _result(client)["next_steps"] is None
    assert _result(client)["front"] is None


def test_a_result_that_is_too_large_is_refused(client: TestClient, there: Path) -> None:
    with (there / "good/result.json").open("r+b") as file:
        file.seek(80 * 10**6)
        file.write(b"}")
    error = client.get("/api/result", params={"file": "good/result.json"})
    assert error.status_code == 400
    assert "too large" in error.json()["error"]["what"]


@pytest.mark.long
def test_without_a_measurement_it_is_what_analyse_says_of_the_others(client: TestClient, there: Path) -> None:
    """Of an exact arm; of a typical one the model of all measurements is kept (see below)."""
    header, *shots = (there / "good.jsonl").read_text().splitlines()
    exact = json.dumps(json.loads(header) | {"geometry": "exact"})
    (there / "exact.jsonl").write_text("\n".join([exact, *shots, ""]))
    run = zb.read_run(there / "exact.jsonl")
    numbers = [shot.shot for shot in run.shots]
    for without in ([], [numbers[2]], numbers[1:3]):
        left = [shot for shot in run.shots if shot.shot not in without]
        other = zb.Run.of_shots(run.header, run.robot, left, "left")
        same = zb.analyse(other, ess=100)
        answer = client.post("/api/refit", json={"run": "exact.jsonl", "without": without}).json()
        assert answer["verdict"] == same.verdict
        assert answer["headline"] == same.to_json()["headline"]
        assert (answer["measurements"], answer["of"]) == (len(left), len(numbers))
        for row in answer["parameters"]:
            own = same[row["name"]]
            assert row["status"] == own.status
            if own.u is not None:
                np.testing.assert_allclose([row["estimate"], row["std"]], [own.estimate, own.u], rtol=1e-6)
    assert answer["parameters"][1]["before"]["estimate"] != answer["parameters"][1]["estimate"]


def test_a_direction_that_is_lost_with_a_measurement_is_said(client: TestClient, there: Path) -> None:
    numbers = [shot.shot for shot in zb.read_run(there / "good.jsonl").shots]
    answer = client.post("/api/refit", json={"run": "good.jsonl", "without": numbers[2:]}).json()
    assert answer["verdict"] == "degenerate"
    assert "delta2" in answer["lost"]
    assert answer["null_space"]
    lost = [row for row in answer["parameters"] if row["name"] in answer["lost"]]
    assert all(row["estimate"] is row["std"] is None for row in lost)
    assert all(row["before"]["estimate"] is not None for row in lost)


def test_with_an_uncertain_geometry_it_keeps_the_model_and_agrees(client: TestClient, there: Path) -> None:
    header, *shots = (there / "good.jsonl").read_text().splitlines()
    stated = json.loads(header) | {"geometry": {}}
    (there / "links.jsonl").write_text("\n".join([json.dumps(stated), *shots, ""]))
    (there / "left.jsonl").write_text("\n".join([json.dumps(stated), *shots[1:], ""]))
    left = json.loads(shots[0])["shot"]
    answer = client.post("/api/refit", json={"run": "links.jsonl", "without": [left]}).json()
    anew = client.post("/api/refit", json={"run": "left.jsonl"}).json()
    assert answer["headline"] == anew["headline"]
    for one, other in zip(answer["parameters"], anew["parameters"], strict=True):
        assert one["status"] == other["status"]
        if one["std"] is not None:
            assert other["estimate"] == pytest.approx(one["estimate"], abs=0.1 * one["std"])
            assert other["std"] == pytest.approx(one["std"], rel=0.05)


@pytest.mark.parametrize(("without", "said"), [([99], "number"), ([0, 1, 2, 3, 4, 5], "so few")])
def test_what_cannot_be_left_out_is_said(
    client: TestClient, there: Path, without: list[int], said: str
) -> None:
    answer = client.post("/api/refit", json={"run": "good.jsonl", "without": without})
    assert answer.status_code == 400
    assert said in answer.json()["error"]["what"]


def test_a_run_is_saved_without_measurements_as_a_new_file_that_says_so(
    client: TestClient, there: Path
) -> None:
    original = (there / "good.jsonl").read_bytes()
    answers = [client.post("/api/runs", json={"run": "good.jsonl", "without": [3, 1, 3]}) for _ in range(2)]
    assert [answer.status_code for answer in answers] == [201, 201]
    files = [answer.json()["file"] for answer in answers]
    assert files == ["good-without-1-3.jsonl", "good-without-1-3-2.jsonl"]
    whole, run = zb.read_run(there / "good.jsonl"), zb.read_run(there / files[0])
    assert [shot.shot for shot in run.shots] == [s.shot for s in whole.shots if s.shot not in (1, 3)]
    assert run.header.provenance["without measurements"] == "1, 3"
    assert run.header.provenance["made of"] == f"good.jsonl (SHA-256 {whole.sha256})"
    assert (there / "good.jsonl").read_bytes() == original
    rows = {row["file"] for row in client.get("/api/history").json()["runs"]}
    assert rows >= set(files)


@pytest.mark.parametrize("without", [[], [99], [*range(8)], ["1"]])
def test_a_run_is_not_saved_without_what_it_lacks_or_nearly_all(
    client: TestClient, there: Path, without: list[object]
) -> None:
    before = sorted(there.iterdir())
    assert client.post("/api/runs", json={"run": "good.jsonl", "without": without}).status_code == 400
    assert sorted(there.iterdir()) == before


def test_the_draws_are_those_of_the_posterior(client: TestClient, there: Path) -> None:
    answer = client.get("/api/posterior", params={"file": "good/posterior.nc"}).json()
    stated = {
        row["name"]: row
        for row in json.loads((there / "good/result.json").read_text())["posterior"]["parameters"]
    }
    assert answer["converged"]
    assert answer["names"] == [f"delta{k}" for k in range(2, 7) if f"delta{k}" in stated]
    assert 500 < len(answer["draws"][0]) <= 2000
    for name, values in zip(answer["names"], answer["draws"], strict=True):
        own = stated[name]
        assert np.mean(values) == pytest.approx(own["mean"], abs=0.3 * own["std"])
        assert np.std(values) == pytest.approx(own["std"], rel=0.2)
    assert answer["prior_only"] == []


def test_what_has_draws_of_its_prior_alone_has_none_here(client: TestClient, there: Path) -> None:
    answer = client.get("/api/posterior", params={"file": "x-pattern/posterior.nc"}).json()
    assert "delta2" in answer["prior_only"]
    assert "delta2" not in answer["names"]
    wanted = {"posterior": "x-pattern/posterior.nc", "run": "x-pattern.jsonl", "ranges": {}}
    brushed = client.post("/api/brush", json=wanted).json()
    assert brushed["shots"] == []
    assert "delta2" in brushed["reason"]


def test_brushing_shows_which_measurements_speak_against_a_region(client: TestClient, there: Path) -> None:
    wanted: dict[str, Any] = {"posterior": "good/posterior.nc", "run": "good.jsonl", "ranges": {}}
    every = client.post("/api/brush", json=wanted).json()
    assert every["draws"] == every["chosen"]
    assert all(row["all"] == row["chosen"] for row in every["shots"])
    drawn = client.get("/api/posterior", params={"file": "good/posterior.nc"}).json()
    values = np.array(drawn["draws"][drawn["names"].index("delta2")])
    high = float(np.quantile(values, 0.9))
    part = client.post("/api/brush", json=wanted | {"ranges": {"delta2": [high, 99.0]}}).json()
    assert part["chosen"] == pytest.approx(0.1 * part["draws"], rel=0.05)
    assert [row["all"] for row in part["shots"]] == [row["all"] for row in every["shots"]]
    # E |z|^2 of a normalised residual is that at the mode and its leverage. The sum of leverages is between
    # the 8 unknowns without a tolerance and the 14 numbers; (E |z|)^2 is 2/pi of E |z|^2 or more.
    at_mode = sum(row["whitened"] ** 2 for row in _result(client)["shots"])
    assert 8 * 2 / np.pi < sum(row["all"] ** 2 for row in every["shots"]) < at_mode + 14
    assert any(abs(row["chosen"] - row["all"]) > 0.02 for row in part["shots"])
    nothing = client.post("/api/brush", json=wanted | {"ranges": {"delta2": [50.0, 60.0]}}).json()
    assert (nothing["chosen"], nothing["shots"]) == (0, [])
    assert nothing["reason"]


@pytest.mark.parametrize(
    "wanted",
    [
        {"posterior": "good/posterior.nc", "run": "x-pattern.jsonl", "ranges": {}},
        {"posterior": "good/result.json", "run": "good.jsonl", "ranges": {}},
        {"posterior": "good/posterior.nc", "run": "good.jsonl", "ranges": {"delta9": [0, 1]}},
    ],
)
def test_a_brush_that_cannot_be_is_refused(client: TestClient, there: Path, wanted: dict[str, Any]) -> None:
    assert client.post("/api/brush", json=wanted).status_code == 400


def test_of_many_draws_some_are_shown(
    client: TestClient, there: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zerobeam.app.server.answers import posteriors

    monkeypatch.setattr(posteriors, "MOST_DRAWS", 50)
    answer = client.get("/api/posterior", params={"file": "good/posterior.nc"}).json()
    assert 10 < len(answer["draws"][0]) <= 50 < answer["total"]


def test_a_posterior_that_is_cut_off_gets_one_clear_error(client: TestClient, there: Path) -> None:
    file = there / "good/posterior.nc"
    os.truncate(file, file.stat().st_size // 3)
    answer = client.get("/api/posterior", params={"file": "good/posterior.nc"})
    assert answer.status_code == 400
    assert "not a whole posterior" in answer.json()["error"]["what"]


def test_the_history_has_runs_by_serial_number_and_their_results(client: TestClient, there: Path) -> None:
    header, *shots = (there / "good.jsonl").read_text().splitlines()
    stated = json.loads(header)
    stated["provenance"] = {"Serial": "16-<b>", "when": "2026-05-04", "who": "J. Doe", "psd": "Acme 7"}
    (there / "sub/other.jsonl").write_text("\n".join([json.dumps(stated), *shots, ""]))
    (there / "broken.jsonl").write_text('{"schema": "zerobeam/run/1", ')
    for name, tool in {"odd": {"no": "kind"}, "unknown": {"kind": "dowsing rod"}}.items():
        (there / f"{name}.jsonl").write_text(json.dumps({**stated, "tool": tool}) + "\n")
    found = client.get("/api/history").json()
    rows = {row["file"]: row for row in found["runs"]}
    other = rows["sub/other.jsonl"]
    assert (other["serial"], other["when"], other["who"]) == ("16-<b>", "2026-05-04", "J. Doe")
    assert other["instrument"] == "Acme 7"
    assert other["results"] == []
    assert rows["x-pattern.jsonl"]["serial"] == "none: simulated"
    assert rows["good.jsonl"]["results"][0]["file"] == "good/result.json"
    assert rows["good.jsonl"]["results"][0]["verdict"] == "pass"
    assert "no whole header of a run" in rows["broken.jsonl"]["error"]
    for name in ("odd", "unknown"):
        assert rows[f"{name}.jsonl"]["error"] == "the instruments of this run cannot be read"
    assert found["results"] == []
    shutil.copy(there / "good.jsonl", there / "same.jsonl")
    rows = {row["file"]: row for row in client.get("/api/history").json()["runs"]}
    assert rows["same.jsonl"]["results"] == rows["good.jsonl"]["results"]
    (there / "same.jsonl").unlink()
    (there / "good.jsonl").unlink()
    assert [row["file"] for row in client.get("/api/history").json()["results"]] == ["good/result.json"]


def test_everything_is_downloaded_at_once(client: TestClient, there: Path) -> None:
    (there / "good/mine.txt").write_text("not a part of the report")
    (there / "good/figures/leak.svg").symlink_to(there.parent / "outside.yaml")
    answer = client.get("/api/archive", params={"file": "good/result.json"})
    assert answer.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(answer.content)) as packed:
        assert packed.testzip() is None
        names = set(packed.namelist())
        assert packed.read("good/result.json") == (there / "good/result.json").read_bytes()
    assert {"good/report.html", "good/report.pdf", "good/posterior.nc"} < names
    assert "good/mine.txt" not in names
    assert "good/figures/leak.svg" not in names
    assert client.get("/api/archive", params={"file": "plan.yaml"}).status_code == 400


def test_an_archive_is_made_in_parts(tmp_path: Path) -> None:
    large = tmp_path / "large.nc"
    with large.open("wb") as file:
        file.truncate(20 * 10**6)
    parts = list(archive([(large, "a/large.nc"), (tmp_path / "gone", "a/gone")]))
    assert max(map(len, parts)) < 10**6
    with zipfile.ZipFile(io.BytesIO(b"".join(parts))) as packed:
        assert packed.namelist() == ["a/large.nc"]
        assert packed.getinfo("a/large.nc").file_size == 20 * 10**6


def test_a_comparison_is_a_job_of_two_files_or_more(client: TestClient, there: Path) -> None:
    one = client.post("/api/jobs", json={"command": ["compare", "good.jsonl", "-o", "both"]})
    assert one.status_code == 400
    assert "files" in one.json()["error"]["what"]
