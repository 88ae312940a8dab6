"""What `.ci/mutants.py` changes: one operator, comparison, index or bound at a time, and no text."""

from pathlib import Path

from scripts import ROOT, load_script


def test_a_mutant_is_another_operator_comparison_index_or_bound() -> None:
    text = (
        'def f(x):\n    """1 + 1"""\n    if x[0] < 2.0:\n        raise ValueError(f"{x + 1}")\n'
        '    return "a" + "b" if x is None else max(x * 3 - 1, 0.0)\n'
    )
    made = sorted(load_script(ROOT / ".ci", "mutants").Sites(Path("one.py"), text).found)
    assert [(one.line, text.encode()[one.start : one.end].decode(), one.text) for one in made] == [
        (3, "0", "1"),
        (3, "<", ">="),
        (5, "max", "min"),
        (5, "*", "/"),
        (5, "-", "+"),
    ]
