"""C code of a CasADi function that sums it over a grid, several walkers at a time.

CasADi's own C code works on one row. Here each operation of the function is written on a vector of the
compiler (as wide as the machine's), one walker a lane, and what depends on `hoisted` inputs alone is
computed once for all shots of a walker. Each lane has the very operations of CasADi's virtual machine, in
their order, so that the numbers are the same.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .arrays import Matrix

_BINARY = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_LT: "zb_lt({0}, {1})",
    ca.OP_LE: "zb_le({0}, {1})",
    ca.OP_IF_ELSE_ZERO: "zb_if({0}, {1})",
    ca.OP_FMIN: "zb_fmin({0}, {1})",
    ca.OP_FMAX: "zb_fmax({0}, {1})",
    ca.OP_ATAN2: "zb_atan2({0}, {1})",
}
_UNARY = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQRT: "zb_sqrt({0})",
    ca.OP_TAN: "zb_tan({0})",
    ca.OP_EXP: "zb_exp({0})",
    ca.OP_LOG: "zb_log({0})",
    ca.OP_FABS: "zb_fabs({0})",
    ca.OP_NOT: "zb_not({0})",
}
_TURNED = {ca.OP_SIN: "s", ca.OP_COS: "c"}  # mostly both are asked for, and one call gives both

LANES = (Path(__file__).parent / "lanes.h").read_text(encoding="utf-8")


class NoSource(Exception):
    """The function has an operation for which there is no C here."""


def grid_source(function: ca.Function, hoisted: Collection[str], *, gram: bool = False) -> str:
    """C source with `zb_sum`: for each outer index the outputs, side by side, summed over the inner.

    `values[k] + o * step[k] + offset[k][i]` is where input k of element (o, i) starts, with row[k][o] for o
    where it has rows; for an input named in `hoisted` the offset is that of i = 0. Raises NoSource for an
    operation that is not known here.
    """
    before: list[str] = []  # once for each block of walkers
    inside: list[str] = []  # once for each shot
    current: dict[int, tuple[str, bool]] = {}  # what a place of CasADi's memory holds: name, fixed over shots
    turns: dict[str, str] = {}  # angles whose sine and cosine are at hand, as s… and c…
    sums: dict[int, str] = {}
    starts, total = [], 0
    for k in range(function.n_out()):
        starts.append(total)
        total += function.numel_out(k)
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        places, results = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            column = starts[results[0]] + _element(function.sparsity_out(results[0]), results[1])
            sums[column] = current[places[0]][0]
            continue
        name = f"v{k}"
        if operation == ca.OP_INPUT:
            i, element = places
            fixed = function.name_in(i) in hoisted
            text = f"zb_load(from[{i}], step[{i}], offset[{i}][{0 if fixed else 'i'}] + {element})"
        elif operation == ca.OP_CONST:
            fixed, text = True, f"zb_all({float(function.instruction_constant(k)).hex()})"
        elif operation in _TURNED:
            angle, fixed = current[places[0]]
            if angle not in turns:
                turns[angle] = name
                (before if fixed else inside).append(
                    f"V s{name}, c{name}; zb_sincos({angle}, &s{name}, &c{name});"
                )
            text = _TURNED[operation] + turns[angle]
        elif operation in _BINARY or operation in _UNARY:
            names = [current[slot][0] for slot in places]
            fixed = all(current[slot][1] for slot in places)
            text = (_BINARY if operation in _BINARY else _UNARY)[operation].format(*names)
        else:
            raise NoSource(f"{function.name()} has the operation {operation} of CasADi")
        current[results[0]] = (name, fixed)
        (before if fixed else inside).append(f"V {name} = {text};")
    columns = sorted(sums)
    first, store = [], []
    if gram:
        (d, f), start = (
            function.size_out(function.n_out() - 1),
            total - function.numel_out(function.n_out() - 1),
        )
        weight, size = sums[start - 1], f * (f + 1) // 2
        root = ", ".join(sums[c] for c in columns if c >= start)
        columns, total = [c for c in columns if c < start - 1], start - 1 + size
        first.append(f"V g[{size}]; for (int c = 0; c < {size}; ++c) g[c] = zb_all(0.0);")
        product = " + ".join(f"r[{d} * a + {k}] * r[{d} * b + {k}]" for k in range(d))
        inside.append(f"V r[] = {{{root}}};")
        inside.append(f"for (int a = 0, c = 0; a < {f}; ++a) for (int b = 0; b <= a; ++b, ++c)")
        inside.append(f"  g[c] += {weight} * ({product});")
        store.append(f"for (int c = 0; c < {size}; ++c) out[(o + l) * {total} + {start - 1} + c] = g[c][l];")
    first += [f"V s{c} = zb_all(0.0);" for c in columns]
    add = [f"s{c} += {sums[c]};" for c in columns]
    store += [f"out[(o + l) * {total} + {c}] = s{c}[l];" for c in columns]
    return f"""{LANES}
void zb_sum(const double **values, const long long *step, const long long **row,
            const long long **offset, long long outer, long long inner, double *out) {{
  for (long long o = 0; o < outer; o += LANES) {{
    const double *from[{max(function.n_in(), 1)}][LANES];
    for (int k = 0; k < {function.n_in()}; ++k)
      for (int l = 0; l < LANES; ++l) {{
        long long at = o + l < outer ? o + l : outer - 1;
        from[k][l] = values[k] + (row[k] ? row[k][at] : at) * step[k];
      }}
    {_lines(first + before)}
    for (long long i = 0; i < inner; ++i) {{
      {_lines(inside + add)}
    }}
    for (int l = 0; l < LANES && o + l < outer; ++l) {{
      {_lines(store)}
    }}
  }}
}}
"""


def _element(sparsity: ca.Sparsity, nonzero: int) -> int:
    """The place of a nonzero in the dense matrix, column by column."""
    return int(sparsity.find()[nonzero])


def _lines(statements: list[str]) -> str:
    return "\n    ".join(statements)


class Offsets(NamedTuple):
    """Where element i of an input starts, in numbers; `address` is that of the array, `last` the largest,
    `fixed` says that all are the same."""

    numbers: NDArray[np.int64]
    address: int
    last: int
    fixed: bool

    @classmethod
    def of(cls, numbers: NDArray[np.int64]) -> Offsets:
        last = int(numbers.max(initial=0))
        return cls(numbers, numbers.ctypes.data, last, bool((numbers == last).all()))


class GridInput(NamedTuple):
    """One input over an outer x inner grid: element (o, i) starts at `o * step + offsets[i]` of `values`,
    or at `rows[o] * step + offsets[i]`.

    `fixed` says that it does not change over the inner index: every offset is the same.
    """

    values: Matrix
    step: int
    offsets: Offsets
    address: int
    fixed: bool = False
    rows: NDArray[np.int64] | None = None


def _grid_input(values: Matrix, step: int, offsets: Offsets, fixed: bool = False) -> GridInput:
    return GridInput(values, step, offsets, values.ctypes.data, fixed)


def per_inner(values: Matrix, inner: int) -> GridInput:
    """An input (inner, size) that changes from shot to shot."""
    values = np.ascontiguousarray(values, dtype=float)
    return _grid_input(values, 0, every(values.size // max(inner, 1), inner))


def per_outer(values: Matrix, inner: int) -> GridInput:
    """An input (outer, size) that changes from walker to walker."""
    values = np.ascontiguousarray(values, dtype=float)
    return _grid_input(values, values.shape[1], every(0, inner), fixed=True)


def per_both(values: Matrix, rows: NDArray[np.int64] | None = None) -> GridInput:
    """An input (outer, inner, size) that changes with both; or the element rows[o] of it for each o."""
    values = np.ascontiguousarray(values, dtype=float)
    _, inner, size = values.shape
    rows = None if rows is None else np.ascontiguousarray(rows, dtype=np.int64)
    return _grid_input(values, inner * size, every(size, inner))._replace(rows=rows)


def columns(values: Matrix, *first: Offsets) -> list[GridInput]:
    """Inputs that stand in rows (outer, p), without a copy: each from the column first[i] on for shot i."""
    address, step = values.ctypes.data, values.shape[1]
    return [GridInput(values, step, offsets, address, offsets.fixed) for offsets in first]


def constant(values: Matrix, inner: int) -> GridInput:
    """An input (size,) that never changes."""
    values = np.ascontiguousarray(values, dtype=float)
    return _grid_input(values, 0, every(0, inner), fixed=True)


@lru_cache(maxsize=256)
def every(size: int, inner: int) -> Offsets:
    """Offsets of an input that starts `size` numbers further for each shot."""
    return Offsets.of(np.arange(inner, dtype=np.int64) * size)
