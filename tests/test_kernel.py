import os
import shutil
import stat
import subprocess
import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from zerobeam.model import kernel
from zerobeam.model.constraint import shot_functions
from zerobeam.model.kernel import (
    Kernel,
    KernelWarning,
    cache_folder,
    constant,
    per_inner,
    per_outer,
    selected,
)
from zerobeam.model.robot_file import load_robot
from zerobeam.model.tool import Tool

needs_compiler = pytest.mark.skipif(kernel._compiler() is None, reason="no C compiler on this machine")


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


# --- numbers ----------------------------------------------------------------------------------------

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
    w, s, t, c = (
        rng.normal(size=(walkers, 2)),
        rng.normal(size=(shots, 3)),
        rng.normal(size=(walkers, 3, 2)),
        np.array([0.7]),
    )
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


@needs_compiler
def test_the_compiled_terms_of_a_shot_are_the_plain_ones(tmp_path):
    """To 1e-12 of each value; measured with gcc on x86-64: not one bit of difference, alone and summed."""
    tool = Tool("laser", False, np.array([0, 0, 65.0]), np.array([1.0, 0, 0]), np.radians(3), 10.0)
    functions = shot_functions(load_robot("irb1600", tmp_path), tool)
    rng = np.random.default_rng(2)
    shots, walkers = 7, 40
    q, spot = rng.uniform(-1.5, 1.5, (shots, 6)), rng.normal(size=(shots, 2))
    delta, target = rng.normal(scale=0.05, size=(walkers, 6)), rng.uniform(-1500, 1500, (walkers, 1, 3))
    unknown, variances = rng.normal(scale=0.05, size=(walkers, 4)), np.append(np.full(6, 3e-8), 2.5e-3)
    grid = [
        per_inner(q, shots),
        per_inner(spot, shots),
        per_outer(delta, shots),
        selected(target, np.zeros(shots, dtype=np.int64)),
        per_outer(unknown, shots),
        constant(variances, shots),
    ]
    one = [q[0], spot[0], delta, target[:, 0], unknown, variances]
    compiled, plain = Kernel(functions.terms, compile=True), Kernel(functions.terms)
    assert compiled.compiled
    assert not plain.compiled
    for first, second in zip(compiled(*one), plain(*one), strict=True):
        np.testing.assert_allclose(first, second, rtol=1e-12)
    for first, second in zip(
        compiled.sums(grid, walkers, shots), plain.sums(grid, walkers, shots), strict=True
    ):
        assert np.ptp(first) > 1  # there is something to compare
        np.testing.assert_allclose(first, second, rtol=1e-12)


# --- shapes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("compile", PATHS)
@pytest.mark.parametrize(
    ("shapes", "told"),
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
def test_shapes_that_do_not_fit_are_refused(compile, shapes, told):
    made = Kernel(small(), compile=compile)
    with pytest.raises(ValueError, match=told) as caught:
        made(*(np.ones(shape) for shape in shapes))
    assert "small" in str(caught.value)


def test_casadi_itself_would_map_silently():
    """Why the shapes are looked at: six values for three are two calls to CasADi, and no error."""
    assert small()(np.ones(2), np.ones((3, 2)))[0].shape == (1, 2)


# --- the cache --------------------------------------------------------------------------------------


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


def test_the_tests_do_not_write_into_the_users_cache(kernel_cache):
    assert cache_folder() == kernel_cache


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
@pytest.mark.parametrize("what", ["source", "flags", "compiler"])
def test_what_the_numbers_depend_on_is_in_the_name(empty_cache, monkeypatch, what):
    Kernel(small(), compile=True)
    function = small()
    if what == "source":
        a, b = ca.SX.sym("a", 2), ca.SX.sym("b", 3)
        function = ca.Function("small", [a, b], [ca.sum(a) * ca.sumsqr(b) + 1, a])
    elif what == "flags":
        monkeypatch.setattr(kernel, "_FLAGS", (*kernel._FLAGS, "-g0"))
    else:
        path, version = kernel._compiler()
        monkeypatch.setattr(kernel, "_compiler", lambda: (path, version + "."))
    Kernel(function, compile=True)
    assert len(libraries(empty_cache)) == 2


@needs_compiler
@pytest.mark.parametrize("damage", ["empty", "truncated", "one byte", "text", "lengthened"])
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


# --- without a compiler -----------------------------------------------------------------------------


def warned(function):
    """The kernel, and what was warned about."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        made = Kernel(function, compile=True)
    return made, [(each.category, str(each.message), each.filename) for each in caught]


def test_without_a_compiler_it_says_so_once_and_goes_on(empty_cache, tmp_path, compilers):
    compilers(tmp_path)
    made, told = warned(small())
    ((category, text, filename),) = told
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
    cc = script(tmp_path / "cc", f'[ "$1" = --version ] && echo 1.0 && exit 0\n{acts}\n')
    compilers(tmp_path, cc)
    made, told = warned(small())
    ((category, text, _),) = told
    assert category is KernelWarning
    assert "could not be compiled" in text
    assert not made.compiled
    assert made(np.ones(2), np.ones(3))[0] == 6


@needs_compiler
def test_a_cache_that_cannot_be_written_is_told(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ZEROBEAM_CACHE", str(tmp_path / "file" / "cache"))
    made, told = warned(small())
    assert [category for category, _, _ in told] == [KernelWarning]
    assert not made.compiled


@needs_compiler
def test_the_compiler_that_cc_names_is_taken_first(compilers):
    path, version = kernel._compiler()
    compilers(Path(path).parent, path)
    assert kernel._compiler() == (path, version)
    compilers(Path(path).parent, "/nowhere/cc")
    assert kernel._compiler() is not None
