"""Every path that a request, a word of a job or a file names: below the folder, or refused."""

import inspect
import json
import os
import shutil
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import typer.main
from app_jobs import begun, ended
from cells import good_plan
from command_line import plan_file
from exact_runs import demo_runs
from starlette.testclient import TestClient

from zerobeam.app.server.index import Folder
from zerobeam.app.server.job_commands import ALLOWED, job_command, kind_of
from zerobeam.app.server.requests import END_POINTS
from zerobeam.commands.program import app
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import BUILT_IN

SECRET = "swordfish"
# The kinds of the options that a job may state, by its command.
KINDS = {
    name: (files, {key: kind_of(one) for key, one in options.items()})
    for name, (files, options) in ALLOWED.items()
}
# Traversal, absolute, through links (of a file, of a folder), hidden, NUL, another system's, none, too long.
NAMES = {
    "traversal": "../outside.yaml",
    "inner traversal": "sub/../../outside.yaml",
    "absolute": "ABSOLUTE",
    "system": "/etc/passwd",
    "link": "link.yaml",
    "linked folder": "way/outside.yaml",
    "hidden": ".hidden.yaml",
    "hidden folder": ".ssh/arm.yaml",
    "link to hidden": "veiled.yaml",
    "NUL": "plan.yaml\0.yaml",
    "backslash": "..\\outside.yaml",
    "drive": "C:outside.yaml",
    "long": "x" * 300 + ".yaml",
    "longer": "sub/" * 300 + "x.yaml",
}
# The fields of what is sent in which a person names a file, and those in which nobody does.
PATHS = {"file", "files", "robot", "beside", "run", "posterior", "plan", "header"}
OTHERS = {
    "as_in_files",
    "scene",
    "obstacles",
    "postures",
    "header_row",
    "delimiter",
    "decimal",
    "columns",
    "units",
}
OTHERS |= {
    "lengths",
    "reversed_joints",
    "j3",
    "joints_deg",
    "without",
    "ranges",
    "name",
    "instrument",
    "place",
    "serial",
}
OTHERS |= {"measurements", "mounted", "version", "links", "position_mm", "quaternion_wxyz"}
OTHERS |= {"of", "command", "password", "text"}  # of jobs: see NAMED_BY


def _urdf(name: str) -> dict[str, str]:
    return {"urdf": name, "base": "base", "tip": "flange"}


Ask = Callable[[TestClient, dict[str, Any], str], Any]


def _get(path: str) -> Ask:
    return lambda client, plan, name: client.get(path, params={"file": name})


def _send(method: str, path: str, body: dict[str, Any]) -> Ask:
    """`NAME` and `URDF` in the body are the name and a chain of it, `PLAN` a plan with more."""

    def filled(value: Any, words: dict[str, Any]) -> Any:
        if isinstance(value, dict):
            return {key: filled(each, words) for key, each in value.items()}
        if isinstance(value, list):
            return [filled(each, words) for each in value]
        return words.get(value, value) if isinstance(value, str) else value

    def ask(client: TestClient, plan: dict[str, Any], name: str) -> Any:
        plans = {"": plan, " OF": plan | {"robot": name}, " OF URDF": plan | {"robot": _urdf(name)}}
        words = {"NAME": name, "URDF": _urdf(name)}
        for which, content in plans.items():
            words |= {f"PLAN{which}": content, f"HEADER{which}": _header(content)}
        return client.request(method, path, json=filled(body, words))

    return ask


def _header(plan: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in plan.items() if key not in ("schema", "postures_deg")}


BOXES = {"floor_mm": 0.0, "boxes": {}}
AT = {"joints_deg": [0.0] * 6, "position_mm": [500.0, 0.0, 800.0]}
# What is sent, by end point and field.
SENT: dict[str, dict[str, Any]] = {
    "PUT /api/plan file": {"file": "NAME", "plan": "PLAN"},
    "PUT /api/plan plan": {"file": "new.yaml", "plan": "PLAN OF"},
    "PUT /api/plan plan of URDF": {"file": "new.yaml", "plan": "PLAN OF URDF"},
    "PUT /api/obstacles file": {"file": "NAME", "obstacles": BOXES},
    "PUT /api/header file": {"file": "NAME", "header": "HEADER"},
    "PUT /api/header header": {"file": "new.yaml", "header": "HEADER OF"},
    "PUT /api/header header of URDF": {"file": "new.yaml", "header": "HEADER OF URDF"},
    "POST /api/header/check file": {"file": "NAME", "header": "HEADER"},
    "POST /api/header/check header": {"file": "new.yaml", "header": "HEADER OF"},
    "POST /api/check file": {"file": "NAME", "plan": "PLAN"},
    "POST /api/check plan": {"plan": "PLAN OF"},
    "POST /api/check plan of URDF": {"plan": "PLAN OF URDF"},
    "POST /api/without file": {"file": "NAME", "plan": "PLAN", "postures": [0]},
    "POST /api/without plan": {"plan": "PLAN OF", "postures": [0]},
    "POST /api/recording file": {"file": "NAME"},
    "POST /api/columns files": {"files": ["NAME"], "robot": "irb1600"},
    "POST /api/columns robot": {"files": ["plan.yaml"], "robot": "NAME"},
    "POST /api/columns robot URDF": {"files": ["plan.yaml"], "robot": "URDF"},
    "POST /api/columns beside": {"files": ["plan.yaml"], "robot": "irb1600", "beside": "NAME"},
    "POST /api/robot robot": {"robot": "NAME"},
    "POST /api/robot robot URDF": {"robot": "URDF"},
    "POST /api/folders name": {"name": "NAME"},
    "POST /api/calibrations robot": {
        "name": "new",
        "robot": "NAME",
        "instrument": "laser",
        "place": {"kind": "front"},
    },
    "POST /api/calibrations robot URDF": {
        "name": "new",
        "robot": "URDF",
        "instrument": "laser",
        "place": {"kind": "front"},
    },
    "POST /api/calibrations/proposal robot": {"robot": "NAME", "instrument": "laser"},
    "POST /api/calibrations/proposal robot URDF": {"robot": "URDF", "instrument": "laser"},
    "POST /api/calibrations/withdraw name": {"name": "NAME", "version": "0"},
    "POST /api/inverse robot": AT | {"robot": "NAME"},
    "POST /api/inverse robot URDF": AT | {"robot": "URDF"},
    "POST /api/inverse file": AT | {"robot": "irb1600", "file": "NAME"},
    "POST /api/meshes robot": {"robot": "URDF"},
    "POST /api/refit run": {"run": "NAME"},
    "POST /api/runs run": {"run": "NAME", "without": [0]},
    "POST /api/brush posterior": {"posterior": "NAME", "run": "run.jsonl", "ranges": {}},
    "POST /api/brush run": {"posterior": "posterior.nc", "run": "NAME", "ranges": {}},
}
REQUESTS: dict[str, Ask] = {
    **{
        f"GET /api/{name} file": _get(f"/api/{name}")
        for name in ("plan", "obstacles", "header", "result", "posterior", "run", "file", "archive")
    },
    **{key: _send(*key.split()[:2], body) for key, body in SENT.items()},
    "PUT /api/file file": lambda client, plan, name: client.put(
        "/api/file", params={"file": name}, content=b"x"
    ),
    "GET /report": lambda client, plan, name: client.get(f"/report/{name.replace(chr(0), '%00')}"),
    "GET /shown": lambda client, plan, name: client.get(f"/shown/{'0' * 32}/{name.replace(chr(0), '%00')}"),
}


@pytest.fixture
def there(root: Path) -> Path:
    """The folder with links that lead out of it and to what is hidden; outside is an arm."""
    arm = (BUILT_IN / "irb1600.yaml").read_text().replace("name: irb1600", f"name: {SECRET}")
    (root / ".ssh").mkdir()
    for file in (
        root.parent / "outside.yaml",
        root / ".hidden.yaml",
        root / ".ssh" / "arm.yaml",
        root / "arm.yaml",
    ):
        file.write_text(arm)
    (root / "link.yaml").symlink_to("../outside.yaml")
    (root / "veiled.yaml").symlink_to(".hidden.yaml")
    (root / "way").symlink_to("..")
    _posterior(root / "posterior.nc", root / "run.jsonl")
    return root


def _posterior(file: Path, run: Path) -> None:
    import hashlib

    with h5py.File(file, "w") as made:
        group = made.create_group("posterior")
        group.attrs["converged"], group.attrs["sha256"] = "yes", hashlib.sha256(run.read_bytes()).hexdigest()
        group["chain"], group["draw"] = np.arange(1), np.arange(11)


@pytest.fixture
def unchanged(there: Path) -> Iterator[None]:
    """Nothing is written, nor made, in the folder or beside it."""

    def now() -> dict[Path, bytes | None]:
        found = there.parent.rglob("*")
        return {
            path: path.read_bytes() if path.is_file() else None
            for path in found
            if ".zerobeam" not in path.parts
        }

    before = now()
    yield
    assert now() == before


def test_the_table_has_every_field(client: TestClient) -> None:
    for point in END_POINTS:
        sent = {} if point.sent is None else point.sent.model_fields
        fields = [*point.query, *(field.alias or name for name, field in sent.items())]
        assert set(fields) <= PATHS | OTHERS, point.path
        for field in set(fields) & PATHS:
            assert f"{point.method} {point.path} {field}" in REQUESTS, (point.path, field)
    served: Any = client.app
    named = {name.split()[1] for name in REQUESTS}
    without = {"/", "/page", "/api/forms", "/api/files", "/api/jobs", "/api/example", "/openapi.json"} | {
        point.path for point in END_POINTS if not point.query and point.sent is None
    }
    for route in served.routes:
        path = route.path.partition("{")[0].rstrip("/") or "/"
        assert path in named | without, path


@pytest.mark.parametrize("name", [*NAMES, "", "."])
@pytest.mark.usefixtures("unchanged")
@pytest.mark.one_in(2)
def test_no_request_leads_out(client: TestClient, there: Path, content: dict[str, Any], name: str) -> None:
    named = NAMES.get(name, name).replace("ABSOLUTE", str(there.parent / "outside.yaml"))
    for asked, ask in REQUESTS.items():
        if asked.startswith("GET /report") and name in ("absolute", "system", "traversal", "inner traversal"):
            continue  # a client makes another address of it
        answer = ask(client, content, named)
        assert answer.status_code in (
            (400, 403, 404) if "/shown" in asked or "/report" in asked else (400,)
        ), asked
        assert SECRET not in answer.text, asked
        assert str(there) not in answer.text.replace(named, ""), asked
    listed = {row["path"] for row in client.get("/api/files").json()}
    assert listed == {"plan.yaml", "run.jsonl", "arm.yaml", "posterior.nc"}


def test_the_control_of_requests(client: TestClient, there: Path, content: dict[str, Any]) -> None:
    """With a name below the folder the same requests are answered, or refused for what the file is."""
    for asked in (
        "PUT /api/plan plan",
        "POST /api/check plan",
        "POST /api/robot robot",
        "GET /api/file file",
    ):
        assert REQUESTS[asked](client, content, "arm.yaml").status_code == 200, asked
        (there / "new.yaml").unlink(missing_ok=True)
    for asked, ask in REQUESTS.items():
        answer = ask(client, content, "sub/../none.yaml" if "PUT" not in asked else "sub/../new.csv")
        assert "below" not in answer.text, (asked, answer.text)
        assert "cannot be used here" not in answer.text


def _named_in_run(robot: str) -> str:
    lines = next(run.path for run in demo_runs() if run.name == "good").read_text().splitlines()
    return "\n".join(
        [json.dumps(json.loads(lines[0]) | {"robot": robot, "geometry": "exact"}), *lines[1:], ""]
    )


BEGINNINGS = {"plain": "", "byte order mark": "\ufeff", "blank lines": "\n \n"}


@pytest.mark.parametrize("start", BEGINNINGS)
@pytest.mark.parametrize(
    "name", ["../outside.yaml", "/etc/x.yaml", "link.yaml", "way/outside.yaml", ".hidden.yaml"]
)
@pytest.mark.usefixtures("unchanged")
@pytest.mark.one_in(3)
def test_no_run_leads_out(client: TestClient, there: Path, name: str, start: str) -> None:
    (there / "named.jsonl").write_text(BEGINNINGS[start] + _named_in_run(name), encoding="utf-8")
    answers = [
        client.post("/api/refit", json={"run": "named.jsonl"}),
        client.get("/api/run", params={"file": "named.jsonl"}),
    ]
    _posterior(there / "posterior.nc", there / "named.jsonl")
    answers.append(
        client.post("/api/brush", json={"posterior": "posterior.nc", "run": "named.jsonl", "ranges": {}})
    )
    _posterior(there / "posterior.nc", there / "run.jsonl")
    (there / "named.jsonl").unlink()
    for answer in answers:
        assert answer.status_code == 400
        assert "app's folder" in answer.text or "hidden" in answer.text
        assert SECRET not in answer.text


def test_the_control_of_runs(client: TestClient, there: Path) -> None:
    (there / "named.jsonl").write_text(_named_in_run("arm.yaml"), encoding="utf-8")
    assert client.post("/api/refit", json={"run": "named.jsonl"}).status_code == 200


@pytest.mark.usefixtures("unchanged")
def test_no_plan_or_header_leads_out(client: TestClient, there: Path) -> None:
    plan = good_plan(3)
    made = [there / "p.yaml", there / "h.yaml"]
    plan_file(made[0], plan)
    made[0].write_text(made[0].read_text().replace("robot: irb1600", "robot: ../outside.yaml"))
    made[1].write_text(
        made[0].read_text().partition("postures_deg")[0].replace("schema: zerobeam/plan/1\n", "")
    )
    for path in ("/api/plan", "/api/header"):
        for file in ("p.yaml", "h.yaml"):
            answer = client.get(path, params={"file": file})
            assert answer.status_code == 400
            assert SECRET not in answer.text
    for file in made:
        file.unlink()


def test_a_posterior_holds_its_own_draws(client: TestClient, there: Path) -> None:
    """An HDF5 file may name others: by a link, as the bytes of a dataset, or as its parts."""
    (there.parent / "outside").write_bytes(SECRET.encode() + b"!!")

    def variable(made: Any, kind: str) -> None:
        if kind == "external":
            stored = [(str(there.parent / "outside"), 0, 11)]
            made = made["posterior"].create_dataset("d", (1, 11), dtype="u1", external=stored)
        elif kind == "virtual":
            layout = h5py.VirtualLayout((1, 11), dtype="u1")
            layout[0] = h5py.VirtualSource(str(there.parent / "outside.nc"), "d", shape=(11,))
            made = made["posterior"].create_virtual_dataset("d", layout)
        elif kind == "link":
            made["posterior"]["d"] = h5py.ExternalLink(str(there.parent / "outside.nc"), "d")
            return
        else:
            made = made["posterior"].create_dataset("d", data=np.zeros((1, 11)))
        made.attrs.update({"source": "data", "long_name": "delta2", "units": "degree"})

    with h5py.File(there.parent / "outside.nc", "w") as outside:
        outside["d"] = np.frombuffer(SECRET.encode() + b"!!", dtype="u1").reshape(1, 11)
        outside["d"].attrs.update({"source": "data", "long_name": "delta2", "units": "degree"})
    for kind, status in {"plain": 200, "external": 400, "virtual": 400, "link": 400}.items():
        _posterior(there / "posterior.nc", there / "run.jsonl")
        with h5py.File(there / "posterior.nc", "r+") as made:
            variable(made, kind)
        answer = client.get("/api/posterior", params={"file": "posterior.nc"})
        assert answer.status_code == status, (kind, answer.text)
        assert str(ord(SECRET[0])) not in str(answer.json().get("draws", "")), kind


def _commands() -> Iterator[tuple[list[str], dict[str, str], list[str]]]:
    """The words, the options that name files, and the files of each command that jobs carry out."""
    for name, (files, options) in KINDS.items():
        needed = {key: "new" for key, kind in options.items() if kind == "write"}
        read = {key: "plan.yaml" for key, kind in options.items() if kind == "read"}
        yield list(name), needed | read, ["plan.yaml"] * files


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.usefixtures("unchanged")
@pytest.mark.one_in(2)
def test_no_word_of_a_job_leads_out(there: Path, name: str) -> None:
    """Each command, each of its files and options, in each way of stating one, alone and doubled."""
    folder, tried = Folder(there), 0
    named = NAMES[name].replace("ABSOLUTE", str(there.parent / "outside.yaml"))
    for words, options, files in _commands():
        stated = [f"{key}={value}" for key, value in options.items()]
        job_command(folder, [*words, *stated, *files])  # the control
        wrong = [[*words, *stated, *files[:k], named, *files[k + 1 :]] for k in range(len(files))]
        for key, value in options.items():
            rest = [own for own in stated if own.partition("=")[0] != key]
            short = [["-o", named], [f"-o={named}"], [f"-o{named}"]] if key == "--out" else []
            for form in ([key, named], [f"{key}={named}"], *short):
                wrong.append([*words, *rest, *form, *files])
                for other in ([key, value], [f"{key}={value}"]):
                    wrong += [[*words, *rest, *other, *form, *files], [*words, *rest, *form, *other, *files]]
        for command in wrong:
            tried += 1
            with pytest.raises(BadInput):
                job_command(folder, command)
    assert tried > 500


def test_what_a_person_alone_may_state_is_no_option_of_a_job() -> None:
    options = {key for _, allowed in KINDS.values() for key in allowed}
    alone = {"--force", "--overwrite", "--yes", "--password", "--watch", "--recorded", "--drop", "--save"}
    assert not options & {*alone, "--workers", "--scheduler", "--json", "--picture", "--serial", "--when"}
    assert {"--resume", "--host", "--user", "--hold-out", "--distance"} <= options  # the control


def test_no_option_of_a_job_is_stated_twice(there: Path) -> None:
    """Of two, one was checked and the other carried out."""
    folder = Folder(there)
    for name, (files, options) in KINDS.items():
        needed = [f"{key}=new" for key, kind in options.items() if kind == "write"]
        for key, kind in options.items():
            option = key if kind == "flag" else f"{key}=laser=1" if key == "--measure" else f"{key}=1"
            command = [*name, *(own for own in needed if not own.startswith(f"{key}=")), option, option]
            if kind in ("values", "held out"):
                made = job_command(folder, [*command, *["plan.yaml"] * files])
                assert made.count(option) == 2
                continue
            with pytest.raises(BadInput, match="twice"):
                job_command(folder, [*command, *["plan.yaml"] * files])
    for command in (
        ["run", "plan.yaml", "--resume", "--out=run.jsonl", "--out=link.yaml"],
        ["run", "plan.yaml", "--resume", "-o", "run.jsonl", "--out", "run.jsonl"],
        ["run", "plan.yaml", "--resume", "--resume", "-o", "run.jsonl"],
    ):
        with pytest.raises(BadInput, match=r"twice|below"):
            job_command(folder, command)


def test_every_allowed_option_exists_and_one_that_takes_a_path_is_resolved() -> None:
    """By the commands' own types; an option of which a value is text cannot name a file."""
    found = set()
    for name, (files, options) in KINDS.items():
        command: Any = typer.main.get_command(app)
        words = list(name)
        while hasattr(command, "commands"):
            command = command.commands[words.pop(0)]
        known = {text for own in command.params for text in (*own.opts, *own.secondary_opts)}
        assert set(options) <= known, name
        assert ("--out" in options) == ("--out" in known), name
        asked = [own for own in command.params if own.param_type_name == "argument"]
        assert len(words) + files <= len(asked) or any(own.nargs == -1 for own in asked), name
        hints = typing.get_type_hints(inspect.unwrap(command.callback))
        for own in command.params:
            for key in set(own.opts) & set(options):
                path = "Path" in str(hints[own.name])
                assert path == (options[key] in ("read", "write")) or key == "--db", (name, key)
                assert own.multiple == (options[key] in ("values", "held out")), (name, key)
                assert own.is_flag == (options[key] == "flag"), (name, key)
                found.add(key)
    assert {"--out", "--header", "--cell", "--sensors", "--db", "--target", "--resume"} <= found


NAMED_BY = {
    "run": ("named.jsonl", ["analyse", "named.jsonl", "--ess=100"]),
    "resumed run": ("named.jsonl", ["run", "plan.yaml", "--resume", "-o", "named.jsonl"]),
    "cell": ("cell.yaml", ["run", "plan.yaml", "--cell=cell.yaml", "-o", "n.jsonl"]),
    "plan": ("p.yaml", ["export", "plan", "rapid", "p.yaml", "-o", "n.mod"]),
}


@pytest.mark.parametrize("kind", NAMED_BY)
@pytest.mark.parametrize("name", ["arm.yaml", "../outside.yaml"])
@pytest.mark.at_length(r"^(?!arm\.yaml-run$)")
def test_no_file_leads_a_job_out_of_the_folder(client: TestClient, there: Path, kind: str, name: str) -> None:
    """And the control: the same file, of the same arm below the folder."""
    file, command = NAMED_BY[kind]
    if kind == "cell":
        (there / file).write_text(f"schema: zerobeam/cell/1\ncamera: null\nrobot: {name}\n")
    elif kind == "plan":
        (there / file).write_text(
            (there / "plan.yaml").read_text().replace("robot: irb1600", f"robot: {name}")
        )
    else:
        (there / file).write_text(_named_in_run(name))
    before = {path: path.read_bytes() for path in there.parent.rglob("*") if path.is_file()}
    job = ended(client, begun(client, *command))
    said = "\n".join(job["log"])
    if name == "arm.yaml":
        assert job["state"] == "done" or kind == "resumed run", said
        assert "app's folder" not in said
        return
    assert (job["state"], job["status"]) == ("failed", 2)
    assert "not below the app's folder" in said
    assert SECRET not in said
    kept = {path: path.read_bytes() for path in before}
    assert kept == before
    assert not list(there.glob("n.*"))


def test_a_job_has_its_folder_in_its_environment_alone(client: TestClient, there: Path) -> None:
    """A link that is made after the words were checked leads no further."""
    shutil.copy(there / "plan.yaml", there.parent / "elsewhere.yaml")
    words = job_command(Folder(there), ["export", "plan", "rapid", "plan.yaml", "-o", "sub/n.mod"])
    assert words[-1] == "plan.yaml"
    os.rmdir(there / "sub")
    (there / "sub").symlink_to("..")
    with pytest.raises(BadInput):
        job_command(Folder(there), ["export", "plan", "rapid", "plan.yaml", "-o", "sub/n.mod"])
    assert client.post("/api/jobs", json={"command": words}).status_code == 400
