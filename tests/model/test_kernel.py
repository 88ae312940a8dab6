"""tests/model/test_kernel.py."""

import os
import shutil
import stat
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from zerobeam.model import kernel
from zerobeam.model.c_source import Offsets, columns, constant, per_both, per_inner, per_outer
from zerobeam.model.kernel import Kernel, KernelWarning, cache_folder

needs_compiler = pytest.mark.skipif(kernel._compiler() is None, reason="no C compiler on this machine")


def selected(values, index):
    """An input (outer, choices, size), of which shot i takes choice index[i]."""
    outer, choices, size = values.shape
    return columns(values.reshape(outer, choices * size), Offsets.of(index * size))[0]


def small(name="small"):
    """(a (2,), b (3,)) -> total (1,), table (2, 3): small enough to compile in no time."""
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b", 3)
    table = ca.densify(ca.sin(a) @ ca.exp(b).T)
    return ca.Function(name, [a, b], [ca.sum(a) * ca.sumsqr(b), table], ["a", "b"], ["total", "table"])


def expected(a, b):
    return a.sum() * (b * b).sum(), np.outer(np.sin(a), np.exp(b))


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setenv("ZEROBEAM_CACHE", str(folder))
    return folder


@pytest.fixture
def compilers(monkeypatch):
    """Set $CC and $PATH, and have the compiler looked for again; afterwards as before."""

    def look_again(path, cc=None):
        monkeypatch.setenv("PATH", str(path))
        if cc is None:
            monkeypatch.delenv("CC", raising=False)
        else:
            monkeypatch.setenv("CC", str(cc))
        kernel._compiler.cache_clear()

    yield look_again
    monkeypatch.undo()
    kernel._compiler.cache_clear()


def never_compile(*_):
    raise AssertionError("compiled again")


PATHS = [pytest.param(True, id="compiled", marks=needs_compiler), pytest.param(False, id="plain")]


@pytest.mark.parametrize("compile", PATHS)
def test_rows(compile):
    made = Kernel(small(), compile=compile)
    assert made.compiled is compile
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(5, 2)), rng.normal(size=(5, 3))
    total, table = made(a, b)
    assert total.shape == (5,)  # a scalar output has no axis of its own
    assert table.shape == (5, 2, 3)
    for i in range(5):
        one, many = expected(a[i], b[i])
        assert total[i] == pytest.approx(one, rel=1e-14)
        np.testing.assert_allclose(table[i], many, rtol=1e-14)
    # One value for all rows, and one row.
    np.testing.assert_array_equal(made(a[0], b)[1], made(np.tile(a[0], (5, 1)), b)[1])
    np.testing.assert_array_equal(made(a[3], b[3])[1], table[3:4])


@pytest.mark.parametrize("compile", PATHS)
def test_rows_in_any_memory_order_and_type(compile):
    made = Kernel(small(), compile=compile)
    a, b = np.arange(8.0).reshape(4, 2), np.arange(12.0).reshape(4, 3) / 10
    want = made(a, b)[1]
    np.testing.assert_array_equal(made(np.asfortranarray(a), np.repeat(b, 2, axis=0)[::2])[1], want)
    np.testing.assert_array_equal(made(a.astype(int), b)[1], want)


@pytest.mark.parametrize("compile", PATHS)
def test_a_kernel_keeps_its_numbers_when_it_is_called_again(compile):
    made = Kernel(small(), compile=compile)
    first = made(np.ones((2, 2)), np.ones((2, 3)))
    kept = [value.copy() for value in first]
    made(np.zeros((2, 2)), np.zeros((2, 3)))
    for value, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(value, copy)


@pytest.mark.parametrize("compile", PATHS)
def test_sums_over_shots_for_many_walkers(compile):
    """Each kind of input: by walker, by shot, chosen by the shot's target, constant."""
    symbols = [ca.SX.sym(name, size) for name, size in (("w", 2), ("s", 3), ("t", 2), ("c", 1))]
    w, s, t, c = symbols
    value = ca.vertcat(ca.dot(w, t) * s[0] + c, ca.cos(s[1] + w[1]), t[1] * s[2])
    function = ca.Function("grid", symbols, [value, ca.dot(w, w) * c], ["w", "s", "t", "c"], ["v", "o"])
    made = Kernel(function, compile=compile)
    rng = np.random.default_rng(1)
    walkers, shots, index = 4, 6, np.array([0, 2, 2, 1, 0, 2])
    w, s, t = (rng.normal(size=size) for size in ((walkers, 2), (shots, 3), (walkers, 3, 2)))
    c = np.array([0.7])
    inputs = [per_outer(w, shots), per_inner(s, shots), selected(t, index), constant(c, shots)]
    vector, scalar = made.sums(inputs, walkers, shots)
    assert vector.shape == (walkers, 3)
    assert scalar.shape == (walkers,)
    for i in range(walkers):
        chosen = t[i, index]
        want = [
            ((chosen @ w[i]) * s[:, 0] + c).sum(),
            np.cos(s[:, 1] + w[i, 1]).sum(),
            (chosen[:, 1] * s[:, 2]).sum(),
        ]
        np.testing.assert_allclose(vector[i], want, rtol=1e-13, atol=1e-14)
        assert scalar[i] == pytest.approx(shots * 0.7 * (w[i] @ w[i]), rel=1e-13)
    # Negative control: with the shots' targets mixed up it is another sum.
    inputs[2] = selected(t, index[::-1].copy())
    assert np.abs(made.sums(inputs, walkers, shots)[0] - vector).max() > 1e-3


@pytest.mark.parametrize("compile", PATHS)
def test_an_input_of_no_size(compile):
    """A calibrated tool has no unknowns."""
    a, none = ca.SX.sym("a", 2), ca.SX.sym("none", 0)
    made = Kernel(ca.Function("lacking", [a, none], [2 * a], ["a", "none"], ["v"]), compile=compile)
    a = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(made(a, np.zeros(0))[0], 2 * a)
    np.testing.assert_array_equal(made(a, np.zeros((3, 0)))[0], 2 * a)
    grid = [per_outer(a, 4), per_outer(np.zeros((3, 0)), 4)]
    np.testing.assert_array_equal(made.sums(grid, 3, 4)[0], 8 * a)


@pytest.mark.parametrize("compile", PATHS)
def test_what_is_not_finite_stays_so(compile):
    total, _ = Kernel(small(), compile=compile)(np.array([np.nan, 1]), np.ones(3))
    assert np.isnan(total[0])


def bent():
    """(w (2,), s (3,), v (1,)) -> (): of w and v alone it takes the sine and the root."""
    w, s, v = ca.SX.sym("w", 2), ca.SX.sym("s", 3), ca.SX.sym("v", 1)
    value = ca.vertcat(ca.sin(w[0]) * s[0] + ca.sqrt(v) * s[1], ca.exp(w[1] * v) + s[2], ca.cos(v))
    return ca.Function("bent", [w, s, v], [value], ["w", "s", "v"], ["value"])


def bent_inputs(walkers, shots):
    rng = np.random.default_rng(4)
    w, s, v = rng.normal(size=(walkers, 2)), rng.normal(size=(shots, 3)), np.array([0.7])
    return [per_outer(w, shots), per_inner(s, shots), constant(v, shots)]


@pytest.mark.parametrize("compile", PATHS)
@pytest.mark.parametrize("walkers", [1, 2, 3, 5, 9])
def test_hoisting_changes_no_number(compile, walkers):
    inputs = bent_inputs(walkers, 4)
    (hoisted,) = Kernel(bent(), compile=compile, hoisted=("w", "v")).sums(inputs, walkers, 4)
    (plain,) = Kernel(bent(), compile=compile).sums(inputs, walkers, 4)
    np.testing.assert_array_equal(hoisted, plain)
    w, s, v = (actual.values for actual in inputs)
    for i in range(walkers):
        first = (np.sin(w[i, 0]) * s[:, 0] + np.sqrt(v) * s[:, 1]).sum()
        np.testing.assert_allclose(
            hoisted[i], [first, (np.exp(w[i, 1] * v) + s[:, 2]).sum(), 4 * np.cos(v[0])], rtol=1e-13
        )


@pytest.mark.parametrize("compile", PATHS)
def test_a_hoisted_input_that_changes_is_refused(compile):
    """Compiled code would take that of the first shot for all."""
    made = Kernel(bent(), compile=compile, hoisted=("w", "v"))
    inputs = bent_inputs(3, 4)
    made.sums(inputs, 3, 4)
    rng = np.random.default_rng(5)
    for changing in (
        per_both(rng.normal(size=(3, 4, 2))),
        per_inner(rng.normal(size=(4, 2)), 4),
        selected(rng.normal(size=(3, 2, 2)), np.array([0, 1, 1, 0])),
    ):
        with pytest.raises(ValueError, match="bent: w must not change over measurements"):
            made.sums([changing, *inputs[1:]], 3, 4)
        assert Kernel(bent(), compile=compile).sums([changing, *inputs[1:]], 3, 4)[0].shape == (3, 3)
    # Rows are walkers of one shot each: there all may change.
    assert made(np.ones((3, 2)), np.ones(3), np.ones((3, 1)))[0].shape == (3, 3)


@pytest.mark.parametrize("compile", PATHS)
def test_an_input_that_changes_with_walker_and_shot(compile):
    function = small()
    made = Kernel(function, compile=compile)
    rng = np.random.default_rng(6)
    a, b = rng.normal(size=(5, 4, 2)), rng.normal(size=(5, 4, 3))
    total, table = made.sums([per_both(a), per_both(b)], 5, 4)
    for i in range(5):
        each = [expected(*row) for row in zip(a[i], b[i], strict=True)]
        assert total[i] == pytest.approx(sum(one for one, _ in each), rel=1e-13)
        np.testing.assert_allclose(table[i], sum(many for _, many in each), rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("compile", PATHS)
def test_an_input_that_ends_too_soon_is_refused(compile):
    """Compiled code would read on behind it."""
    made = Kernel(small(), compile=compile)
    b = per_inner(np.ones((4, 3)), 4)
    for a in (
        per_outer(np.ones((2, 2)), 4),
        per_both(np.ones((2, 4, 2))),
        selected(np.ones((3, 2, 2)), np.array([0, 1, 2, 0])),
        constant(np.ones(1), 4),
    ):
        with pytest.raises(ValueError, match="small: a has"):
            made.sums([a, b], 3, 4)
    assert made.sums([per_outer(np.ones((3, 2)), 4), b], 3, 4)[0].shape == (3,)


@pytest.mark.parametrize("compile", PATHS)
def test_no_walkers_and_no_shots(compile):
    """A sum over nothing is zero, also of what was to be computed once for all shots."""
    made = Kernel(bent(), compile=compile, hoisted=("w", "v"))
    (none,) = made.sums(bent_inputs(3, 0), 3, 0)
    np.testing.assert_array_equal(none, np.zeros((3, 3)))
    (nobody,) = made.sums(bent_inputs(0, 4), 0, 4)
    assert nobody.shape == (0, 3)


@pytest.mark.parametrize("compile", PATHS)
@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (((2,),), "takes 2 inputs, got 1"),
        (((2,), (3,), (1,)), "takes 2 inputs, got 3"),
        (((3,), (3,)), "a has 3 values, takes 2"),
        (((2,), (6,)), "b has 6 values, takes 3"),  # CasADi would map over two columns
        (((4, 2), (4, 1)), "b has 1 values, takes 3"),  # and repeat a scalar
        (((2, 4), (4, 3)), "different numbers of rows"),
        (((2, 2), (3, 3)), "different numbers of rows"),
        (((3, 2), (3, 0)), "b has 0 values, takes 3"),
        (((4, 1, 2), (4, 3)), "a has 3 axes"),
        (((), (3,)), "a has 1 values, takes 2"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(compile, shapes, message):
    made = Kernel(small(), compile=compile)
    with pytest.raises(ValueError, match=message) as caught:
        made(*(np.ones(shape) for shape in shapes))
    assert "small" in str(caught.value)


@pytest.mark.parametrize("compile", PATHS)
def test_an_output_that_is_not_dense_is_refused(compile):
    """CasADi would write its nonzeros one after the other."""
    a = ca.SX.sym("a", 2)
    with pytest.raises(ValueError, match="diagonal has an output that is not dense"):
        Kernel(ca.Function("diagonal", [a], [ca.diag(a)]), compile=compile)


def libraries(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("ZEROBEAM_CACHE", str(tmp_path / "mine"))
    assert cache_folder() == tmp_path / "mine"
    for unset in (
        lambda: monkeypatch.setenv("ZEROBEAM_CACHE", ""),
        lambda: monkeypatch.delenv("ZEROBEAM_CACHE"),
    ):
        unset()
        assert cache_folder().name == "zerobeam"
        assert cache_folder() != Path("zerobeam")
        assert cache_folder().is_absolute()


@needs_compiler
def test_a_kernel_is_compiled_once(empty_cache, monkeypatch):
    assert Kernel(small(), compile=True).compiled
    (name,) = libraries(empty_cache)  # the library alone: nothing of the compilation is left
    assert name.startswith("small-")
    monkeypatch.setattr(kernel, "_compile", never_compile)
    again = Kernel(small(), compile=True)
    assert again.compiled
    assert again(np.ones(2), np.ones(3))[0] == 6
    # Negative control: another function is compiled.
    with pytest.raises(AssertionError, match="compiled again"):
        Kernel(small("other"), compile=True)


@needs_compiler
@pytest.mark.parametrize("what", ["source", "flags", "compiler", "hoisting"])
@pytest.mark.one_in(2)
def test_what_the_numbers_depend_on_is_in_the_name(empty_cache, monkeypatch, what):
    Kernel(small(), compile=True)
    function = small()
    if what == "source":
        a, b = ca.SX.sym("a", 2), ca.SX.sym("b", 3)
        function = ca.Function("small", [a, b], [ca.sum(a) * ca.sumsqr(b) + 1, a])
    elif what == "hoisting":
        Kernel(function, compile=True, hoisted=("a",))
        assert len(libraries(empty_cache)) == 2
        return
    elif what == "flags":
        path, flags, macros = kernel._compiler()
        monkeypatch.setattr(kernel, "_compiler", lambda: (path, (*flags, "-g0"), macros))
    else:
        path, flags, macros = kernel._compiler()
        monkeypatch.setattr(kernel, "_compiler", lambda: (path, flags, macros + "#define NEWER 1\n"))
    Kernel(function, compile=True)
    assert len(libraries(empty_cache)) == 2


@needs_compiler
@pytest.mark.parametrize("damage", ["empty", "truncated", "one byte", "text", "lengthened"])
@pytest.mark.one_in(3)
def test_a_damaged_library_is_noticed_and_built_again(empty_cache, tmp_path, monkeypatch, damage):
    """The damaged file lies in a folder of its own: the loader would serve a path that it knows from memory,
    and a library that is in use must not be written into."""
    Kernel(small(), compile=True)
    (name,) = libraries(empty_cache)
    data = (empty_cache / name).read_bytes()
    broken = {
        "empty": b"",
        "truncated": data[: len(data) // 2],
        "one byte": data[:1000] + bytes([data[1000] ^ 1]) + data[1001:],
        "text": b"not a library\n" * 100,
        "lengthened": data + b"\0",
    }[damage]
    other = tmp_path / "other"
    other.mkdir()
    (other / name).write_bytes(broken)
    monkeypatch.setenv("ZEROBEAM_CACHE", str(other))
    built = []
    really = kernel._compile
    monkeypatch.setattr(kernel, "_compile", lambda *arguments: built.append(1) or really(*arguments))
    made = Kernel(small(), compile=True)
    assert made.compiled
    assert built == [1]
    assert made(np.ones(2), np.ones(3))[0] == 6
    assert libraries(other) == [name]
    assert kernel._whole(other / name)
    # Negative control: a whole one in a third folder is taken as it is.
    third = tmp_path / "third"
    shutil.copytree(empty_cache, third)
    monkeypatch.setenv("ZEROBEAM_CACHE", str(third))
    assert Kernel(small(), compile=True).compiled
    assert built == [1]


RACE = """
import sys, time
import numpy as np
sys.path.insert(0, sys.argv[1])
from test_kernel import small
from zerobeam.model import kernel
really = kernel._compile
def compile(*arguments):
    print("compiling", flush=True)
    sys.stdin.readline()  # until both have found the cache empty
    really(*arguments)
kernel._compile = compile
made = kernel.Kernel(small(), compile=True)
print(made.compiled, made(np.ones(2), np.ones(3))[0][0], flush=True)
"""


@needs_compiler
@pytest.mark.long
def test_two_processes_may_race_and_give_the_same_name(empty_cache):
    """Both compile at once into the same empty cache; the name does not depend on the process."""
    racers = [
        subprocess.Popen(
            [sys.executable, "-W", "error", "-c", RACE, str(Path(__file__).parent)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        )
        for seed in ("1", "2")
    ]
    for racer in racers:
        assert racer.stdout.readline() == "compiling\n"
    for racer in racers:
        racer.stdin.write("go\n")
        racer.stdin.flush()
    for racer in racers:
        out, err = racer.communicate(timeout=60)
        assert (out, racer.returncode) == ("True 6.0\n", 0), err
    (name,) = libraries(empty_cache)
    assert kernel._whole(empty_cache / name)
    Kernel(small(), compile=True)
    assert libraries(empty_cache) == [name]  # this process finds what the others built


def warned(function):
    """The kernel, and what was warned about."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        made = Kernel(function, compile=True)
    return made, [(each.category, str(each.message), each.filename) for each in caught]


def test_without_a_compiler_it_says_so_once_and_goes_on(empty_cache, tmp_path, compilers):
    compilers(tmp_path)
    made, message = warned(small())
    ((category, text, filename),) = message
    assert category is KernelWarning
    assert "no C compiler" in text
    assert "slower" in text
    assert filename == __file__  # where the kernel was asked for
    assert not made.compiled
    assert made(np.ones(2), np.ones(3))[0] == 6
    assert not empty_cache.exists()
    # Who does not ask for compiled code is not told.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not Kernel(small()).compiled


def script(path, text):
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.mark.skipif(os.name != "posix", reason="the false compilers are shell scripts")
@pytest.mark.parametrize(
    "acts",
    ["echo broken >&2; exit 1", "exit 0", 'for a; do [ "$last" = -o ] && echo rubbish > "$a"; last=$a; done'],
    ids=["fails", "writes nothing", "writes rubbish"],
)
def test_a_compiler_that_fails_is_told_and_leaves_nothing_running_wrong(
    empty_cache, tmp_path, compilers, acts
):
    cc = script(tmp_path / "cc", f'case "$*" in *-dM*) echo "#define ONE 1"; exit 0;; esac\n{acts}\n')
    compilers(tmp_path, cc)
    made, message = warned(small())
    ((category, text, _),) = message
    assert category is KernelWarning
    assert "could not be compiled" in text
    assert not made.compiled
    assert made(np.ones(2), np.ones(3))[0] == 6


@needs_compiler
def test_a_cache_that_cannot_be_written_is_told(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ZEROBEAM_CACHE", str(tmp_path / "file" / "cache"))
    made, message = warned(small())
    assert [category for category, _, _ in message] == [KernelWarning]
    assert not made.compiled


@needs_compiler
def test_what_has_no_c_is_told_and_computed_all_the_same(empty_cache):
    a = ca.SX.sym("a", 2)
    made, message = warned(ca.Function("bow", [a], [ca.atan(a)], ["a"], ["v"]))
    ((category, text, _),) = message
    assert category is KernelWarning
    assert "bow has the operation" in text
    assert not made.compiled
    np.testing.assert_allclose(
        made(np.array([[1.0, -1], [0, 5]]))[0], np.arctan([[1.0, -1], [0, 5]]), rtol=1e-15
    )
    assert not empty_cache.exists()


@needs_compiler
def test_the_compiler_that_cc_names_is_taken_first(compilers):
    path, flags, macros = kernel._compiler()
    compilers(Path(path).parent, path)
    assert kernel._compiler() == (path, flags, macros)
    compilers(Path(path).parent, "/nowhere/cc")
    assert kernel._compiler() is not None


@needs_compiler
@pytest.mark.skipif(os.name != "posix", reason="the false compiler is a shell script")
def test_a_compiler_that_does_not_know_the_processor_goes_without(empty_cache, tmp_path, compilers):
    path, _, _ = kernel._compiler()
    tools = os.environ["PATH"]  # the compiler's own helpers
    cc = script(tmp_path / "cc", f'case "$*" in *-march*) exit 1;; esac\nexec {path} "$@"\n')
    compilers(tools, cc)
    result, flags, macros = kernel._compiler()
    assert result == str(cc)
    assert not any("march" in flag for flag in flags)
    assert "__VERSION__" in macros
    made, message = warned(small())
    assert (made.compiled, message) == (True, [])
    assert made(np.ones(2), np.ones(3))[0] == 6


@pytest.mark.skipif(os.name != "posix", reason="the false compilers are shell scripts")
@pytest.mark.parametrize("at_once", [True, False], ids=["at the first question", "at a kernel"])
def test_a_compiler_that_hangs_is_ended_with_its_children(
    empty_cache, tmp_path, compilers, monkeypatch, at_once
):
    os.mkfifo(tmp_path / "pipe")
    alive = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    answers = "" if at_once else 'case "$*" in *-dM*) echo "#define ONE 1"; exit 0;; esac\n'
    cc = script(tmp_path / "cc", f"{answers}(echo begun; exec sleep 1000) > {tmp_path / 'pipe'} &\nwait\n")
    compilers(os.environ["PATH"], cc)
    monkeypatch.setattr(kernel, "LONGEST_S", 1.0)
    made, message = warned(small())
    ((category, text, filename),) = message
    assert category is KernelWarning
    assert filename == __file__
    assert ("no C compiler" in text) if at_once else ("timed out after 1.0 seconds" in text)
    assert made(np.ones(2), np.ones(3))[0] == 6
    with open(alive, "rb") as pipe:
        assert pipe.read(6) == b"begun\n"
        os.set_blocking(alive, True)
        assert pipe.read() == b""  # the end comes when nobody is left who could write
    monkeypatch.setattr(subprocess, "Popen", never_compile)
    assert not warned(small("other"))[0].compiled


posix = pytest.mark.skipif(os.name != "posix", reason="owners and modes are POSIX's")


@needs_compiler
@posix
def test_the_cache_is_the_users_own_whatever_the_umask(tmp_path, monkeypatch):
    folder = tmp_path / "above" / "cache"
    monkeypatch.setenv("ZEROBEAM_CACHE", str(folder))
    before = os.umask(0)
    try:
        Kernel(small(), compile=True)
    finally:
        os.umask(before)
    (library,) = folder.iterdir()
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (folder.parent, folder, library)]
    assert modes == [0o700, 0o700, 0o600]


@needs_compiler
@posix
@pytest.mark.parametrize("how", ["writable", "another's"])
def test_a_cache_that_others_can_write_is_not_used(empty_cache, monkeypatch, how):
    Kernel(small(), compile=True)
    (name,) = libraries(empty_cache)
    (empty_cache / name).unlink()  # written into, the one in use would end this process by a bus error
    (empty_cache / name).write_bytes(b"planted")
    if how == "writable":
        empty_cache.chmod(0o777)
    else:
        another = os.getuid() + 1
        monkeypatch.setattr(os, "getuid", lambda: another)
        monkeypatch.setattr(kernel, "_make_private", lambda folder: None)
    with warnings.catch_warnings(record=True) as message:
        warnings.simplefilter("always")
        both = [Kernel(small(), compile=True), Kernel(small("other"), compile=True)]
    assert libraries(empty_cache) == [name]
    assert (empty_cache / name).read_bytes() == b"planted"
    ((category, text, filename),) = [(each.category, str(each.message), each.filename) for each in message]
    assert (category, filename) == (KernelWarning, __file__)
    assert f"chmod 700 {empty_cache}" in text
    if how == "writable":
        assert [made.compiled for made in both] == [True, True]
        assert stat.S_IMODE(kernel._own_folder(empty_cache).stat().st_mode) == 0o700


@needs_compiler
@posix
def test_a_library_that_others_can_write_is_built_again(empty_cache):
    Kernel(small(), compile=True)
    (library,) = empty_cache.iterdir()
    library.chmod(0o666)
    assert not kernel._whole(library)
    assert Kernel(small(), compile=True).compiled
    assert kernel._whole(library)


def test_threads_share_the_virtual_machine():
    """Each thread gets the numbers of its own inputs."""
    made = Kernel(bent(), compile=False)
    rng = np.random.default_rng(8)
    sizes = [made.function.numel_in(k) for k in range(made.function.n_in())]
    actual = [[rng.normal(size=(2000, size)) for size in sizes] for _ in range(4)]
    expected = [made(*inputs) for inputs in actual]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(20):
            for result, alone in zip(pool.map(lambda inputs: made(*inputs), actual), expected, strict=True):
                for one, two in zip(result, alone, strict=True):
                    np.testing.assert_array_equal(one, two)


SCRIPT = """
import sys
import scipy.special
before = "scipy.linalg" in sys.modules  # of older versions
from threadpoolctl import threadpool_info, threadpool_limits
from zerobeam.model.kernel import one_blas_thread

def counts():
    return {own["filepath"]: own["num_threads"] for own in threadpool_info() if own["user_api"] == "blas"}

assert ("scipy.linalg" in sys.modules) == before
with threadpool_limits(limits=3, user_api="blas"):
    with one_blas_thread():
        assert set(counts().values()) == {1}
    import scipy.linalg
    threadpool_limits(limits=3, user_api="blas")
    assert set(counts().values()) == {3}
    with one_blas_thread():
        assert set(counts().values()) == {1}
    assert set(counts().values()) == {3}
"""


@pytest.mark.long
def test_one_thread_within_in_every_library_that_is_loaded() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
