import casadi as ca
import numpy as np
import pytest
from plain_model import DESIGNED, arm

from zerobeam.model import c_source, kernel
from zerobeam.model.c_source import (
    NoSource,
    Offsets,
    columns,
    constant,
    grid_source,
    per_both,
    per_inner,
    per_outer,
)
from zerobeam.model.instruments.registry import kind_of
from zerobeam.model.kernel import Kernel
from zerobeam.model.likelihood.constraint import ShotFunctions

needs_compiler = pytest.mark.skipif(kernel._compiler() is None, reason="no C compiler on this machine")

# Fewer and more than the lanes of any machine (2, 4 or 8), and no multiples of them.
ROWS = (1, 2, 3, 5, 9)
INSIDE = "for (long long i = 0; i < inner; ++i)"


def both_ways(function, **options):
    """The kernel of compiled code and that of CasADi's virtual machine."""
    made = Kernel(function, compile=True, **options), Kernel(function, compile=False, **options)
    assert [each.compiled for each in made] == [True, False]
    return made


TWO = {
    "ADD": np.add,
    "SUB": np.subtract,
    "MUL": np.multiply,
    "DIV": np.divide,
    "LT": np.less,
    "LE": np.less_equal,
    "IF_ELSE_ZERO": lambda a, b: np.where(a != 0, b, 0.0),
    "FMIN": np.fmin,
    "FMAX": np.fmax,
    "ATAN2": np.arctan2,
}
ONE = {
    "NEG": np.negative,
    "SQ": np.square,
    "TWICE": lambda a: 2 * a,
    "INV": lambda a: 1 / a,
    "SQRT": np.sqrt,
    "SIN": np.sin,
    "COS": np.cos,
    "TAN": np.tan,
    "EXP": np.exp,
    "LOG": np.log,
    "FABS": np.abs,
    "NOT": np.logical_not,
}
ROUNDED_ONCE = {
    *TWO.keys() - {"ATAN2"},
    "FABS",
    "NOT",
    "NEG",
    "SQ",
    "TWICE",
    "INV",
    "SQRT",
}  # by IEEE 754 the same on every machine


def test_every_operation_is_tried_below():
    content = {getattr(ca, f"OP_{name}") for name in (*TWO, *ONE)}
    assert content == {*c_source._BINARY, *c_source._UNARY, *c_source._TURNED} - {ca.OP_ASSIGN}


@needs_compiler
@pytest.mark.parametrize("name", [*TWO, *ONE])
@pytest.mark.one_in(2)
def test_an_operation_against_numpy_and_the_virtual_machine(name):
    if name == "TWICE" and ca.__version__ < "3.8":
        pytest.skip("CasADi 3.7 writes it as a product")
    a, b = ca.SX.sym("a", 1), ca.SX.sym("b", 1)
    code = getattr(ca, f"OP_{name}")
    value = ca.SX.binary(code, a, b) if name in TWO else ca.SX.unary(code, a)
    function = ca.Function(f"op_{name.lower()}", [a, b], [value], ["a", "b"], ["v"])
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    assert code in operations  # not simplified away
    compiled, plain = both_ways(function)
    rng = np.random.default_rng(1)
    a, b = np.exp(rng.normal(scale=1.5, size=(2, 1001, 1)))
    sign = np.ones_like(a) if name in ("SQRT", "LOG") else np.sign(rng.normal(size=a.shape))
    (one,), (two,) = compiled(sign * a, b), plain(sign * a, b)
    expected = TWO[name](sign * a, b) if name in TWO else ONE[name](sign * a)
    np.testing.assert_allclose(one, expected[:, 0], rtol=1e-14 if name != "EXP" else 1e-13)
    np.testing.assert_allclose(one, two, rtol=1e-15)
    if name in ROUNDED_ONCE:
        np.testing.assert_array_equal(one, expected[:, 0])
        np.testing.assert_array_equal(one, two)


@needs_compiler
def test_sums_and_products_are_not_contracted():
    """A fused multiply-add would round once where CasADi's machine rounds twice."""
    symbols = [ca.SX.sym(name, 1) for name in "abc"]
    a, b, c = symbols
    compiled, plain = both_ways(ca.Function("fused", symbols, [a * b + c], list("abc"), ["v"]))
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 1000, 1))
    c = -(a * b)  # what is left of the product's last digits, by a fused operation
    np.testing.assert_array_equal(compiled(a, b, c)[0], 0)
    np.testing.assert_array_equal(plain(a, b, c)[0], 0)


@needs_compiler
def test_constants_to_the_last_digit():
    a = ca.SX.sym("a", 1)
    values = [0.1, np.pi, -1e-300, 5e-324, 1.7976931348623157e308, 1 / 3, 0.0]
    function = ca.Function("constants", [a], [a + 0, ca.vertcat(*map(ca.SX, values))], ["a"], ["v", "c"])
    for made in both_ways(function):
        np.testing.assert_array_equal(made(np.zeros((3, 1)))[1], np.tile(values, (3, 1)))


@needs_compiler
def test_outputs_that_are_inputs_or_stand_twice():
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b", 1)
    product = a * b
    outputs = [product, ca.horzcat(product, a, product), b]
    for made in both_ways(ca.Function("twice", [a, b], outputs, ["a", "b"], ["v", "m", "w"])):
        a, b = np.arange(10.0).reshape(5, 2), np.arange(5.0)[:, None] + 1
        v, m, w = made(a, b)
        np.testing.assert_array_equal(v, a * b)
        np.testing.assert_array_equal(m, np.stack([a * b, a, a * b], axis=-1))
        np.testing.assert_array_equal(w, b[:, 0])


@pytest.mark.parametrize(
    "value",
    [
        lambda a: ca.atan(a),
        lambda a: a**1.5,
    ],
    ids=["atan", "power"],
)
def test_what_is_not_known_is_refused(value):
    a = ca.SX.sym("a", 1)
    function = ca.Function("strange", [a], [value(a)], ["a"], ["v"])
    with pytest.raises(NoSource, match="strange has the operation"):
        grid_source(function, ())


def hoistable():
    a, b = ca.SX.sym("a", 1), ca.SX.sym("b", 1)
    return ca.Function("hoist", [a, b], [ca.sqrt(a) * b + ca.exp(b)], ["a", "b"], ["v"])


def test_sine_and_cosine_of_an_angle_are_one_call_each_in_its_place():
    a, b = ca.SX.sym("a", 1), ca.SX.sym("b", 1)
    both = ca.Function("both", [a, b], [ca.sin(a) * ca.cos(a) + ca.cos(b)], ["a", "b"], ["v"])
    before, inside = grid_source(both, ("a",)).split(INSIDE)
    assert [text.count("zb_sincos(v") for text in (before, inside)] == [1, 1]


def test_what_depends_on_hoisted_inputs_alone_stands_before_the_loop():
    def parts(*hoisted):
        return [text.count("zb_sqrt(v") + 10 * text.count("zb_exp(v") for text in split(*hoisted)]

    def split(*hoisted):
        before, inside = grid_source(hoistable(), hoisted).split(INSIDE)
        return before[before.index("void zb_sum") :], inside

    assert parts() == [0, 11]
    assert parts("a") == [1, 10]
    assert parts("b") == [10, 1]
    assert parts("a", "b") == [11, 0]
    assert "+ 0) *" not in split("a")[1]


def test_the_same_function_gives_the_same_source():
    """The name of the cached library is made of it."""
    assert grid_source(hoistable(), ("a",)) == grid_source(hoistable(), ("a",))
    assert grid_source(hoistable(), ("a", "b")) == grid_source(hoistable(), ("b", "a"))
    assert grid_source(hoistable(), ("a",)) != grid_source(hoistable(), ())


def shot_functions(name, folder, log_det="none"):
    laser = name != "gantry"
    tool = kind_of("laser" if laser else "probe")(
        "tool",
        False,
        np.array([12.0, -7.0, 65.0]),
        np.array([0.6, 0.0, 0.8]) if laser else None,
        np.radians(3),
        10.0,
    )
    return ShotFunctions(arm(name, folder).robot, tool, log_det)


def draws(functions, rng, *shape):
    """Joints, spots, offsets, targets, tools anywhere: (*shape, size) each."""
    robot, tool = functions.robot, functions.tool
    unit = robot.display
    return (
        rng.uniform(-80, 80, (*shape, robot.n)) / unit,
        rng.normal(size=(*shape, tool.residual_size)),
        rng.normal(scale=3, size=(*shape, robot.n)) / unit,
        rng.uniform(-1500, 1500, (*shape, 3)),
        rng.normal(scale=0.05, size=(*shape, len(tool.unknowns))),
    )


SHOTS, INDEX = 7, np.array([0, 1, 1, 0, 1, 0, 0])  # two targets


def weighted_inputs(functions, rows):
    """The inputs of `terms` and `slopes` for all rows, or for some of them: a function of the choice."""
    rng, n = np.random.default_rng(rows), functions.robot.n
    joints, spots, _, _, _ = draws(functions, rng, rows, SHOTS)
    _, _, delta, _, tool = draws(functions, rng, rows)
    turns, weights = functions.robot.recorded_turns(joints), rng.uniform(size=(SHOTS, 1))
    targets = rng.uniform(-1500, 1500, (rows, 2, 3))
    content = np.append(np.full(n, 3e-8), 2.5e-3)
    variances = np.exp(rng.normal(size=(rows, n + 1))) * content

    def chosen(some=slice(None), index=INDEX):
        return [
            per_both(turns[some]),
            per_both(spots[some]),
            per_inner(weights, SHOTS),
            per_outer(delta[some], SHOTS),
            columns(targets[some].reshape(len(targets[some]), -1), Offsets.of(3 * index))[0],
            per_outer(tool[some], SHOTS),
            per_outer(variances[some], SHOTS),
            constant(content, SHOTS),
        ]

    return chosen


@needs_compiler
@pytest.mark.parametrize("name", DESIGNED)
@pytest.mark.parametrize("which", ["terms", "slopes"])
@pytest.mark.at_length(r"^terms-|^slopes-(?!irb1600)")
def test_sums_over_shots_by_both_paths(tmp_path, name, which):
    """Rows that fill the lanes and rows that do not, and each row as if it were alone. To 1e-12 of the
    largest of each output; measured with gcc on x86-64: not one bit of difference."""
    functions = shot_functions(name, tmp_path, "relative")
    compiled, plain = functions.kernel(which, compile=True), functions.kernel(which, compile=False)
    assert (compiled.compiled, plain.compiled) == (True, False)
    for rows in ROWS:
        inputs = weighted_inputs(functions, rows)
        results = compiled.sums(inputs(), rows, SHOTS)
        for one, two in zip(results, plain.sums(inputs(), rows, SHOTS), strict=True):
            assert np.abs(one).min() > 0 or which == "slopes"
            np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12 * np.abs(two).max())
        for row in range(rows):
            alone = compiled.sums(inputs(slice(row, row + 1)), 1, SHOTS)
            for part, actual in zip(results, alone, strict=True):
                np.testing.assert_array_equal(part[row], actual[0])
        # Control: with the targets mixed up it is another sum.
        other = compiled.sums(inputs(index=1 - INDEX), rows, SHOTS)
        assert np.abs(other[0] / results[0] - 1).min() > 1e-3


@needs_compiler
@pytest.mark.parametrize("name", DESIGNED)
@pytest.mark.at_length(r"^(?!irb1600)")
def test_rows_by_both_paths(tmp_path, name):
    functions = shot_functions(name, tmp_path)
    for which in ("linear", "placed", "seen", "place", "beam"):
        compiled, plain = functions.kernel(which, compile=True), functions.kernel(which, compile=False)
        for rows in ROWS:
            q, spot, delta, target, tool = draws(functions, np.random.default_rng(rows), rows)
            inputs = {
                "linear": (q, spot, delta, target, tool),
                "beam": (q, delta, tool),
            }.get(which, (q, delta, target))
            results = compiled(*inputs)
            for one, two in zip(results, plain(*inputs), strict=True):
                np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12 * np.abs(two).max())
            for row in range(rows):
                alone = compiled(*(each[row : row + 1] for each in inputs))
                for part, other in zip(results, alone, strict=True):
                    np.testing.assert_array_equal(part[row], other[0])
