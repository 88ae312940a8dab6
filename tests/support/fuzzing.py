"""Damaged inputs of every command, made from whole ones, and what must hold whatever the damage.

A whole input is a folder of files and a command on them. `damaged` draws which of its files, or of its
numbers on the command line, is changed, and how: a value of YAML exchanged, a line doubled, bits turned.
"""

import contextlib
import json
import random
import re
import resource
import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Answer, zerobeam
from documents import FILE_PAGES, blocks, read
from exact_runs import demo_runs
from export_runs import urdf_run
from recorded_logs import HEADER as LOG_HEADER
from recorded_logs import moves, table, ur
from ros_bags import Bag, file_of
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from zerobeam.model.files.robot_file import BUILT_IN

Files = dict[str, bytes]


@dataclass(frozen=True)
class Whole:
    """A command, the files that it needs and those of them that are damaged; `often`: its share."""

    command: str
    needs: tuple[str, ...]
    damages: tuple[str, ...]
    often: float = 1.0

    @property
    def quick(self) -> bool:
        """Whether it takes milliseconds also where the damage does not matter."""
        known = ("check plan.yaml", "compare first.json second.json", "compare table2.csv --json")
        return self.command in known or self.command.startswith(("import", "schema"))


@dataclass(frozen=True)
class Damaged:
    """A command with damaged input, and what was done to it."""

    words: tuple[str, ...]
    files: Files
    how: str


LOG = "--target psd --header log.yaml --still-deg 0.05 --still-s 0.5 -o made"
RUN = ("run.jsonl",)
OWN = ("own.jsonl", "arm.yaml")
CELL = ("plan.yaml", "cell.yaml", "psd-a.yaml")
CHAIN = ("chain.jsonl", "arm.urdf")
WHOLE = (
    Whole("check plan.yaml", ("plan.yaml",), ("plan.yaml",), 2),
    Whole("check own.yaml", ("own.yaml", "arm.yaml"), ("own.yaml", "arm.yaml"), 3),
    Whole("export json chain.jsonl -o made", CHAIN, ("arm.urdf",), 2),
    Whole("check plan.yaml --picture made.html", ("plan.yaml",), ("plan.yaml",), 0.1),
    Whole("analyse run.jsonl --ess 100", RUN, RUN, 3),
    Whole("analyse own.jsonl --ess 100 --json", OWN, OWN, 2),
    Whole("analyse chain.jsonl --ess 100", CHAIN, CHAIN),
    Whole("analyse geometry.jsonl --ess 100", ("geometry.jsonl",), ("geometry.jsonl",), 0.2),
    Whole("analyse run.jsonl --ess 100 --robust huber", RUN, RUN, 0.5),
    Whole("report run.jsonl -o made --ess 100", RUN, RUN, 0.1),
    Whole("compare run.jsonl run2.jsonl", (*RUN, "run2.jsonl"), ("run2.jsonl",), 0.5),
    Whole("compare first.json second.json -o made", ("first.json", "second.json"), ("second.json",), 1),
    Whole("compare first.json second.json", ("first.json", "second.json"), ("second.json",), 2),
    Whole("compare table2.csv --json", ("table2.csv",), ("table2.csv",), 2),
    Whole("plan x --header header.yaml --target 900,0,0 -o made", ("header.yaml",), ("header.yaml",)),
    Whole(
        "plan optimal --header header.yaml --target 900,0,0 --shots 5 --candidates 100 -o made"
        " --obstacles obstacles.yaml",
        ("header.yaml", "obstacles.yaml"),
        ("header.yaml", "obstacles.yaml"),
        1,
    ),
    Whole("run plan.yaml -o made --cell cell.yaml", ("plan.yaml", "cell.yaml"), ("cell.yaml",), 0.6),
    Whole("run plan.yaml -o made --no-camera", ("plan.yaml",), ("plan.yaml",), 0.1),
    Whole("run good.yaml -o made --rig replay --recorded run.jsonl", ("good.yaml", *RUN), RUN, 1),
    Whole(
        "run good.yaml -o made.jsonl --no-camera --resume", ("good.yaml", "made.jsonl"), ("made.jsonl",), 0.5
    ),
    Whole(
        "run plan.yaml -o made --rig abb --host 127.0.0.1 --port 9 --user a --password b --yes"
        " --sensors sensors.yaml",
        ("plan.yaml", "sensors.yaml", "psd-a.yaml"),
        ("sensors.yaml", "psd-a.yaml"),
    ),
    Whole(
        "import csv first.csv --target psd --units rad --header header.yaml --header-row"
        " --columns j1,j2,j3,j4,j5,j6 --time-column time --time-units s -o made",
        ("first.csv", "header.yaml"),
        ("first.csv", "header.yaml"),
        2,
    ),
    Whole(f"import log ur ur.csv {LOG}", ("ur.csv", "log.yaml"), ("ur.csv",)),
    Whole(f"import log robodk robodk.csv {LOG}", ("robodk.csv", "log.yaml"), ("robodk.csv",)),
    Whole(f"import log egm egm.csv {LOG}", ("egm.csv", "log.yaml"), ("egm.csv",)),
    Whole("import fanuc shots.ls --j3 ground --target psd --header header.yaml -o made",
          ("shots.ls", "header.yaml"), ("shots.ls",)),
    Whole("import kuka shots.dat --target psd --header header.yaml -o made",
          ("shots.dat", "header.yaml"), ("shots.dat",)),
    *(
        Whole(f"import ros {name} {LOG}", (name, "log.yaml"), (name,))
        for name in ("log.bag", "log.mcap", "log.db3")
    ),
    Whole("export csv run.jsonl -o made", RUN, RUN, 0.5),
    Whole("export json own.jsonl -o made --unvalidated", OWN, OWN, 0.5),
    Whole("export robot own.jsonl -o made --allow-weak --unvalidated", OWN, OWN, 0.5),
    Whole("export urdf chain.jsonl -o made --allow-weak --unvalidated", CHAIN, CHAIN, 0.5),
    Whole("export rapid run.jsonl -o made --allow-weak", RUN, RUN, 0.2),
    Whole("export moc run.jsonl -o made --allow-weak --unvalidated --against MOC.cfg --motor-sign 1"
          " --ratio 100,121,-90.5,60,50,-40", (*RUN, "MOC.cfg"), ("MOC.cfg",)),
    Whole("study file study.yaml -o made --runs 0", ("study.yaml",), ("study.yaml",), 0.3),
    Whole("schema run-header", (), (), 0.3),
)  # fmt: skip


def whole_files(folder: Path, *, recorded: bool) -> Files:
    """Content of all files by name: those of the documentation, and what is made in `folder`. A run that can
    be gone on with is there if `recorded`."""
    text: dict[str, str] = {}
    for page in (*FILE_PAGES, "docs/studies.md"):
        text |= {block.title: block.text for block in blocks(read(page)) if block.title}
    for block in blocks(read("docs/sensors.md")):
        for schema, name in (("sensors/1", "sensors.yaml"), ("psd-calibration/1", "psd-a.yaml")):
            if block.text.startswith(f"schema: zerobeam/{schema}"):
                text[name] = block.text.replace("/dev/ttyUSB0", "/dev/ttyNONE")
    plan = text["plan.yaml"] = text["x-pattern.yaml"]
    text["cell.yaml"] = re.sub("faults:.*", "", text["cell.yaml"], flags=re.DOTALL)
    text["study.yaml"] = re.sub(r"values: \[700.*?\]", "values: [900]", text["study.yaml"])
    text["study.yaml"] = (
        text["study.yaml"].partition("  - key: tool")[0].replace("optimal, shots: 7", "x, shots: 5")
    )
    typical = demo_runs()[0].path.read_text(encoding="utf-8")
    good = typical.replace('"robot":', '"geometry":"exact","robot":', 1)
    head, *shots = good.splitlines()
    text["run.jsonl"] = good
    actual = {**json.loads(head), "schema": "zerobeam/plan/1"}
    actual["postures_deg"] = [json.loads(shot)["joints_deg"] for shot in shots]
    text["good.yaml"] = json.dumps(actual, indent=1)
    text["run2.jsonl"] = "\n".join([head, *shots[::-1]]) + "\n"
    text["own.yaml"], text["own.jsonl"] = (
        plan.replace("irb1600", "arm.yaml"),
        good.replace("irb1600", "arm.yaml"),
    )
    text["arm.yaml"] = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    text["geometry.jsonl"] = typical
    text["chain.jsonl"] = urdf_run(folder, shots=7).path.read_text(encoding="utf-8")
    text["arm.urdf"] = (folder / "arm.urdf").read_text(encoding="utf-8")
    if recorded:
        (folder / "good.yaml").write_text(text["good.yaml"])
        zerobeam("run", folder / "good.yaml", "-o", folder / "made.jsonl", "--no-camera")
        text["made.jsonl"] = "".join((folder / "made.jsonl").read_text("utf-8").splitlines(keepends=True)[:6])
    text["obstacles.yaml"] = (
        "floor_mm: 0\nboxes:\n  - {name: table, min_mm: [600, -400, -90], max_mm: [1200, 400, -80]}\n"
        "thickness_mm: 60\n"
    )
    text["MOC.cfg"] = "MOC:CFG_1.0:6:0::\n#\nMOTOR_CALIB:\n\n" + "".join(
        f'      -name "rob1_{i}" -cal_offset {i}.5 -valid_cal_offset -note "-cal_offset 9"\n'
        for i in range(1, 7)
    )
    times, joints = moves(rate=10.0)
    text["log.yaml"], text["ur.csv"] = LOG_HEADER, ur(times, joints)
    text["robodk.csv"] = table(None, np.column_stack([joints, times]).tolist(), ",")
    names = ["TIMESTAMP", *(f"R_FB_POS_RJ{i}" for i in range(1, 7))]
    text["egm.csv"] = table(names, np.column_stack([times * 1000, joints]).tolist(), ",")
    return {name: content.encode() for name, content in text.items()} | _results() | _bags(folder)


def _results() -> Files:
    """One result, and another that claims to be of another run."""
    answer = zerobeam("analyse", demo_runs()[0].path, "--json", "--ess", 100).json
    first = json.dumps(answer).encode()
    answer["inputs"]["sha256"] = "0" * 64
    return {"first.json": first, "second.json": json.dumps(answer).encode()}


def _bags(folder: Path) -> Files:
    bags: Files = {}
    times, joints = moves(rate=10.0)
    for kind, name in (("ros1", "log.bag"), ("mcap", "log.mcap"), ("sqlite", "log.db3")):
        (folder / kind).mkdir()
        bags[name] = file_of(Bag(kind).states(times, joints).write(folder / kind)).read_bytes()
    return bags


# --- damage -----------------------------------------------------------------------------------------

NUMBERS = [
    *(
        "0",
        "-0.0",
        "-1",
        "1e30",
        "-1e30",
        "1e160",
        "1e-160",
        "1e308",
        "5e-324",
        "1e999",
        "nan",
        ".inf",
        "-.inf",
    ),
    *("NaN", "Infinity", "2", "7", "1e6", "100000", "1e-12", "0x10", "1_000", "1,5", "3.7e-9", "90", "-360"),
    *("1" * 400, "9" * 5000),
]
TEXTS = [
    *(
        "",
        " ",
        "\r",
        "null",
        "~",
        "true",
        "[]",
        "{}",
        "psd",
        "delta2",
        "tool",
        "auto",
        "\u202e",
        "\x00",
        "\x1b[2J",
    ),
    *(
        "ä€🎯",
        "../../etc/passwd",
        "/dev/zero",
        "*a",
        "&a [*a]",
        "!!python/object:os.system x",
        "'",
        '"',
        "%s%n",
    ),
    *("=cmd|' /C calc'!A0", "-", "- ", ": ", "{", "[", "irb1600", "panda", "#", "x" * 3000),
]
VALUES: list[Any] = [
    *(None, True, False, 0, -1, 1, 2, 1e30, -1e30, 1e160, 1e-160, 1e308, 5e-324, 10**400, 1e6, -1e6, 100_000),
    *(90, 1e-12, 0.5, "", "psd", "delta2", "tool", "irb1600", "panda", "\u202e\x1b", "x" * 999, [], {}),
    *([0, 0, 0], [1, 0, 0], [1], ["delta1"], [[]], {"a": 1}, "estimated", "separate", "probe", "laser"),
    *("prismatic", "warn"),
]
BROKEN = (ValueError, IndexError, KeyError, TypeError, OverflowError, RecursionError, YAMLError)


def damaged(rng: random.Random, files: Files, whole: Whole) -> Damaged:
    """One damaged input of a command, by chance."""
    values = {name: files[name] for name in whole.needs}
    words = shlex.split(whole.command)
    message = []
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        if not whole.damages:
            position = rng.randrange(1, len(words))
            words[position] = rng.choice([text for text in (*TEXTS, *NUMBERS) if "/" not in text])
            message.append(f"{words[position][:20]!r} as word {position}")
            continue
        numbers = [i for i, word in enumerate(words) if re.fullmatch(r"-?[0-9.,-]+", word)]
        if numbers and rng.random() < 0.15:
            position = rng.choice(numbers)
            words[position] = rng.choice([*NUMBERS, "1e30,1e30,1e30", "", "x"])
            message.append(f"{words[position][:20]!r} as word {position}")
            continue
        name = rng.choice(whole.damages)
        structured = name.endswith((".yaml", ".json", ".jsonl")) and rng.random() < 0.6
        how = rng.choice(_OF_VALUES if structured else _OF_TEXT)
        try:
            values[name] = (_in_values if structured else _in_text)(rng, name, values[name], how)
        except BROKEN:  # too damaged already for this kind
            values[name] = values[name][: rng.randrange(len(values[name]) + 1)]
        message.append(f"{how.__name__} in {name}")
    return Damaged(tuple(words), values, "; ".join(message))


def draw(rng: random.Random, among: Sequence[Whole]) -> Whole:
    return rng.choices(among, [whole.often for whole in among])[0]


def _in_text(rng: random.Random, name: str, content: bytes, how: Callable[..., bytes]) -> bytes:
    return how(rng, content)


def _in_values(rng: random.Random, name: str, content: bytes, how: Callable[..., None]) -> bytes:
    """Exchange parts of the values of YAML, JSON, or one line of JSON lines."""
    lines = content.decode().split("\n") if name.endswith(".jsonl") else [content.decode()]
    line = rng.choice([0, rng.randrange(len(lines))])
    yaml = YAML(typ="safe", pure=True)
    value = yaml.load(lines[line]) if name.endswith(".yaml") else json.loads(lines[line])
    how(rng, *rng.choice(list(_places(value))))
    lines[line] = json.dumps(value, indent=1 if name.endswith(".yaml") else None)  # which is YAML too
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every list or mapping in a value, and each of its keys."""
    for key in list(value) if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from _places(value[key])


def another_value(rng: random.Random, inside: Any, key: Any) -> None:
    inside[key] = rng.choice(VALUES)


def scaled(rng: random.Random, inside: Any, key: Any) -> None:
    if isinstance(inside[key], int | float):
        inside[key] *= rng.choice([-1, 0, 1e-9, 1e-3, 0.5, 2, 57.3, 1e3, 1e9, 1e200])


def left_out(rng: random.Random, inside: Any, key: Any) -> None:
    del inside[key]


def doubled(rng: random.Random, inside: Any, key: Any) -> None:
    if isinstance(inside, list):
        inside.insert(key, inside[key])
    else:
        inside[f"{key}2"] = inside[key]


def many(rng: random.Random, inside: Any, key: Any) -> None:
    inside[key] = [inside[key]] * rng.choice([1, 2, 6, 300])


def exchanged(rng: random.Random, inside: Any, key: Any) -> None:
    other = rng.choice(list(inside) if isinstance(inside, dict) else range(len(inside)))
    inside[key], inside[other] = inside[other], inside[key]


def another_number(rng: random.Random, content: bytes) -> bytes:
    result = list(re.finditer(rb"-?[0-9]+(\.[0-9]+)?(e-?[0-9]+)?", content))
    one = rng.choice(result)
    return content[: one.start()] + rng.choice(NUMBERS).encode() + content[one.end() :]


def another_word(rng: random.Random, content: bytes) -> bytes:
    one = rng.choice(list(re.finditer(rb"[A-Za-z_]+", content)))
    return content[: one.start()] + rng.choice(TEXTS).encode() + content[one.end() :]


def turned_bit(rng: random.Random, content: bytes) -> bytes:
    position = rng.randrange(len(content))
    return content[:position] + bytes([content[position] ^ 1 << rng.randrange(8)]) + content[position + 1 :]


def cut(rng: random.Random, content: bytes) -> bytes:
    return content[: rng.randrange(len(content))]


def inserted(rng: random.Random, content: bytes) -> bytes:
    position = rng.randrange(len(content) + 1)
    return content[:position] + rng.choice([*TEXTS, *NUMBERS, "\n", "\t", ","]).encode() + content[position:]


def without_part(rng: random.Random, content: bytes) -> bytes:
    start = rng.randrange(len(content))
    return content[:start] + content[start + rng.choice([1, 2, 10, 100]) :]


def doubled_line(rng: random.Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    position = rng.randrange(len(lines))
    return b"\n".join(
        [*lines[:position], *[lines[position]] * rng.choice([2, 2, 50]), *lines[position + 1 :]]
    )


def exchanged_lines(rng: random.Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)


def garbage(rng: random.Random, content: bytes) -> bytes:
    return rng.randbytes(rng.choice([1, 30, 1000]))


_OF_VALUES = (another_value, another_value, scaled, scaled, left_out, doubled, many, exchanged)
_OF_TEXT = (
    *(another_number, another_number, another_word, turned_bit, cut, inserted, without_part),
    *(doubled_line, exchanged_lines, garbage),
)


# --- what must hold ---------------------------------------------------------------------------------

LONGEST_S = 10.0
MOST_BYTES = 10**9
_ALONE_KB = 300_000  # of a process that has run nothing but a few commands
# Of other programs' libraries, or of numbers: they say nothing to a person who gave a file.
_NOT_FOR_PEOPLE = ("Traceback", "fault of zerobeam itself", "Warning", "encountered in", "pydantic", "casadi")


def faults(answer: Answer, before: Files, after: Files, seconds: float, kilobytes: int) -> list[str]:
    """What is wrong with the answer to a damaged input, or with what it left in the folder."""
    result = [word for word in _NOT_FOR_PEOPLE if word in answer.err]
    if answer.status not in (0, 1, 2, 3) and answer.err != "stopped\n":
        result.append(f"status {answer.status}")
    if answer.status == 2 or (answer.status == 3 and not answer.out):  # else the answer says what failed
        if answer.err.count("error: ") != 1 and "Usage: " not in answer.err:
            result.append("not one message")
        if answer.status == 2 and answer.out:
            result.append("printed something")
    if answer.status == 2 and after != before:
        result.append(f"wrote {sorted(set(after) - set(before)) or 'into its input'}")
    if seconds > LONGEST_S:
        result.append(f"took {seconds:.0f} s")
    if kilobytes * 1024 > MOST_BYTES:
        result.append("took more than 1 GB")
    return result


def judged(one: Damaged, folder: Path) -> tuple[Answer, list[str]]:
    """The answer to a damaged input in an empty folder, and what is wrong with it."""
    for name, content in one.files.items():
        (folder / name).write_bytes(content)
    with contextlib.chdir(folder):
        start, largest = time.process_time(), _of_others()
        answer = zerobeam(*one.words)
        seconds = time.process_time() - start
    after = {path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else b""
             for path in folder.rglob("*")}  # fmt: skip
    return answer, faults(answer, one.files, after, seconds, _peak() - largest)


def _of_others() -> int:
    """Kilobytes that are not the command's but of tests that the process ran before."""
    if _peak() * 1024 > MOST_BYTES:
        return _peak()
    resident = int(Path("/proc/self/statm").read_text("ascii").split()[1]) * resource.getpagesize() // 1024
    return max(0, resident - _ALONE_KB)


def _peak() -> int:
    """The most kilobytes that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
