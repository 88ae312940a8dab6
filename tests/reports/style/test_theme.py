"""The palette: readable, and telling without colour."""

import pytest

from zerobeam.reports.style.theme import PALETTE, SHAPES


def luminance(colour: str) -> float:
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("role", [*SHAPES, "ink", "muted", "misfit"])
@pytest.mark.parametrize("ground", ["ground", "panel"])
def test_text_has_the_contrast_that_wcag_aa_asks_for(theme: str, role: str, ground: str) -> None:
    assert contrast(getattr(PALETTE[role], theme), getattr(PALETTE[ground], theme)) >= 4.5


def test_every_status_has_a_shape_and_a_colour_of_its_own() -> None:
    assert set(SHAPES) == {"identified", "weak", "assumed", "unidentifiable", "held", "unvalidated"}
    assert len(set(SHAPES.values())) == 6
    # `themed` finds a role by its light colour: no two may share one.
    assert len({colour.light for colour in PALETTE.values()}) == len(PALETTE)
