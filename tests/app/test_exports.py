"""What the page asks before an import and an export: a folder for a calibration, the forms of the makers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from zerobeam.app.server.folder import Folder
from zerobeam.app.server.job_commands import job_command
from zerobeam.experiments.makers.maker import makers


def test_every_form_of_every_maker_can_be_exported_with_its_options(client: TestClient, root: Path) -> None:
    forms = client.get("/api/exports").json()
    assert {form["name"] for form in forms} == {kind.name for maker in makers() for kind in maker.offsets}
    for form in forms:
        assert form["about"].endswith(".")
        options = [
            f"{option['flag']}={(option['choices'] or ['plan.yaml'])[0]}" for option in form["options"]
        ]
        out = f"--out=offsets.{form['ending']}"
        command = job_command(Folder(root), ["export", form["name"], "run.jsonl", out, *options])
        assert {*options} <= {*command}
    moc = next(form for form in forms if form["name"] == "moc")
    assert [option["flag"] for option in moc["options"]] == ["--against", "--motor-sign", "--ratio", "--unit"]
    assert [option["file"] for option in moc["options"]] == [True, False, False, False]
    fanuc = next(form for form in forms if form["name"] == "fanuc")
    assert fanuc["options"][0]["choices"] == ["ground", "link"]


def test_a_plan_is_exported_in_the_app_as_by_the_command_line(client: TestClient, root: Path) -> None:
    from command_line import zerobeam

    forms = client.get("/api/plan-exports").json()
    refusal = " ".join(zerobeam("export", "plan", "nothing", "plan.yaml", "-o", "out").err.split())
    assert [form["name"] for form in forms[1:]] + ["pdf"] == re.findall(r"'(\w+)'", refusal)[2:]
    assert forms[0]["name"] == "pdf"
    options = {
        "speed": "5",
        "zone": "1",
        "tool": "1",
        "j3": "link",
        "register": "2",
        "listener": "10.0.0.1:5",
    }
    assert {option for form in forms for option in form["options"]} == {*options}
    for form in forms:
        stated = [f"--{name}={options[name]}" for name in form["options"]]
        words = ["export", "plan", form["name"], "plan.yaml", f"--out={form['files'][0]}", *stated]
        assert {*stated} <= {*job_command(Folder(root), words)}


def test_a_folder_is_made_once(client: TestClient, root: Path) -> None:
    answer = client.post("/api/folders", json={"name": "arm 7"})
    assert answer.json() == {"name": "arm 7"}
    assert (root / "arm 7").is_dir()


@pytest.mark.parametrize("name", ["sub", "a/b", "../b", ".hidden", "", "run.jsonl", "dangling"])
def test_what_is_no_new_folder_is_refused_with_its_key(client: TestClient, root: Path, name: str) -> None:
    (root / "dangling").symlink_to(root / "nowhere")
    before = sorted(root.parent.rglob("*"))
    answer = client.post("/api/folders", json={"name": name})
    assert answer.status_code == 400
    assert answer.json()["error"]["key"] == ["name"]
    assert sorted(root.parent.rglob("*")) == before
