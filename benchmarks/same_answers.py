"""Are the results the same as before a change? The demo's runs, two real arms, runs with one fault each,
checks, hold-outs, acceptance tests, repeated runs and their drift, small studies.

    git stash, or a checkout of the state before:   python benchmarks/same_answers.py write FOLDER
    with the change:                                python benchmarks/same_answers.py compare FOLDER

Every number, status and name of each `result.json` and `study.json` is compared; times and versions are left
aside. A number may differ by 1e-6 of the standard uncertainty that stands beside it, without one by 1e-6 of
itself. Sentences may be worded anew: how many differ is printed, and they do not count. Exit status 1 where a
number, a name or a status differs. Write twice where kernels were not compiled yet: while they are, the last
digits are others, and what is zero differs. The arms' recordings are read from `../shared/data`, or from the
folder that ZEROBEAM_SHARED_DATA names.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("ZEROBEAM_SHARED_DATA", ROOT.parent / "shared" / "data")) / "mukca"
DEMO_RUNS = ("good", "x-pattern", "uncalibrated")
# Arm: its URDF, base, tip, and how far along the tip's z axis the ball is, mm.
ARMS = {
    "panda_2": ("panda.urdf", "panda_link0", "panda_hand_tcp", 32),
    "kuka_14": ("iiwa14.urdf", "base_link", "tool0", 40),
}
# Each study with as few runs as it takes.
STUDIES = {
    "coverage": ("--data-sets", 100),
    "cell": ("--runs", 20, "--no-camera"),
    "geometry": ("--arms", 20),
    "drift": ("--arms", 20),
    "table2": (),
    "noise": ("--runs", 20),
    "cost": ("--runs", 20),
}
HEADER = """\
robot: irb1600
tool: {kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
targets: {psd: {guess_mm: [900, 0, 100]}}
geometry: exact
"""
MEASUREMENTS = 16
# Misfits of each criterion: a key of the run's header, and what takes its place; what is added to a joint
# (deg), or to the reading of a spot (mm), from one measurement to another.
STATED: dict[str, dict[str, object]] = {
    "noise-too-small": {"noise": {"joint_deg": 0.002, "spot_mm": 0.01}},
    "noise-estimated": {"noise": {"joint_deg": 0.0005, "spot_mm": 0.0025, "scale": "estimated"}},
    "noise-separate": {"noise": {"joint_deg": 0.001, "spot_mm": 0.005, "scale": "separate"}},
    "prior": {"prior": {"offset_deg": 0.05}},
    "tolerances": {"geometry": {}},
    "change": {"geometry": {}},
    "tight": {"geometry": {"tolerance": {"length_mm": 0.03, "angle_deg": 0.01}}},
}
FAULTS: dict[str, tuple[str, int, float, int, int]] = {
    "jump": ("joints_deg", 1, 0.3, 8, MEASUREMENTS),
    "change": ("joints_deg", 1, 0.15, 8, MEASUREMENTS),
    "outlier": ("spot_mm", 0, 5.0, 5, 6),
    "misread": ("joints_deg", 3, 3.0, 5, 6),
}
TOLERANCE = 1e-6
SENTENCES = {"cautions", "text", "headline", "reason", "remedy", "message", "notes", "place"}
ASIDE = {"computing_s", "seconds", "versions", "sha256"}


def zerobeam(*arguments: object) -> str:
    command = [sys.executable, "-c", "from zerobeam.cli import main; main()", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr)
    return done.stdout


def runs(folder: Path) -> Iterator[tuple[str, Path]]:
    for name in DEMO_RUNS:
        yield name, ROOT / "experiments" / "demos" / f"{name}.jsonl"
    for arm, (urdf, base, tip, ball) in ARMS.items():
        places = sorted(place.name for place in (DATA / arm).iterdir() if place.is_dir())
        header = folder / f"{arm}.yaml"
        header.write_text(
            f"robot: {{urdf: {DATA.resolve() / 'urdf' / urdf}, base: {base}, tip: {tip}}}\n"
            f"tool: {{kind: probe, calibrated: false, point_mm: [0, 0, {ball}]}}\n"
            "noise: {joint_deg: 0.01, spot_mm: 0.5}\ngeometry: exact\ndistances:\n"
            + "".join(f"  - {{between: [{p}_0, {p}_1], mm: 50, sigma_mm: 0.1}}\n" for p in places),
            encoding="utf-8",
        )
        sockets = [(place, hole) for place in places for hole in (0, 1)]
        files = [DATA / arm / place / f"hole_{hole}.csv" for place, hole in sockets]
        targets = [word for place, hole in sockets for word in ("--target", f"{place}_{hole}")]
        run = folder / f"{arm}.jsonl"
        zerobeam("import", "csv", *files, "--header", header, "--units", "rad", *targets, "-o", run)
        yield arm, run


def simulated(folder: Path, name: str, seed: int, faults: str = "", geometry: str = "") -> Path:
    """A run of the arm of `HEADER` in a cell with these faults, of an arm that deviates so."""
    plan, run = folder / "plan.yaml", folder / f"{name}.jsonl"
    if not plan.exists():
        header = folder / "header.yaml"
        header.write_text(HEADER, encoding="utf-8")
        options = ("--shots", MEASUREMENTS, "--candidates", 200)
        zerobeam("plan", "optimal", "--header", header, *options, "-o", plan)
    cell_file = folder / f"{name}.yaml"
    cell_file.write_text(
        "schema: zerobeam/cell/1\n"
        f"arm: {{offsets_deg: {{delta2: -1.2, delta4: 0.5}}, geometry: [{geometry}]}}\nfaults: [{faults}]\n",
        encoding="utf-8",
    )
    zerobeam("run", plan, "-o", run, "--cell", cell_file, "--no-camera", "--seed", seed)
    return run


def faulty(run: Path, name: str) -> Path:
    """A copy of a run with another statement in its header, or other values in some measurements."""
    header, *measurements = map(json.loads, run.read_text(encoding="utf-8").splitlines())
    header |= STATED.get(name, {})
    if name in FAULTS:
        key, place, more, first, end = FAULTS[name]
        for measurement in measurements[first:end]:
            measurement[key][place] += more
    copy = run.with_name(f"{name}.jsonl")
    copy.write_text("".join(f"{json.dumps(line)}\n" for line in (header, *measurements)), encoding="utf-8")
    return copy


def half(run: Path, first: int) -> Path:
    """Every second measurement of a run."""
    header, *measurements = run.read_text(encoding="utf-8").splitlines(keepends=True)
    copy = run.with_name(f"{run.stem}-{first}.jsonl")
    copy.write_text(header + "".join(measurements[first::2]), encoding="utf-8")
    return copy


def printed(*arguments: object) -> Any:
    return json.loads(zerobeam(*arguments, "--json"))


def of_faults(folder: Path) -> Iterator[tuple[str, Any]]:
    """Runs with one fault each."""
    run = simulated(folder, "simulated", 1)
    for name in dict.fromkeys((*STATED, *FAULTS)):
        yield name, printed("analyse", faulty(run, name))
    yield "robust", printed("analyse", run.with_name("outlier.jsonl"), "--robust", "huber")
    bump = "{kind: psd-bump, shot: 8, shift_mm: [1.5, 0.5, 0]}"
    yield "moved-target", printed("analyse", simulated(folder, "moved-target", 1, bump))
    links = "{joint: 2, xyz_mm: [0.15, 0, 0], rpy_deg: [0.03, 0, 0]}, {joint: 3, xyz_mm: [0.15, 0.1, 0]}"
    deviating = simulated(folder, "links", 1, geometry=links)
    for name in ("tolerances", "tight"):
        yield f"links-{name}", printed("analyse", faulty(deviating, name))
    yield "check", printed("check", folder / "plan.yaml")


def of_predictions(folder: Path) -> Iterator[tuple[str, Any]]:
    """What a calibration predicts of placements, of another run, and of the corrected arm."""
    run = folder / "panda_2.jsonl"
    yield "placement", printed("analyse", run, "--hold-out", "front_center", "--robust", "student")
    yield "run", printed("analyse", half(run, 0), "--hold-out", half(run, 1))
    yield "stations", printed("check", ROOT / "tests" / "support" / "tracker_by_guess.yaml")
    calibration, plan = folder / "simulated.jsonl", folder / "verify.yaml"
    yield "plan-verify", printed("plan", "verify", calibration, "-o", plan)
    for name, how in (("verify", ()), ("verify-as-found", ("--as-found",))):
        new = folder / f"{name}.jsonl"
        zerobeam(
            "run",
            plan,
            "-o",
            new,
            "--arm",
            calibration,
            "--cell",
            calibration.with_suffix(".yaml"),
            *how,
            "--no-camera",
            "--seed",
            5,
        )
        yield name, printed("verify", calibration, new)


def of_years(folder: Path) -> Iterator[tuple[str, Any]]:
    """Repeated runs of one arm, and how it drifts."""
    every = [folder / "simulated.jsonl", *(simulated(folder, f"again-{k}", k) for k in (2, 3, 4))]
    yield "compare", printed("compare", *every)
    db = f"sqlite:///{folder / 'history.sqlite'}"
    for year, run in enumerate(every, start=2020):
        zerobeam("history", "add", run, "--db", db, "--serial", "one", "--when", f"{year}-03-01")
    yield "drift", printed("history", "drift", "one", "--db", db)


def leaves(value: Any, where: str = "") -> Iterator[tuple[str, object]]:
    """Each number, name or sentence of an answer by its path."""
    key = where.rpartition(".")[2].partition("[")[0]
    if key in ASIDE:
        return
    if isinstance(value, dict):
        for name, item in value.items():
            yield from leaves(item, f"{where}.{name}")
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from leaves(item, f"{where}[{i}]")
    else:
        yield where, value


def is_sentence(where: str) -> bool:
    return where.rpartition(".")[2].partition("[")[0] in SENTENCES


def same(where: str, old: dict[str, Any], new: dict[str, Any]) -> bool:
    before, after = old[where], new[where]
    if before == after or not all(type(value) in (int, float) for value in (before, after)):
        return before == after
    std = old.get(f"{where.rpartition('.')[0]}.std") if where.endswith((".estimate", ".std")) else None
    return abs(before - after) <= TOLERANCE * (std or abs(before))


def answers(folder: Path) -> Iterator[tuple[str, Any]]:
    for name, run in runs(folder):
        yield name, printed("analyse", run)
    for parts in (of_faults, of_predictions, of_years):
        yield from parts(folder)
    for study, options in STUDIES.items():
        zerobeam("study", study, *options, "-o", folder / study)
        yield f"study-{study}", json.loads((folder / study / "study.json").read_text(encoding="utf-8"))


def compare(name: str, before: Any, after: Any) -> bool:
    old, new = dict(leaves(before)), dict(leaves(after))
    numbers = [where for where in old if not is_sentence(where)]
    differ = [where for where in numbers if where not in new or not same(where, old, new)]
    added = {where.partition("[")[0] for where in new if where not in old and not is_sentence(where)}
    worded = sum(new.get(where) != text for where, text in old.items() if is_sentence(where))
    print(
        f"{name}: {len(numbers)} numbers, names and statuses, {len(differ)} differ; {worded} sentences differ"
        + (f"; new: {', '.join(sorted(added))}" if added else "")
    )
    for where in differ[:20]:
        print(f"    {where}: {old[where]!r} -> {new.get(where)!r}")
    return not differ


def main() -> int:
    if len(sys.argv) != 3 or sys.argv[1] not in ("write", "compare"):
        sys.exit(__doc__)
    kept, alike = Path(sys.argv[2]), True
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, answer in answers(Path(folder)):
            file = kept / f"{name}.json"
            if sys.argv[1] == "write":
                file.write_text(json.dumps(answer, indent=1), encoding="utf-8")
                print(f"{name}: written to {file}", flush=True)
            else:
                alike &= compare(name, json.loads(file.read_text(encoding="utf-8")), answer)
    return 0 if alike else 1


if __name__ == "__main__":
    sys.exit(main())
