"""A CasADi function made fast: evaluated for many rows, or summed over shots for many walkers.

Where a C compiler is at hand, the function's C code is compiled once and cached under the hash
of its source, the flags and the compiler; elsewhere CasADi's virtual machine evaluates it. The
numbers are the same, the virtual machine is about ten times slower.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
import warnings
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .robot import Matrix

# No contraction to fused multiply-adds: both paths must give the same numbers.
_FLAGS = ("-O2", "-shared", "-fPIC", "-ffp-contract=off", "-fno-math-errno")
_DIGEST = 32  # bytes of the sha256 that ends each cached library
_POINTER = ctypes.POINTER(ctypes.c_double)


class KernelWarning(UserWarning):
    """The compiled path was asked for and is not to be had; the plain one serves."""


class GridInput(NamedTuple):
    """One input over an outer x inner grid: element (o, i) starts at `o * step + offset[i]` of `values`."""

    values: Matrix
    step: int
    offset: NDArray[np.int64]


def per_inner(values: Matrix, inner: int) -> GridInput:
    """An input (inner, size) that changes from shot to shot."""
    values = np.ascontiguousarray(values, dtype=float)
    return GridInput(values, 0, np.arange(inner, dtype=np.int64) * (values.size // max(inner, 1)))


def per_outer(values: Matrix, inner: int) -> GridInput:
    """An input (outer, size) that changes from walker to walker."""
    values = np.ascontiguousarray(values, dtype=float)
    return GridInput(values, values.shape[1], np.zeros(inner, dtype=np.int64))


def selected(values: Matrix, index: NDArray[np.int64]) -> GridInput:
    """An input (outer, choices, size), of which shot i takes choice index[i]."""
    values = np.ascontiguousarray(values, dtype=float)
    return GridInput(values, values.shape[1] * values.shape[2], index.astype(np.int64) * values.shape[2])


def constant(values: Matrix, inner: int) -> GridInput:
    """An input (size,) that never changes."""
    return GridInput(np.ascontiguousarray(values, dtype=float), 0, np.zeros(inner, dtype=np.int64))


class Kernel:
    """Fast evaluation of a CasADi function whose inputs are vectors and whose outputs are dense.

    `compiled` says which path serves; `compile` True asks for C and falls back, with one
    KernelWarning, where no compiler is found or it fails.
    """

    def __init__(self, function: ca.Function, *, compile: bool = False) -> None:
        self.function = function
        self._in = [function.numel_in(k) for k in range(function.n_in())]
        self._out_shapes = [function.size_out(k) for k in range(function.n_out())]
        self._out = [rows * columns for rows, columns in self._out_shapes]
        self._maps: dict[int, ca.Function] = {}
        self._library = _load(function) if compile else None

    @property
    def compiled(self) -> bool:
        return self._library is not None

    def __call__(self, *inputs: Matrix) -> tuple[Matrix, ...]:
        """Evaluate rows: each input is (rows, size), or (size,) for all rows; outputs are (rows, *shape).

        Raises ValueError for an input of another shape: CasADi itself would map over it silently.
        """
        if len(inputs) != len(self._in):
            raise ValueError(f"{self.function.name()} takes {len(self._in)} inputs, got {len(inputs)}")
        arrays = [np.ascontiguousarray(value, dtype=float) for value in inputs]
        counts = {a.shape[0] for a in arrays if a.ndim == 2}
        if len(counts) > 1:
            raise ValueError(
                f"{self.function.name()}: inputs with different numbers of rows: {sorted(counts)}"
            )
        rows = counts.pop() if counts else 1
        grid: list[GridInput] = []
        for k, (array, size) in enumerate(zip(arrays, self._in, strict=True)):
            name = self.function.name_in(k)
            if array.ndim > 2:
                raise ValueError(f"{self.function.name()}: {name} has {array.ndim} axes, takes 1 or 2")
            if array.shape[-1] != size:
                raise ValueError(f"{self.function.name()}: {name} has {array.shape[-1]} values, takes {size}")
            grid.append(per_outer(array, 1) if array.ndim == 2 else constant(array, 1))
        return self._shape(self._sum(grid, rows, 1))

    def sums(self, inputs: Sequence[GridInput], outer: int, inner: int) -> tuple[Matrix, ...]:
        """Sum over the inner index (shots) for each outer one (walkers): outputs (outer, *shape)."""
        return self._shape(self._sum(inputs, outer, inner))

    def _shape(self, flat: Matrix) -> tuple[Matrix, ...]:
        """Split (rows, all outputs) into outputs; CasADi stores matrices column by column."""
        result, start = [], 0
        for (rows, columns), size in zip(self._out_shapes, self._out, strict=True):
            block = flat[:, start : start + size]
            start += size
            if columns == 1:
                result.append(block[:, 0] if rows == 1 else block)
            else:
                result.append(block.reshape(-1, columns, rows).transpose(0, 2, 1))
        return tuple(result)

    def _sum(self, inputs: Sequence[GridInput], outer: int, inner: int) -> Matrix:
        if self._library is not None:
            return self._sum_compiled(inputs, outer, inner)
        count = outer * inner
        if count not in self._maps:
            self._maps[count] = self.function.map(count)
        mapped = self._maps[count]
        buffer, evaluate = mapped.buffer()
        keep = []
        for k, (values, step, offset) in enumerate(inputs):
            if self._in[k] == 0:
                continue
            start = (np.arange(outer)[:, None] * step + offset[None, :]).reshape(-1, 1)
            keep.append(values.reshape(-1)[start + np.arange(self._in[k])])
            buffer.set_arg(k, memoryview(keep[-1].reshape(-1)))  # type: ignore[call-arg]
        outputs = [np.empty((count, size)) for size in self._out]
        for k, output in enumerate(outputs):
            buffer.set_res(k, memoryview(output.reshape(-1)))  # type: ignore[call-arg, arg-type]
        evaluate()
        if buffer.ret():
            raise ArithmeticError(f"CasADi could not evaluate {self.function.name()}")
        flat = np.concatenate(outputs, axis=1)
        return flat if inner == 1 else flat.reshape(outer, inner, -1).sum(axis=1)

    def _sum_compiled(self, inputs: Sequence[GridInput], outer: int, inner: int) -> Matrix:
        assert self._library is not None
        count = len(inputs)
        values = (_POINTER * count)(*(g.values.ctypes.data_as(_POINTER) for g in inputs))
        steps = (ctypes.c_longlong * count)(*(g.step for g in inputs))
        long_pointer = ctypes.POINTER(ctypes.c_longlong)
        offsets = (long_pointer * count)(*(g.offset.ctypes.data_as(long_pointer) for g in inputs))
        result = np.empty((outer, sum(self._out)))
        self._library.zb_sum(values, steps, offsets, outer, inner, result.ctypes.data_as(_POINTER))
        return result


def _source(function: ca.Function) -> str:
    """The function's C code and the loop that sums it over a grid."""
    generator = ca.CodeGenerator("zb.c", {"with_header": False})
    generator.add(function)
    n_in = function.n_in()
    total = sum(function.numel_out(k) for k in range(function.n_out()))
    starts, start = [], 0
    for k in range(function.n_out()):
        starts.append(f"res[{k}] = one + {start};")
        start += function.numel_out(k)
    return (
        generator.dump()
        + f"""
void zb_sum(const double **values, const long long *step, const long long **offset,
            long long outer, long long inner, double *out) {{
  const double *arg[{function.sz_arg() + 1}];
  double *res[{function.sz_res() + 1}];
  double work[{function.sz_w() + 1}], one[{total}];
  long long int iwork[{function.sz_iw() + 1}];
  for (long long o = 0; o < outer; ++o, out += {total}) {{
    for (int r = 0; r < {total}; ++r) out[r] = 0;
    for (long long i = 0; i < inner; ++i) {{
      for (int k = 0; k < {n_in}; ++k) arg[k] = values[k] + o * step[k] + offset[k][i];
      {" ".join(starts)}
      {function.name()}(arg, res, iwork, work, 0);
      for (int r = 0; r < {total}; ++r) out[r] += one[r];
    }}
  }}
}}
"""
    )


@cache
def _compiler() -> tuple[str, str] | None:
    """Path and version text of the C compiler ($CC, cc, gcc, clang), or None."""
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        path = shutil.which(name) if name else None
        if path is not None:
            told = subprocess.run([path, "--version"], capture_output=True, text=True, check=False)
            if told.returncode == 0:
                return path, told.stdout
    return None


def cache_folder() -> Path:
    """Where compiled kernels are kept: $ZEROBEAM_CACHE, or the user's cache folder."""
    stated = os.environ.get("ZEROBEAM_CACHE")
    if stated:
        return Path(stated)
    import platformdirs

    return Path(platformdirs.user_cache_dir("zerobeam"))


def _load(function: ca.Function) -> ctypes.CDLL | None:
    """The compiled function from the cache, compiling it where it is missing or damaged."""
    compiler = _compiler()
    if compiler is None:
        warnings.warn(
            "no C compiler found: CasADi's virtual machine serves, slower", KernelWarning, stacklevel=3
        )
        return None
    path, version = compiler
    source = _source(function)
    key = hashlib.sha256("\0".join([source, *_FLAGS, version]).encode()).hexdigest()
    library = cache_folder() / f"{function.name()}-{key[:32]}.so"
    try:
        if not _whole(library):
            _compile(path, source, library)
        loaded = ctypes.CDLL(str(library))
    except (OSError, subprocess.CalledProcessError) as error:
        warnings.warn(
            f"the kernel could not be compiled ({error}): CasADi's virtual machine serves, slower",
            KernelWarning,
            stacklevel=3,
        )
        return None
    loaded.zb_sum.restype = None
    long_pointer = ctypes.POINTER(ctypes.c_longlong)
    loaded.zb_sum.argtypes = [
        ctypes.POINTER(_POINTER),
        long_pointer,
        ctypes.POINTER(long_pointer),
        ctypes.c_longlong,
        ctypes.c_longlong,
        _POINTER,
    ]
    return loaded


def _whole(library: Path) -> bool:
    """Whether a cached library is there and undamaged: its last bytes are the sha256 of the rest."""
    try:
        data = library.read_bytes()
    except FileNotFoundError:
        return False
    return len(data) > _DIGEST and hashlib.sha256(data[:-_DIGEST]).digest() == data[-_DIGEST:]


def _compile(compiler: str, source: str, library: Path) -> None:
    """Compile aside, then rename: two processes may race, each ends with a whole file."""
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        code, built = Path(folder) / "kernel.c", Path(folder) / "kernel.so"
        code.write_text(source)
        subprocess.run(
            [compiler, *_FLAGS, str(code), "-o", str(built), "-lm"],
            check=True,
            capture_output=True,
            text=True,
        )
        data = built.read_bytes()
        built.write_bytes(data + hashlib.sha256(data).digest())
        os.replace(built, library)
