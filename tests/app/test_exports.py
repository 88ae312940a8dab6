"""What the page asks before an import and an export: a folder for a calibration, the forms of the makers."""

import re
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from zerobeam.app.server.index import Folder
from zerobeam.app.server.job_commands import job_command
from zerobeam.experiments.makers.maker import makers


def test_every_form_of_every_maker_can_be_exported_with_its_options(client: TestClient, root: Path) -> None:
    forms = client.get("/api/forms?of=export").json()
    assert {form["name"] for form in forms} == {kind.name for maker in makers() for kind in maker.offsets}
    for form in forms:
        assert form["about"].endswith(".")
        options = [_stated(field) for field in form["fields"]]
        out = f"--out={form['files'][0]}"
        command = job_command(Folder(root), [*form["command"], "run.jsonl", out, *options])
        assert {*options} <= {*command}
    moc = next(form for form in forms if form["name"] == "moc")
    flags = [field["flag"] for field in moc["fields"]]
    assert flags[:4] == ["--against", "--motor-sign", "--ratio", "--unit"]
    assert [field["among"] for field in moc["fields"][:4]] == ["files", None, None, None]
    assert {"--allow-weak", "--allow-displaced", "--allow-assumed", "--unvalidated"} <= {*flags}
    fanuc = next(form for form in forms if form["name"] == "fanuc")
    assert [choice["value"] for choice in fanuc["fields"][0]["choices"]] == ["ground", "link"]


def _stated(field: dict[str, Any]) -> str:
    if field["kind"] == "box":
        return str(field["flag"])
    return f"{field['flag']}={next((choice['value'] for choice in field['choices']), 'plan.yaml')}"


def test_what_an_option_cannot_be_is_refused_at_its_field(client: TestClient, root: Path) -> None:
    made = ["plan", "optimal", "--header=plan.yaml", "--out=new.yaml"]
    for word, allowed in {
        "--shots=1": "a whole number, 2 to 10000",
        "--shots=many": "a whole number",
        "--criterion=F": "A, D, E",
        "--beam=1": "2 numbers up to 1e+06 separated by commas",
        "--target=0,0": "3 numbers up to 1e+06 separated by commas",
        "--measure=laser": None,
        "--obstacles=../outside.yaml": None,
    }.items():
        error = client.post("/api/jobs", json={"command": [*made, word]}).json()["error"]
        assert error["key"] == ["command", word.partition("=")[0]], error
        assert allowed is None or error["allowed"] == allowed, error
    assert job_command(Folder(root), [*made, "--shots=12", "--criterion=D", "--beam=200,900"])


def test_a_form_says_of_an_option_what_its_record_says(client: TestClient) -> None:
    fields = {
        form["name"]: {field["flag"]: field for field in form["fields"]}
        for form in client.get("/api/forms?of=plan").json()
    }
    assert {*fields} == {"optimal", "x", "y"}
    assert "--facing" in fields["optimal"]
    assert "--facing" not in fields["x"]
    assert {"--height", "--width"} <= {*fields["x"]}
    repeat = fields["optimal"]["--repeat"]
    bounds = (repeat["default"], repeat["least"], repeat["most"])
    assert (repeat["kind"], *bounds) == ("whole", "2", 0, 10_000)
    assert fields["optimal"]["--target"]["parts"] == ["x", "y", "z"]
    assert fields["optimal"]["--max-shots"]["needs"] == ["--tolerance"]
    assert client.get("/api/forms?of=robot").status_code == 400


def test_a_plan_is_exported_in_the_app_as_by_the_command_line(client: TestClient, root: Path) -> None:
    from command_line import zerobeam

    forms = client.get("/api/forms?of=export plan").json()
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
    assert {field["flag"] for form in forms for field in form["fields"]} == {f"--{name}" for name in options}
    for form in forms:
        stated = [f"{one['flag']}={options[one['flag'][2:]]}" for one in form["fields"]]
        words = [*form["command"], "plan.yaml", f"--out={form['files'][0]}", *stated]
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
