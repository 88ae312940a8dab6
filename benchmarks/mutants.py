"""Would the tests notice? Random changes of numbers and operators in `model/` and `analysis/`, one at a time,
each against the tests of its folder (all but the long ones).

    .venv/bin/python benchmarks/mutants.py --count 100 --seed 1

A file is changed where it stands and put back: nobody works in this checkout meanwhile. Errors, texts and
assertions are left as they are.
"""

from __future__ import annotations

import argparse
import ast
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("model", "analysis")
# How it is written, and what becomes of it.
OPERATORS: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
}
COMPARED: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", ">="),
    ast.LtE: ("<=", ">"),
    ast.Gt: (">", "<="),
    ast.GtE: (">=", "<"),
}


class Mutant(NamedTuple):
    """Text from `start` to `end` (bytes of the file) that becomes `text`."""

    file: Path
    line: int
    start: int
    end: int
    text: str


def mutants(file: Path) -> Iterator[Mutant]:
    """All of a file: numbers in functions, sums, products and comparisons."""
    source = file.read_bytes()
    starts = [0]
    for row in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(row))

    def at(line: int, column: int) -> int:
        return starts[line - 1] + column

    def between(left: ast.expr, right: ast.expr, old: str, new: str, line: int) -> Iterator[Mutant]:
        start, end = at(left.end_lineno or 0, left.end_col_offset or 0), at(right.lineno, right.col_offset)
        if (place := source[start:end].find(old.encode())) >= 0:
            yield Mutant(file, line, start + place, start + place + len(old), new)

    functions = [one for one in ast.walk(ast.parse(source)) if isinstance(one, ast.FunctionDef)]
    for one in {node for function in functions for part in function.body for node in calculated(part)}:
        match one:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                start = at(one.lineno, one.col_offset)
                new = value + 1 if isinstance(value, int) else value * 1.5 + 0.1 * (value == 0)
                yield Mutant(
                    file, one.lineno, start, at(one.end_lineno or 0, one.end_col_offset or 0), repr(new)
                )
            case ast.BinOp(op=op) if type(op) in OPERATORS and not texts(one):
                yield from between(one.left, one.right, *OPERATORS[type(op)], one.lineno)
            case ast.Compare(ops=[op], comparators=[right]) if type(op) in COMPARED:
                yield from between(one.left, right, *COMPARED[type(op)], one.lineno)


def calculated(part: ast.AST) -> Iterator[ast.AST]:
    """What is below a statement, but for errors and texts."""
    if isinstance(part, ast.Raise | ast.JoinedStr | ast.Assert | ast.FunctionDef):
        return
    yield part
    for below in ast.iter_child_nodes(part):
        yield from calculated(below)


def texts(sum_: ast.BinOp) -> bool:
    return any(
        isinstance(one, ast.Constant) and isinstance(one.value, str) for one in (sum_.left, sum_.right)
    )


def noticed(one: Mutant) -> bool:
    """Whether a test of the file's folder fails."""
    folder = ROOT / "tests" / one.file.parent.relative_to(ROOT)
    tests = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-n",
        "2",
        "-p",
        "no:cacheprovider",
        "-m",
        "not long",
    ]
    whole = one.file.read_bytes()
    try:
        one.file.write_bytes(whole[: one.start] + one.text.encode() + whole[one.end :])
        return (
            subprocess.run([*tests, str(folder)], cwd=ROOT, capture_output=True, check=False).returncode != 0
        )
    finally:
        one.file.write_bytes(whole)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    files = [file for room in ROOMS for file in sorted((ROOT / room).rglob("*.py"))]
    every = [one for file in files for one in sorted(mutants(file))]
    caught = 0
    chosen = random.Random(asked.seed).sample(every, asked.count)
    for number, one in enumerate(chosen, start=1):
        found = noticed(one)
        caught += found
        old = one.file.read_bytes()[one.start : one.end].decode()
        place = f"{one.file.relative_to(ROOT)}:{one.line}"
        print(f"{number:4} {'noticed' if found else 'SURVIVES'} {place}: {old} -> {one.text}", flush=True)
    print(f"{caught} of {len(chosen)} are noticed; {len(every)} could have been made")


if __name__ == "__main__":
    main()
