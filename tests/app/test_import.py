"""What the place Import asks: recordings, columns against limits, headers, and the import as a job."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from app_jobs import begun, ended
from recorded_logs import HEADER, POSTURES, table
from starlette.testclient import TestClient
from typer.main import get_command

from zerobeam.app.server.job_commands import ALLOWED
from zerobeam.commands.exchange import imports
from zerobeam.experiments.makers import contents
from zerobeam.experiments.makers.known_logs import known_logs
from zerobeam.experiments.schema import json_schema
from zerobeam.model.files.measurements import read_header
from zerobeam.model.files.run import read_run

NAMES = [f"a{i}" for i in range(1, 7)]
GOOD = {
    "robot": "irb1600",
    "tool": {"kind": "probe", "point_mm": [0, 0, 100]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.5},
}


@pytest.fixture
def recorded(root: Path) -> Path:
    """shots.csv with the sign of joint 2 reversed, radians, and header.yaml."""
    (root / "header.yaml").write_text(HEADER)
    joints = np.radians(POSTURES * [1, -1, 1, 1, 1, 1])
    path = root / "shots.csv"
    path.write_text(table(["t", *NAMES], [[i, *row] for i, row in enumerate(joints.tolist())], ","))
    return path


def refused(client: TestClient, method: str, path: str, sent: Any) -> dict[str, Any]:
    answer = client.request(method, path, json=sent)
    assert answer.status_code == 400, answer.text
    error: dict[str, Any] = answer.json()["error"]
    return error


def test_a_recording_is_looked_at(client: TestClient, recorded: Path) -> None:
    found = client.post("/api/recording", json={"file": "shots.csv"}).json()
    assert (found["form"], found["rows"], found["layout"]["header_row"]) == ("csv", 4, True)
    assert [column["name"] for column in found["columns"]] == ["t", *NAMES]
    plain = client.post("/api/recording", json={"file": "shots.csv", "header_row": True, "delimiter": ";"})
    assert plain.status_code == 400  # one column, and no numbers


def test_a_recording_that_takes_too_long_ends_a_process_and_not_the_server(
    client: TestClient, recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contents, "_COMMAND", [sys.executable, "-c", "import time; time.sleep(60)"])
    monkeypatch.setattr(contents, "PATIENCE_S", 1.0)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(refused, client, "POST", "/api/recording", {"file": "shots.csv"})
        assert client.post("/api/columns", json={"files": ["shots.csv"], "robot": "irb1600"}).is_success
        assert not asked.done()  # others are answered meanwhile
        error = asked.result()
    assert (error["what"], error["found"]) == (
        "shots.csv: the file is too much to be looked at here",
        "no answer in 1 s",
    )


@pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of POSIX")
@pytest.mark.parametrize("hurt", ["import os; os.kill(os.getpid(), 9)", "MEMORY"])
def test_a_recording_that_takes_too_much_memory_ends_a_process_and_not_the_server(
    client: TestClient, recorded: Path, monkeypatch: pytest.MonkeyPatch, hurt: str
) -> None:
    eaten = "from zerobeam.experiments.makers import contents as own\n"
    eaten += "own.head_of = own.contents_of = lambda *_: bytearray(5 * 10**9)\nown.main()"
    program = eaten if hurt == "MEMORY" else hurt
    monkeypatch.setattr(contents, "_COMMAND", [sys.executable, "-c", program])
    error = refused(client, "POST", "/api/recording", {"file": "shots.csv"})
    assert "too much to be looked at" in error["what"]
    assert error["found"] in ("more than 4 GB of memory", "the process was ended by signal 9")
    assert client.get("/api/files").is_success


@pytest.mark.long
def test_a_bag_that_stands_for_far_more_than_its_size_is_refused(client: TestClient, root: Path) -> None:
    pytest.importorskip("rosbags")
    from ros_bags import Bag

    bag = Bag("ros1").states([0.0], [[0.0]], ["a" * 80 * 10**6]).write(root, "bz2")
    assert bag.stat().st_size < 100_000
    error = refused(client, "POST", "/api/recording", {"file": bag.name})
    assert (
        error["what"] == f"{bag.name}: the bag is not unpacked: what it stands for is too large for its size"
    )
    assert error["allowed"] == "200 times the size of the bag, or 64 MB where that is more"


def test_columns_are_shown_against_the_limits(client: TestClient, recorded: Path) -> None:
    asked = {"files": ["shots.csv"], "robot": "irb1600"}
    first = client.post("/api/columns", json=asked).json()
    assert first["columns"]["choice"] == NAMES
    assert first["units"] is None  # of no column yet
    assert all(joint["seen"] is None and joint["outside"] is None for joint in first["joints"])
    asked |= {"columns": NAMES}
    first = client.post("/api/columns", json=asked).json()
    assert (first["units"]["choice"], first["units"]["decided"]) == ("rad", False)
    asked |= {"units": "rad", "reversed_joints": [2]}
    found = client.post("/api/columns", json=asked).json()
    np.testing.assert_allclose(found["first"], POSTURES, atol=1e-6)
    for joint, lowest, highest in zip(found["joints"], POSTURES.min(0), POSTURES.max(0), strict=True):
        assert joint["seen"] == pytest.approx([lowest, highest])
        assert joint["outside"] == 0
    wrong = client.post("/api/columns", json=asked | {"columns": ["t", *NAMES[1:]]}).json()["joints"][0]
    assert (wrong["recorded"], wrong["seen"][1]) == ([0, 3], pytest.approx(np.degrees(3)))


def test_a_wrong_column_says_which(client: TestClient, recorded: Path) -> None:
    recorded.write_text(recorded.read_text().replace("\n2,", "\n2,nan,", 1).replace(",nan,", ",nan,", 1))
    error = refused(client, "POST", "/api/columns", {"files": ["shots.csv"], "robot": "irb1600"})
    assert "wrong number of values" in error["what"]
    recorded.write_text("a,b\n1,nan\n")
    error = refused(
        client,
        "POST",
        "/api/columns",
        {"files": ["shots.csv"], "robot": "irb1600", "columns": ["a", "b", None, None, None, None]},
    )
    assert error["key"] == ["columns", 1]
    assert "line 2: column 2 is not a finite number" in error["what"]
    error = refused(
        client, "POST", "/api/columns", {"files": ["shots.csv"], "robot": "irb1600", "reversed_joints": [7]}
    )
    assert error["key"] == ["reversed_joints", 0]


def test_the_schema_of_the_form_is_the_published_one(client: TestClient) -> None:
    assert client.get("/api/header/schema").json() == json_schema("header")


def test_a_header_is_checked_written_and_read(client: TestClient, root: Path) -> None:
    asked = {"file": "sub/h.yaml", "header": GOOD}
    assert client.post("/api/header/check", json=asked).json()["joints"] == 6
    assert not (root / "sub/h.yaml").exists()
    done = client.put("/api/header", json=asked).json()
    assert (done["file"], done["target"]) == ("sub/h.yaml", "socket")
    assert read_header(root / "sub/h.yaml").noise.spot_mm == 0.5
    back = client.get("/api/header", params={"file": "sub/h.yaml"}).json()
    assert {key: back["header"][key] for key in GOOD} == GOOD
    assert "postures_deg" not in client.get("/api/header", params={"file": "plan.yaml"}).json()["header"]
    taken = client.put("/api/header", json=asked)
    assert (taken.status_code, "exists already" in taken.json()["error"]["what"]) == (412, True)
    error = refused(client, "PUT", "/api/header", asked | {"file": "plan.yaml"})
    assert error["key"] == ["file"]


WRONG: list[tuple[dict[str, Any], list[str | int]]] = [
    ({"robot": "irb16"}, ["header", "robot"]),
    ({"robot": "../outside.yaml"}, ["header"]),
    ({"tool": {"kind": "laser", "point_mm": [0, 0, 1]}}, ["header", "tool"]),
    ({"noise": {"joint_deg": -1, "spot_mm": 0.5}}, ["header", "noise", "joint_deg"]),
    ({"noise": {"joint_deg": 0.01, "spot_mm": "x"}}, ["header", "noise", "spot_mm"]),
    ({"noise": {"joint_deg": [0.01, 0.01], "spot_mm": 0.5}}, ["header", "noise", "joint_deg"]),
    ({"targets": {"a": {"guess_mm": [1, 2]}}}, ["header", "targets", "a", "guess_mm"]),
]


@pytest.mark.parametrize(("part", "key"), WRONG)
def test_an_error_of_a_header_stands_at_its_key(
    client: TestClient, root: Path, part: dict[str, Any], key: list[str | int]
) -> None:
    for method, path in (("POST", "/api/header/check"), ("PUT", "/api/header")):
        error = refused(client, method, path, {"file": "h.yaml", "header": GOOD | part})
        assert error["key"] == key
    assert not (root / "h.yaml").exists()


def test_an_import_is_a_job_and_replaces_nothing(client: TestClient, recorded: Path, root: Path) -> None:
    command = [
        "import",
        "csv",
        "--header-row",
        "--units=rad",
        f"--columns={','.join(NAMES)}",
        "--reversed=j2",
        "--header=header.yaml",
        "--target=a",
        "--out=new.jsonl",
        "shots.csv",
    ]
    done = ended(client, begun(client, *command))
    assert (done["state"], done["log"][-1]) == ("done", "4 measurements written to new.jsonl")
    assert "signs reversed: j2" in done["log"]
    np.testing.assert_allclose(np.degrees(read_run(root / "new.jsonl").joints), POSTURES, atol=1e-9)
    for bad in (["--force"], ["*.csv"]):
        assert client.post("/api/jobs", json={"command": [*command, *bad]}).status_code == 400
    assert client.post("/api/jobs", json={"command": command[:-1]}).status_code == 400


# Of a table the page states these beside its columns.
MAPPED_BESIDE = {"--units", "--lengths", "--header-row", "--columns", "--delimiter", "--decimal", "--j3"}
MAPPED_BESIDE |= {"--reversed"}


def test_every_format_of_the_command_is_offered_with_its_options_and_carried_out(client: TestClient) -> None:
    group = get_command(imports()).commands  # type: ignore[attr-defined]
    offered = {form["name"]: form for form in client.get("/api/forms?of=import").json()}
    logs = {name for name in offered if name.startswith("log ")}
    hidden = {name for name, command in group.items() if command.hidden}
    assert set(offered) - logs == set(group) - hidden - {"log", "ur-calibration"}
    assert logs == {f"log {log.name}" for log in known_logs()}
    common = {"--header", "--plan", "--target", "--out", "--force", "--dry-run", "--help"}
    for name, form in offered.items():
        flags = {flag for each in group[name.split(" ")[0]].params for flag in each.opts if flag[:2] == "--"}
        mapped = MAPPED_BESIDE if name == "csv" else set()
        assert {field["flag"] for field in form["fields"]} == flags - common - {"--overwrite"} - mapped
        assert form["command"] == ["import", *name.split(" ")]
        assert form["about"]
        allowed = ALLOWED["import", *name.split(" ")][1]
        assert set(allowed) == flags - {"--force", "--overwrite", "--help"}


def test_a_saved_file_of_a_newer_maker_becomes_a_run(client: TestClient, root: Path) -> None:
    (root / "header.yaml").write_text(HEADER.replace("robot: irb1600", "robot: rs007n"))
    rows = "".join(f"#p{i} {' '.join(map(str, row))}\n" for i, row in enumerate(POSTURES.tolist()))
    (root / "shots.as").write_text(f".JOINTS\n{rows}.END\n")
    found = client.post("/api/recording", json={"file": "shots.as"}).json()
    assert (found["form"], found["formats"], len(found["points"])) == ("as", ["as"], 4)
    command = ["import", "as", "--points=#p0,#p2", "--header=header.yaml", "--target=a", "--out=new.jsonl"]
    done = ended(client, begun(client, *command, "shots.as"))
    assert done["state"] == "done", done["log"]
    np.testing.assert_allclose(np.degrees(read_run(root / "new.jsonl").joints), POSTURES[[0, 2]], atol=1e-9)
