"""What `make test` leaves to `make test-long`."""

import pytest


def test_no_long_test_is_run_where_they_are_left_out(request: pytest.FixtureRequest) -> None:
    """Nor one that tests/conftest.py marks by its parameters: that is done before any is chosen."""
    if request.config.option.markexpr != "not long":
        pytest.skip("only where long tests are left out")
    assert not [item.nodeid for item in request.session.items if item.get_closest_marker("long")]
