"""Random TP listings: refused, or the true arm's flange goes where the program means it.

An independent controller (`tp_controller`) runs the program on the nominal arm and the corrected one on the
true arm, with the same random inputs.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controller_arm import ControllerArm
from tp_controller import NoProgram, TpController, clear_letters
from tp_programs import FORMS, Form, Listing, apart, good_listing, nominal, random_row, rounding, with_form
from user_programs import corrected_for, deviating, read

from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

ROBOT = load_robot("lrmate_200id")
_RUNS = 3
_MM, _DEG = 0.01, 0.001  # beyond what three decimals make of it


@dataclass(frozen=True)
class TrueArm:
    """Offsets (6,) degrees, and the robot whose links deviate or not."""

    links: Robot
    offsets: np.ndarray

    @classmethod
    def random(cls, rng: np.random.Generator, deviates: bool) -> TrueArm:
        links = deviating(ROBOT, rng, (1, 3) if deviates else ())
        return cls(links, np.round(rng.uniform(-1, 1, 6), 3))

    def corrected(self, listing: Listing, text: str, folder: Path) -> tuple[str, list[str]]:
        """The corrected program, and what is said of it."""
        file = folder / "in.ls"
        file.write_bytes(text.encode("latin-1"))
        done = corrected_for(self.links, self.offsets, ROBOT, file, listing.choices)
        return read(done), done.notes

    def errors(
        self, listing: Listing, text: str, corrected: str, seed: int, controller: TpController | None = None
    ) -> tuple[float, float, int]:
        """The most, mm and degrees, by which a pose of the flange is elsewhere than meant beyond the
        rounding, and how many poses were compared."""
        controller = controller or listing.controller()
        true = ControllerArm.of(self.links, self.offsets)
        start = random_row(np.random.default_rng(0), clear_letters(listing.points[0].row)[0])
        mm = deg = 0.0
        compared = 0
        for run in range(_RUNS):
            meant = controller.run(text, start, np.random.default_rng([seed, run]))
            reached = controller.run(corrected, start, np.random.default_rng([seed, run]))
            assert [visit.name for visit in meant] == [visit.name for visit in reached]
            for one, other in zip(meant, reached, strict=True):
                if one.name in listing.left:
                    continue
                tool = max(controller.tools.values(), key=lambda pose: float(np.linalg.norm(pose[:3, 3])))
                most_mm, most_deg = rounding(one.joints, one.in_joints, tool)
                off_mm, off_deg = apart(nominal().fk(one.joints, "deg"), true.fk(other.joints, "deg"))
                mm, deg, compared = max(mm, off_mm - most_mm), max(deg, off_deg - most_deg), compared + 1
        return mm, deg, compared


def checked(seed: int, folder: Path) -> tuple[float, float, int] | None:
    """A random program: the errors of its poses, or None where it is refused."""
    rng = np.random.default_rng([7, seed])
    listing = good_listing(rng)
    if rng.random() < 0.4 and any(
        not point.in_joints and point.name not in listing.left for point in listing.points
    ):
        listing = with_form(listing, FORMS[int(rng.integers(len(FORMS)))], rng)
    arm = TrueArm.random(rng, deviates=bool(rng.random() < 0.3))
    text = listing.text()
    try:
        corrected, said = arm.corrected(listing, text, folder)
    except BadInput:
        return None
    assert not listing.form
    left = sum(point.name in listing.left for point in listing.points)
    count = len(listing.points)
    assert said[0] == (
        f"positions in the program: {count}; corrected: {count - left}; left as they are: {left};"
        " poses of tools and frames: 0"
    )
    return arm.errors(listing, text, corrected, seed)


def of(count: int, many: int) -> list[Any]:
    """So many seeds, and many more at length."""
    return [range(count), pytest.param(range(count, count + many), marks=pytest.mark.long)]


@pytest.mark.parametrize("seeds", of(6, 2094))
def test_random_programs_are_refused_or_right(seeds: range, tmp_path: Path) -> None:
    accepted = [result for seed in seeds if (result := checked(seed, tmp_path)) is not None]
    assert len(accepted) >= len(seeds) / 4
    mm, deg, compared = zip(*accepted, strict=True)
    assert max(mm) < _MM
    assert max(deg) < _DEG
    assert sum(compared) > 5 * len(accepted)


@pytest.mark.parametrize("seeds", of(4, 516))
def test_damaged_programs_are_refused_or_right(seeds: range, tmp_path: Path) -> None:
    """Programs without one letter: refused, or right as what they mean now."""
    for seed in seeds:
        rng = np.random.default_rng([8, seed])
        listing, arm = good_listing(rng), TrueArm.random(rng, deviates=False)
        text = listing.text()
        place = int(rng.integers(len(text)))
        text = text[:place] + text[place + int(rng.integers(1, 4)) :]
        try:
            corrected, _ = arm.corrected(listing, text, tmp_path)
        except BadInput:
            continue
        with suppress(NoProgram):
            mm, deg, _ = arm.errors(listing, text, corrected, seed)
            assert mm < _MM
            assert deg < _DEG


@pytest.mark.usefixtures("unsolved")
@pytest.mark.long
def test_a_program_that_ends_anywhere_is_refused(good: tuple[Listing, TrueArm], tmp_path: Path) -> None:
    listing, arm = good
    text = listing.text()
    for end in np.linspace(1, text.index("/END") + 3, 25).astype(int):
        with pytest.raises(BadInput, match="nothing is written"):
            arm.corrected(listing, text[:end], tmp_path)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[Listing, TrueArm]:
    """A program that is accepted, with poses in frames other than the base and the flange."""
    folder = tmp_path_factory.mktemp("good")
    for attempt in range(100):
        rng = np.random.default_rng([1, attempt])
        listing, arm = good_listing(rng), TrueArm.random(rng, deviates=False)
        poses = [point for point in listing.points if not point.in_joints and point.name not in listing.left]
        if not poses or {point.pair for point in poses} != {(1, 1)}:
            continue
        try:
            arm.corrected(listing, listing.text(), folder)
        except BadInput:
            continue
        return listing, arm
    raise AssertionError


@pytest.mark.usefixtures("unsolved")
@pytest.mark.parametrize("form", FORMS, ids=[form.name for form in FORMS])
def test_each_form_is_refused_alone_with_its_line(
    form: Form, good: tuple[Listing, TrueArm], tmp_path: Path
) -> None:
    listing, arm = good
    bad = with_form(listing, form, np.random.default_rng(2))
    text = bad.text()
    with pytest.raises(BadInput) as refused:
        arm.corrected(bad, text, tmp_path)
    before, lines = listing.text().splitlines(), text.splitlines()
    skip = 5 if form.part == "body" else 0  # numbers of lines
    same = (one[skip:] == other[skip:] for one, other in zip(before, lines, strict=False))
    first = next(i for i, equal in enumerate(same, start=1) if not equal)
    allowed = range(first, first + len(lines) - len(before) + 1)
    found = {int(line) for line in re.findall(r"in\.ls line (\d+):", str(refused.value))}
    # A frame that another one may be in place of is named at each motion that it concerns.
    assert found & set(allowed), str(refused.value)
    assert found <= set(allowed) or "here; set U" in str(refused.value), str(refused.value)
    assert "nothing is written" in str(refused.value)


@pytest.mark.parametrize("form", [form for form in FORMS if form.runs], ids=lambda form: form.name)
@pytest.mark.one_in(4)
def test_a_form_that_the_rewriter_does_not_see_makes_wrong_poses(
    form: Form, good: tuple[Listing, TrueArm], tmp_path: Path
) -> None:
    """What the comparison is worth: with the instruction hidden from the rewriter it finds the error."""
    listing, arm = good
    body = [f"J P[{point.number}] 100% FINE" for point in listing.points]
    listing = replace(listing, body=body, left=frozenset(), calls=frozenset())
    bad = with_form(listing, form, np.random.default_rng(2))
    hidden, corrected_head = listing.text(), arm.corrected(listing, listing.text(), tmp_path)[0]
    positions = corrected_head[corrected_head.index("/POS") :]
    corrected = bad.text()[: bad.text().index("/POS")] + positions
    controller = bad.controller()
    controller.checks_frames = False
    mm, deg, _ = arm.errors(bad, bad.text(), corrected, 3, controller)
    assert mm > 2 * _MM or deg > 2 * _DEG
    mm, deg, _ = arm.errors(listing, hidden, corrected_head, 3, controller)
    assert mm < _MM
    assert deg < _DEG
