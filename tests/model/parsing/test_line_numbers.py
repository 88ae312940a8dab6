"""In which line a place is: as counting says."""

from hypothesis import given
from hypothesis import strategies as st

from zerobeam.experiments.makers.program_parts import span, understood
from zerobeam.model.parsing.reading import line_numbers


@given(st.text(alphabet="a\n\r é", max_size=60))
def test_every_place_of_any_text(text):
    line_of = line_numbers(text)
    for place in range(len(text) + 1):
        assert line_of(place) == text.count("\n", 0, place) + 1


def test_a_statement_far_into_a_text_has_its_places_there():
    statement = "MOVJ C00001 VJ=10.00"
    before = "NOP\n" * 1000
    alone = understood("yaskawa/inform", "statement", statement, 0, len(statement))
    inside = understood(
        "yaskawa/inform", "statement", f"{before}{statement}\nEND", len(before), len(before) + len(statement)
    )
    assert alone is not None
    shifted = [(span(each)[0] + len(before), str(each)) for each in alone.scan_values(lambda _: True)]
    assert [(span(each)[0], str(each)) for each in inside.scan_values(lambda _: True)] == shifted
    assert shifted
