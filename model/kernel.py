"""A CasADi function made fast: evaluated for many rows, or summed over shots for many walkers, by how many
threads.

CasADi's virtual machine evaluates it at first. Once that has taken as long as compiling, the function's
C code is compiled where a C compiler is at hand, and cached under the hash of its source, the flags and
the compiler; what is cached serves at once. The numbers are the same to rounding, the virtual machine is
about ten times slower.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import signal
import stat
import struct
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, NoReturn

import casadi as ca
import numpy as np
import platformdirs
from threadpoolctl import ThreadpoolController

from .arrays import Index, Matrix
from .c_source import GridInput, NoSource, every, grid_source

LONGEST_S = 300.0  # the largest kernels take a few seconds, on a busy machine a minute and more

_stuck: set[str] = set()  # compilers that did not end: nobody waits for them twice


class KernelWarning(UserWarning):
    """Kernels are not compiled, or not kept: it takes longer, the numbers are the same to rounding."""


def ran(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """What the compiler ended with. After `LONGEST_S` it is killed with its children: TimeoutExpired, and at
    once for the same compiler from then on."""
    if command[0] in _stuck:
        raise subprocess.TimeoutExpired(command[0], LONGEST_S)
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
    ) as process:
        try:
            out, errors = process.communicate(timeout=LONGEST_S)
        except BaseException as error:
            _kill(process)
            if isinstance(error, subprocess.TimeoutExpired):
                _stuck.add(command[0])
                raise subprocess.TimeoutExpired(command[0], LONGEST_S) from None
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, errors)


def _kill(process: subprocess.Popen[str]) -> None:
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()


def private_folder(folder: Path) -> Path:
    """`folder`, made if it is missing, where nobody else may write to it; else one of this process alone."""
    _make_private(folder)
    return folder if private(folder) else _own_folder(folder)


def private(path: Path) -> bool:
    """Whether a file or folder is this user's and nobody else may write to it. What is loaded is obeyed."""
    if os.name != "posix":
        return True  # the folders of a user are their own there
    status = path.stat()
    return status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _make_private(folder: Path) -> None:
    """Make a folder, and those above it, for this user alone, whatever the umask allows others."""
    if not folder.exists():
        _make_private(folder.parent)
        folder.mkdir(mode=0o700, exist_ok=True)


@cache
def _own_folder(instead_of: Path) -> Path:
    warnings.warn(
        f"compiled kernels are not kept: other users may write to {instead_of}, or own it. They are compiled"
        f" anew each time. To do: chmod 700 {instead_of}, or name a folder of your own in ZEROBEAM_CACHE",
        KernelWarning,
        stacklevel=5,
    )
    _kept.append(tempfile.TemporaryDirectory(prefix="zerobeam-kernels-"))
    return Path(_kept[-1].name)


_kept: list[tempfile.TemporaryDirectory[str]] = []  # removed at the end of the process


# No contraction to fused multiply-adds: both paths must give the same numbers. More than -O1 takes half as
# long again to compile, and its code is no faster; loops over the lanes are to be vectors, though.
_FLAGS = (
    "-O1",
    "-ftree-loop-vectorize",
    "-shared",
    "-fPIC",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-Wno-psabi",
)
# The virtual machine takes about 15 ns for an instruction of a row, compiling some 0.8 ms for an instruction:
# that pays after 50,000 rows, or after fewer, since the next process finds it there. To look takes a while.
_LOOK_AFTER, _COMPILE_AFTER = 1_000, 20_000  # rows
# Instructions of a function from which on -O1 takes minutes, as its time grows faster than the code: several
# instruments at one posture have 25,000. Without optimisation it takes seconds; the numbers are the same.
_LARGE, _UNOPTIMISED = 7_000, ("-O0", "-fno-tree-loop-vectorize")
_at_once = False
_MOST_BUFFERS = 8  # numbers of rows for which the virtual machine's inputs and outputs are kept
_DIGEST = 32  # bytes of the sha256 that ends each cached library


@dataclass(frozen=True, eq=False)
class _Buffers:
    """Where the virtual machine finds the inputs (rows, size) of a function and leaves its outputs."""

    inputs: list[Matrix]
    outputs: list[Matrix]
    buffer: ca.FunctionBuffer
    evaluate: Callable[[], None]

    @classmethod
    def of(cls, function: ca.Function, rows: int) -> _Buffers:
        buffer, evaluate = function.map(rows).buffer()
        inputs = [np.zeros((rows, function.numel_in(k))) for k in range(function.n_in())]
        outputs = [np.zeros((rows, function.numel_out(k))) for k in range(function.n_out())]
        for k, array in enumerate(inputs):
            if array.size:
                buffer.set_arg(k, memoryview(array.reshape(-1)))  # type: ignore[call-arg, arg-type]
        for k, array in enumerate(outputs):
            buffer.set_res(k, memoryview(array.reshape(-1)))  # type: ignore[call-arg, arg-type]
        return cls(inputs, outputs, buffer, evaluate)


class Kernel:
    """Fast evaluation of a CasADi function whose inputs are vectors and whose outputs are dense.

    `compiled` says which path serves. `compile` True asks for C at once, False for the virtual machine
    alone; without it C serves where it is cached, and is made when the work pays for it. Where no compiler
    is found or it fails, one KernelWarning says so, and the virtual machine goes on. `hoisted` names inputs
    that do not change over the inner index of `sums`: what depends on them alone is then computed once for
    each outer one.
    With `gram` the last two outputs, a number w and a matrix R, give one in their place: the lower triangle
    of w R'R, row by row. Its many products are then a loop, and not as many lines to compile.
    """

    def __init__(
        self,
        function: ca.Function,
        *,
        compile: bool | None = None,
        hoisted: Collection[str] = (),
        gram: bool = False,
    ) -> None:
        if not all(function.sparsity_out(k).is_dense() for k in range(function.n_out())):
            raise ValueError(f"{function.name()} has an output that is not dense")
        self.function = function
        self._hoisted = [k for k in range(function.n_in()) if function.name_in(k) in hoisted]
        self._in = [function.numel_in(k) for k in range(function.n_in())]
        self._out_shapes = [function.size_out(k) for k in range(function.n_out())]
        self._gram = self._out_shapes[-1] if gram else None
        if self._gram is not None:
            size = self._gram[1]
            self._out_shapes = [*self._out_shapes[:-2], (size * (size + 1) // 2, 1)]
        self._out = [rows * columns for rows, columns in self._out_shapes]
        self._packed = struct.Struct(f"{len(self._in)}q").pack
        self._buffers: dict[int, _Buffers] = {}
        self._alone = threading.Lock()  # the machine has one place for all threads
        packed, whole = ctypes.c_char_p, ctypes.c_longlong
        self._load = partial(
            compiled_library,
            function.name(),
            partial(grid_source, function, hoisted, gram=gram),
            {"zb_sum": [*([packed] * 4), whole, whole, ctypes.c_void_p]},
            flags=_UNOPTIMISED if function.n_instructions() > _LARGE else (),
        )
        self._library = self._load(make=True) if compile else None
        self._rows = 0
        self._ahead = [_LOOK_AFTER, _COMPILE_AFTER] if compile is None else []

    @property
    def compiled(self) -> bool:
        return self._library_for(0) is not None

    @property
    def address(self) -> int:
        """Where the C function is, for other C."""
        if self._library is None:
            raise ValueError(f"{self.function.name()} is not compiled")
        return ctypes.cast(self._library.zb_sum, ctypes.c_void_p).value or 0

    @property
    def size_out(self) -> int:
        """Numbers of all outputs together."""
        return sum(self._out)

    def __call__(self, *inputs: Matrix) -> tuple[Matrix, ...]:
        """Evaluate rows: each input is (rows, size), or (size,) for all rows; outputs are (rows, *shape).

        Raises ValueError for an input of another shape: CasADi itself would map over it silently.
        """
        if len(inputs) != len(self._in):
            raise ValueError(f"{self.function.name()} takes {len(self._in)} inputs, got {len(inputs)}")
        arrays = [np.ascontiguousarray(value, dtype=float) for value in inputs]
        counts = {len(array) for array in arrays if array.ndim == 2}
        sizes = [array.shape[-1] if 0 < array.ndim < 3 else None for array in arrays]
        if len(counts) > 1 or sizes != self._in:
            self._refuse(arrays, counts)
        rows = counts.pop() if counts else 1
        if self._library_for(rows) is None:
            return self._shape(self._interpreted(arrays, rows))
        once = every(0, 1)
        grid = [
            GridInput(a, a.shape[1] if a.ndim == 2 else 0, once, a.ctypes.data, fixed=True) for a in arrays
        ]
        return self._shape(self._compiled(grid, rows, 1))

    def _refuse(self, arrays: Sequence[Matrix], counts: set[int]) -> NoReturn:
        if len(counts) > 1:
            raise ValueError(
                f"{self.function.name()}: inputs with different numbers of rows: {sorted(counts)}"
            )
        for k, (array, size) in enumerate(zip(arrays, self._in, strict=True)):
            if array.ndim > 2 or array.shape[-1] != size:
                complaint = (
                    f"has {array.ndim} axes, takes 1 or 2"
                    if array.ndim > 2
                    else (f"has {array.shape[-1]} values, takes {size}")
                )
                raise ValueError(f"{self.function.name()}: {self.function.name_in(k)} {complaint}")
        raise AssertionError("nothing to refuse")

    def sums(
        self, inputs: Sequence[GridInput], outer: int, inner: int, *, gram: bool = True
    ) -> tuple[Matrix, ...]:
        """Sum over the inner index (shots) for each outer one (walkers): outputs (outer, *shape); without
        `gram` but for w R'R, if there is one.

        Raises ValueError for a hoisted input that changes over the inner index, and for one that ends too
        soon: compiled code would read on behind it.
        """
        for k, grid in enumerate(inputs):
            if grid.rows is not None and len(grid.rows) != outer:
                raise ValueError(f"{self.function.name()}: {outer} rows, and a choice for {len(grid.rows)}")
            row = outer - 1 if grid.rows is None else int(grid.rows.max(initial=0))
            end = row * grid.step + grid.offsets.last + self._in[k]
            if outer * inner * self._in[k] and end > grid.values.size:
                raise ValueError(
                    f"{self.function.name()}: {self.function.name_in(k)} has {grid.values.size} values, too"
                    f" few for {outer} x {inner}"
                )
        for k in self._hoisted:
            if not inputs[k].fixed:
                raise ValueError(
                    f"{self.function.name()}: {self.function.name_in(k)} must not change over measurements"
                )
        if self._library_for(outer * inner) is not None:
            flat = self._compiled(inputs, outer, inner)
            return self._shape(flat if gram or self._gram is None else flat[:, : -self._out[-1]])
        gathered = []
        for grid, size in zip(inputs, self._in, strict=True):
            rows = np.arange(outer) if grid.rows is None else grid.rows
            start = (rows[:, None] * grid.step + grid.offsets.numbers).reshape(-1, 1)
            gathered.append(grid.values.reshape(-1)[start + np.arange(size)])
        each = self._interpreted(gathered, outer * inner, gram=gram)
        return self._shape(each.reshape(outer, inner, each.shape[1]).sum(axis=1))

    def _shape(self, flat: Matrix) -> tuple[Matrix, ...]:
        """Split (rows, all outputs) into outputs; CasADi stores matrices column by column."""
        result, start = [], 0
        for (rows, columns), size in zip(self._out_shapes, self._out, strict=True):
            if start == flat.shape[1]:
                break  # w R'R was not asked for
            block = flat[:, start : start + size]
            start += size
            if columns == 1:
                result.append(block[:, 0] if rows == 1 else block)
            else:
                result.append(block.reshape(-1, columns, rows).transpose(0, 2, 1))
        return tuple(result)

    def _library_for(self, rows: int) -> ctypes.CDLL | None:
        """The compiled function, if it is to serve these rows; found or made when the work pays for it."""
        self._rows += rows
        if self._ahead and self._library is None and (_at_once or self._rows > self._ahead[0]):
            with self._alone:
                while self._ahead and self._library is None and (_at_once or self._rows > self._ahead[0]):
                    self._library = self._load(make=self._ahead.pop(0) == _COMPILE_AFTER)
        return self._library

    def _compiled(self, inputs: Sequence[GridInput], outer: int, inner: int) -> Matrix:
        if outer * inner == 0:
            return np.zeros((outer, sum(self._out)))  # the code would hoist what is not there
        call, result = self.ready(inputs, outer, inner)
        call()
        return result

    def _interpreted(self, inputs: Sequence[Matrix], rows: int, *, gram: bool = True) -> Matrix:
        """(rows, all outputs) by the virtual machine of inputs (rows, size) or (size,)."""
        if rows == 0:
            return np.zeros((0, sum(self._out)))
        with self._alone:
            if rows not in self._buffers:
                if len(self._buffers) == _MOST_BUFFERS:
                    self._buffers.pop(next(iter(self._buffers)))
                self._buffers[rows] = _Buffers.of(self.function, rows)
            buffers = self._buffers[rows]
            for array, values in zip(buffers.inputs, inputs, strict=True):
                array[...] = values
            buffers.evaluate()
            if buffers.buffer.ret():
                raise ArithmeticError(f"CasADi could not evaluate {self.function.name()}")
            outputs = list(buffers.outputs)
            if self._gram is not None:
                *outputs, weight, root = outputs
                if gram:
                    outputs.append(_lower_gram(weight, root.reshape(rows, *self._gram[::-1])))
            return np.concatenate(outputs, axis=1)

    def ready(self, inputs: Sequence[GridInput], outer: int, inner: int) -> tuple[Callable[[], None], Matrix]:
        """The bare call of the C function, and where it leaves all outputs (outer, …), side by side.

        The inputs must be kept as long as the call. Raises ValueError for a kernel that is not compiled.
        """
        if self._library is None:
            raise ValueError(f"{self.function.name()} is not compiled")
        # Bytes are packed in a fraction of the time that arrays of ctypes take.
        values = self._packed(*[grid.address for grid in inputs])
        steps = self._packed(*[grid.step for grid in inputs])
        rows = self._packed(*[0 if grid.rows is None else grid.rows.ctypes.data for grid in inputs])
        offsets = self._packed(*[grid.offsets.address for grid in inputs])
        result = np.empty((outer, sum(self._out)))
        arguments = (values, steps, rows, offsets, outer, inner, result.ctypes.data)
        return partial(self._library.zb_sum, *arguments), result


@contextmanager
def compiled_at_once() -> Iterator[None]:
    """In here kernels are compiled before their first row, where a compiler is at hand.

    Both paths agree up to rounding, and which of them serves depends on what was computed before: answers of
    many parts are the same to the last bit only if each part takes one path throughout.
    """
    global _at_once
    before, _at_once = _at_once, True
    try:
        yield
    finally:
        _at_once = before


@cache
def _compiler() -> tuple[str, tuple[str, ...], str] | None:
    """Path, flags and predefined macros (they contain version and processor) of the C compiler, or None.

    It is $CC, cc, gcc or clang, made to use all of this machine's processor where it knows how.
    """
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        path = shutil.which(name) if name else None
        if path is None:
            continue
        for flags in ((*_FLAGS, "-march=native"), _FLAGS):
            try:
                done = ran([path, *flags, "-dM", "-E", "-x", "c", os.devnull])
            except subprocess.TimeoutExpired:
                return None
            if done.returncode == 0:
                return path, flags, done.stdout
    return None


def cache_folder() -> Path:
    """Where compiled kernels are kept: $ZEROBEAM_CACHE, or the user's cache folder."""
    folder = os.environ.get("ZEROBEAM_CACHE")
    if folder:
        return Path(folder)
    return Path(platformdirs.user_cache_dir("zerobeam"))


def _lower_gram(weight: Matrix, root: Matrix) -> Matrix:
    """(rows, f (f + 1) / 2) of weights (rows, 1) and R' (rows, f, d), the sums in the order of the C code."""
    rows, others = _lower_pairs(root.shape[1])
    total = root[:, rows, 0] * root[:, others, 0]
    for k in range(1, root.shape[2]):
        total += root[:, rows, k] * root[:, others, k]
    return np.asarray(weight * total)


@lru_cache(maxsize=64)
def _lower_pairs(size: int) -> tuple[Index, Index]:
    """Row and column of each entry of a lower triangle, row by row."""
    rows, others = np.tril_indices(size)
    return rows, others


def compiled_library(
    name: str,
    source: Callable[[], str],
    functions: Mapping[str, Sequence[Any]],
    *,
    make: bool,
    flags: Sequence[str] = (),
) -> ctypes.CDLL | None:
    """The library of a C source from the cache; with `make` it is compiled where it is missing or damaged.
    `functions` has the types of the arguments of each: they return nothing. `flags` go to the compiler after
    those of all kernels."""
    compiler = _compiler()
    if compiler is None:
        if make:
            _warn("no C compiler found that works")
        return None
    path, common, macros = compiler
    flags = [*common, *flags]
    try:
        text = source()
        key = hashlib.sha256("\0".join([text, *flags, macros]).encode()).hexdigest()
        folder = private_folder(cache_folder()) if make else cache_folder()
        library = folder / f"{name}-{key[:32]}.so"
        if not (private(folder) and _whole(library)):
            if not make:
                return None
            _compile([path, *flags], text, library)
        loaded = ctypes.CDLL(str(library))
    except (OSError, NoSource, subprocess.SubprocessError) as error:
        if make:
            _warn(f"the kernel could not be compiled ({error})")
        return None
    for function, arguments in functions.items():
        getattr(loaded, function).restype = None
        getattr(loaded, function).argtypes = arguments
    return loaded


def _warn(why: str) -> None:
    warnings.warn(f"{why}: what needs none serves, slower", KernelWarning, stacklevel=4)


def _whole(library: Path) -> bool:
    """Whether a cached library is there, of this user alone, and undamaged: its last bytes are the sha256 of
    the rest."""
    try:
        if not private(library):
            return False
        data = library.read_bytes()
    except FileNotFoundError:
        return False
    return len(data) > _DIGEST and hashlib.sha256(data[:-_DIGEST]).digest() == data[-_DIGEST:]


def _compile(command: list[str], source: str, library: Path) -> None:
    """Compile to another name, then rename: two processes may race, each ends with a whole file."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        code, built = Path(folder) / "kernel.c", Path(folder) / "kernel.so"
        code.write_text(source)
        ran([*command, str(code), "-o", str(built), "-lm"]).check_returncode()
        data = built.read_bytes()
        built.write_bytes(data + hashlib.sha256(data).digest())
        built.chmod(0o600)
        os.replace(built, library)


_WITH_BLAS = frozenset({"scipy.linalg", "scipy.optimize", "scipy.sparse", "scipy.special", "scipy.stats"})

_limit: int | None = None


def threads() -> int:
    """As many as there are cores, but one where processes work side by side."""
    return _limit or os.cpu_count() or 1


@contextmanager
def one_thread() -> Iterator[None]:
    """Within, rows are computed by one thread: the other cores have work of their own."""
    global _limit
    before, _limit = _limit, 1
    try:
        yield
    finally:
        _limit = before


def one_blas_thread() -> AbstractContextManager[object]:
    """Within, linear algebra is done by one thread: for small matrices more cost more than they give, and
    change the last bits. `threadpool_limits` does so too, but looks for the libraries each time (2 ms)."""
    limited: AbstractContextManager[object] = _libraries(_WITH_BLAS.intersection(sys.modules)).limit(
        limits=1, user_api="blas"
    )
    return limited


@cache
def _libraries(loaded: frozenset[str]) -> ThreadpoolController:
    """Those that are there once these modules are loaded."""
    return ThreadpoolController()
