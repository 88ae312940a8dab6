"""Do the tests notice a wrong formula? One change at a time in what computes numbers, and who catches it.

    python .ci/mutants.py --count 100 --seed 1    # of model/ and analysis/, up to the whole of `make test`
    python .ci/mutants.py --count 20 --mirrored analysis/drift

A mutant is one changed sign, operator, comparison, index or bound, in a copy of the tree. The tests of its
module run first, then those of its folder, then all but the long ones; the first that fails (or takes ten
minutes) has caught it. Survivors are listed with their difference: one that changes no number is for a person
to discount (`--equivalent N`). Exits 1 where fewer than 95 of 100 are caught.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
REQUIRED = 0.95
SECONDS = 600  # of one run of tests: a mutant that never ends has been noticed

BINARY: dict[type[ast.operator], str] = {
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.Pow: "*",
}
COMPARISON: dict[type[ast.cmpop], str] = {ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<"}
# Of a bound that is a whole number: off by one. Of others nothing is ever equal to them.
WHOLE: dict[type[ast.cmpop], str] = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
TOKENS: dict[type[ast.AST], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
TOKENS |= {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
BOUNDS = {
    "minimum": "maximum",
    "maximum": "minimum",
    "min": "max",
    "max": "min",
    "floor": "ceil",
    "ceil": "floor",
}


TEXTS = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp, ast.Set, ast.Dict)


def is_text(node: ast.expr) -> bool:
    """Whether an operand is a text or a collection: `+` joins them."""
    return isinstance(node, TEXTS) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


class Mutant(NamedTuple):
    """The characters `start` to `end` of `file` (relative to the root) replaced by `text`."""

    file: Path
    line: int
    start: int
    end: int
    text: str


class Sites(ast.NodeVisitor):
    """The changes that a module offers. Annotations, texts, messages, types and constants in capitals that
    are no numbers are passed by."""

    def __init__(self, file: Path, source: str) -> None:
        self.file, self.source = file, source
        self.lines = [0]
        for line in source.splitlines(keepends=True):
            self.lines.append(self.lines[-1] + len(line.encode()))
        self.bytes = source.encode()
        self.found: list[Mutant] = []
        self.visit(ast.parse(source))

    def at(self, line: int | None, column: int | None) -> int:
        return self.lines[(line or 1) - 1] + (column or 0)

    def add(self, line: int, start: int, end: int, text: str) -> None:
        self.found.append(Mutant(self.file, line, start, end, text))

    def between(self, left: ast.expr, right: ast.expr, token: str, text: str) -> None:
        """The operator `token` between two operands becomes `text`."""
        start, end = self.at(left.end_lineno, left.end_col_offset), self.at(right.lineno, right.col_offset)
        gap = re.sub(rb"#[^\n]*", lambda comment: b" " * len(comment[0]), self.bytes[start:end])
        offset = gap.find(token.encode())
        if offset >= 0:
            self.add(left.end_lineno or 1, start + offset, start + offset + len(token), text)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        numbers = not any(is_text(side) for side in (node.left, node.right))
        if type(node.op) in BINARY and numbers:
            self.between(node.left, node.right, TOKENS[type(node.op)], BINARY[type(node.op)])
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if type(node.op) in BINARY and not is_text(node.value):
            self.between(node.target, node.value, TOKENS[type(node.op)] + "=", BINARY[type(node.op)] + "=")
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, operator, right in zip(
            [node.left, *node.comparators], node.ops, node.comparators, strict=False
        ):
            if type(operator) in COMPARISON:
                self.between(left, right, TOKENS[type(operator)], COMPARISON[type(operator)])
                if isinstance(right, ast.Constant) and type(right.value) is int:
                    self.between(left, right, TOKENS[type(operator)], WHOLE[type(operator)])
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub):
            start = self.at(node.lineno, node.col_offset)
            self.add(node.lineno, start, start + 1, "" if not isinstance(node.operand, ast.Constant) else "+")
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        for part in ast.walk(node.slice):
            if isinstance(part, ast.Constant) and type(part.value) is int:
                start, end = (
                    self.at(part.lineno, part.col_offset),
                    self.at(part.end_lineno, part.end_col_offset),
                )
                self.add(part.lineno, start, end, str(part.value + 1))
        self.visit(node.value)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in BOUNDS and node.func.end_lineno is not None:
            end = self.at(node.func.end_lineno, node.func.end_col_offset)
            self.add(node.func.end_lineno, end - len(name), end, BOUNDS[name])
        self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if node.returns is None or ast.unparse(node.returns) != "str":
            for part in (*node.args.defaults, *filter(None, node.args.kw_defaults), *node.body):
                self.visit(part)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        if not re.search(r"Literal\[|Callable\[|tuple\[|dict\[", ast.unparse(node.value)):
            self.generic_visit(node)

    def passed_by(self, node: ast.AST) -> None:
        """Messages, and what computes no number."""

    visit_Raise = visit_JoinedStr = visit_Assert = visit_Import = visit_ImportFrom = passed_by


def mutants(folders: list[str]) -> Iterator[Mutant]:
    """All that the modules of the folders offer."""
    for folder in folders:
        for file in sorted((ROOT / folder).rglob("*.py")):
            yield from Sites(file.relative_to(ROOT), file.read_text(encoding="utf-8")).found


def suites(file: Path, mirrored: bool) -> Iterator[list[str]]:
    """The tests to run for a module, the likeliest to notice first."""
    folder = Path("tests", file.parent)
    mirrored_test = folder / f"test_{file.stem}.py"
    tests = [test.relative_to(ROOT) for test in sorted((ROOT / folder).glob("test_*.py"))]
    beside = [str(test) for test in tests if test != mirrored_test]
    if (ROOT / mirrored_test).exists():
        yield ["-n0", str(mirrored_test)]
    if beside:
        yield ["-n0", *beside]
    if not mirrored:
        yield ["-n", "auto", "--dist", "worksteal"]


def caught_by(mutant: Mutant, mirrored: bool) -> str | None:
    """The tests that notice the mutant; None where none does."""
    with tempfile.TemporaryDirectory(prefix="zerobeam-mutant-") as name:
        tree = Path(name, "zerobeam")
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".*", "build", "__pycache__"))
        (tree / "build").mkdir()
        (tree / mutant.file).write_bytes(mutated(mutant))
        for tests in suites(mutant.file, mirrored):
            command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not long", "-p", "no:cacheprovider"]
            # The copy is found before the editable install.
            with subprocess.Popen(
                [*command, *tests],
                cwd=tree,
                env={**os.environ, "PYTHONPATH": name},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            ) as run:
                try:
                    failed = run.wait(SECONDS) != 0
                except subprocess.TimeoutExpired:
                    os.killpg(run.pid, signal.SIGKILL)
                    failed = True
            if failed:
                return tests[1] if len(tests) == 2 else "folder" if tests[0] == "-n0" else "all"
    return None


def mutated(mutant: Mutant) -> bytes:
    source = (ROOT / mutant.file).read_bytes()
    return source[: mutant.start] + mutant.text.encode() + source[mutant.end :]


def difference(mutant: Mutant) -> str:
    old, new = ((ROOT / mutant.file).read_bytes(), mutated(mutant))
    lines = (text.decode().splitlines(keepends=True) for text in (old, new))
    return "".join(difflib.unified_diff(*lines, str(mutant.file), "mutant", n=1))


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="*", default=["model", "analysis"])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mirrored", action="store_true", help="the tests of the module's folder alone")
    parser.add_argument("--equivalent", type=int, default=0, help="survivors that change no number")
    chosen = parser.parse_args()
    every = list(mutants(chosen.folders))
    some = random.Random(chosen.seed).sample(every, min(chosen.count, len(every)))
    survivors = []
    for number, mutant in enumerate(some, start=1):
        by = caught_by(mutant, chosen.mirrored)
        say(f"{number}/{len(some)} {mutant.file}:{mutant.line} {by or 'SURVIVED'}")
        if by is None:
            survivors.append(mutant)
    for mutant in survivors:
        say(difference(mutant))
    counted = len(some) - chosen.equivalent
    caught = len(some) - len(survivors)
    say(f"{caught} of {counted} caught, {len(survivors)} survived, of {len(every)} possible mutants")
    return 0 if caught >= REQUIRED * counted else 1


if __name__ == "__main__":
    sys.exit(main())
