"""The app in a notebook: one server of the process, the files of the object, and the page on them."""

import hashlib
import importlib.util
import json
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from app_page import request
from cells import good_plan
from exact_runs import demo_runs

import zerobeam as zb
from zerobeam.face import notebook
from zerobeam.face.notebook import AppView, app_of, write_run_beside
from zerobeam.model.files.plan import write_plan
from zerobeam.model.files.robot_file import BUILT_IN

NAME = 'a b#"<i>.txt'


class Thing:
    """What a notebook may hold."""


def _write(folder: Path) -> str:
    (folder / NAME).write_text("here")
    return NAME


def _file_of(place: str, step: str) -> str:
    """The file that the address of a calibration's step opens; it is in the calibration's folder."""
    start, job, name, opened, file = place.split("/", 4)
    assert (start, job, opened) == ("", "job", step)
    assert file.startswith(f"{name}/")
    return unquote(file)


def _get(address: str, path: str = "") -> Any:
    return urllib.request.urlopen(request(address, path), timeout=30)


def test_the_page_is_served_on_the_files_of_the_object() -> None:
    thing, other = Thing(), Thing()
    view = app_of(thing, "plan", _write)
    assert isinstance(view, AppView)
    root, _, place = view.address.partition("#")
    assert root.startswith("http://127.0.0.1:")
    name = _file_of(place, "plan")
    assert name.endswith(f"/{NAME}")
    listed = [row["path"] for row in json.load(_get(root, "api/files"))]
    assert name in listed
    assert app_of(thing, "plan", _write) == view  # nothing is written twice
    again = app_of(other, "plan", _write)
    assert again.address.startswith(root)
    assert again != view
    assert "<i>" not in view._repr_html_()
    assert view._repr_html_().startswith("<iframe ")


def test_a_notebook_of_this_machine_alone_may_frame_it() -> None:
    root = app_of(Thing(), "plan", _write).address.partition("#")[0]
    for path in ("", f"report/{json.load(_get(root, 'api/files'))[0]['path'].partition('/')[0]}/none.html"):
        try:
            headers = _get(root, path).headers
        except urllib.error.HTTPError as error:
            headers = error.headers
        ancestors = headers["content-security-policy"].partition("frame-ancestors ")[2].partition(";")[0]
        assert ancestors.split()[:3] == ["'self'", "http://localhost:*", "https://localhost:*"]
        assert all("localhost" in one or "127.0.0.1" in one for one in ancestors.split()[1:-1])


def test_the_run_is_the_same_file_and_has_its_robot_beside_it(tmp_path: Path) -> None:
    run = zb.read_run(demo_runs()[0].path)
    write_run_beside(run, tmp_path)
    assert hashlib.sha256((tmp_path / "good.jsonl").read_bytes()).hexdigest() == run.sha256
    made = zb.Run.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        joints=run.joints,
        unit="rad",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        name="made",
    )
    write_run_beside(made, tmp_path)
    assert zb.read_run(tmp_path / "made.jsonl").sha256 == made.sha256


def test_a_plan_is_opened_with_its_robot_beside_it(tmp_path: Path) -> None:
    (tmp_path / "arms").mkdir()
    robot = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    (tmp_path / "arms" / "own.yaml").write_text(robot, encoding="utf-8")
    plan = good_plan(7)
    header = plan.header.model_copy(update={"robot": "arms/own.yaml"})
    write_plan(tmp_path / "a plan.yaml", header, plan.postures * plan.robot.display, plan.targets)
    checked = zb.check(zb.read_plan(tmp_path / "a plan.yaml"))
    root, _, place = checked.app().address.partition("#")
    answer = json.load(_get(root, f"api/plan?file={_file_of(place, 'plan')}"))
    assert (answer["plan"]["robot"], len(answer["plan"]["postures_deg"])) == ("own.yaml", 7)
    assert checked.app() == checked.app()


def test_without_the_extra_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(notebook, "find_spec", lambda name: None if name == "uvicorn" else found(name))
    with pytest.raises(zb.BadInput, match=r"zerobeam\[app\]"):
        app_of(Thing(), "plan", _write)


_PROGRAM = """
import sys
import zerobeam as zb
sol = zb.analyse(zb.read_run(sys.argv[1]), ess=100)
print(sol.app().address, flush=True)
sys.stdin.readline()
"""


@pytest.mark.long
def test_a_solution_opens_its_result_and_the_server_ends_with_the_process() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _PROGRAM, demo_runs()[0].path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        root, _, place = process.stdout.readline().strip().partition("#")
        file = _file_of(place, "result")
        answer = json.load(_get(root, f"api/file?file={file}"))
        assert answer["schema"] == "zerobeam/result/1"
        kinds = {row["path"]: row["kind"] for row in json.load(_get(root, "api/files"))}
        assert "run" in kinds.values()
        process.stdin.write("\n")
        process.stdin.flush()
        assert process.wait(timeout=60) == 0
    with pytest.raises(urllib.error.URLError):
        _get(root)
