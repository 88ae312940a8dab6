"""In which line a place is: as counting says."""

from hypothesis import given
from hypothesis import strategies as st

from zerobeam.model.parsing.reading import line_numbers


@given(st.text(alphabet="a\n\r é", max_size=60))
def test_every_place_of_any_text(text):
    line_of = line_numbers(text)
    for place in range(len(text) + 1):
        assert line_of(place) == text.count("\n", 0, place) + 1
