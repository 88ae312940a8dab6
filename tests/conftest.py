"""What many tests start from."""

from __future__ import annotations

import argparse
import gc
import os
import re
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from zerobeam.model.errors import BadInput

# Combinations that `make test` leaves to `make test-long`: by test, those whose parameters match.
AT_LENGTH = {
    "test_the_weight_multiplies_all_that_a_shot_adds": r"-(modified|scara|bent)-",
    "test_sums_over_shots_by_both_paths": r"^terms-|^slopes-(?!irb1600|gantry)",
    "test_rows_by_both_paths": r"^(?!irb1600|gantry)",
    "test_without_a_compiler_the_numbers_are_the_same": r"^(?!irb1600-sep|gantry)",
    "test_the_p_values_are_uniform": r"^two",
    "test_the_sandwich_is_the_scatter_of_many_runs": r"^(open laser|two targets)",
    "test_a_robust_fit_is_there_on_request_and_names_the_shot_that_is_off": r"^student",
    "test_no_output_of_a_run_claims_what_its_shots_cannot_tell": r"^(dinova_1|three shots)",
    "test_the_unit_of_length_does_not_matter": r"^(0\.001|10\.0)",
    "test_the_placements_of_every_arm_disagree": r"separate$",
    "test_every_command_answers_or_refuses_in_one_message": r"^revolute laser",
    "test_no_number_is_made_up": r"with geometry$",
    "test_no_offset_of_one_joint_is_told_as_known": r"^(prismatic laser|revolute laser-free)",
    "test_it_is_one_well_formed_file_that_fetches_nothing": r"^(held_out|outlier|separate|uncalibrated)$",
    "test_every_cell_of_the_page_is_in_the_pdf": r"^(held_out|outlier|unconverged|uncalibrated)$",
    "test_the_arm_of_a_simulated_run_with_its_offsets_entered_passes": r"^uncalibrated$",
    "test_one_step_is_as_good_as_a_fit": r"^tool1",
    "test_status_and_cause_are_those_of_exact_geometry": r"-0\.01$",
    "test_of_exchanged_columns_with_geometry_the_misfit_is_said": r"1$",
    "test_a_corrected_robot_is_verified_by_every_kind": r"^(known|pose|ballbar)$",
    "test_joints_that_never_move_are_unidentifiable": r"^False-7$",
    "test_two_percent_of_outliers_are_found_and_said": r"^huber$",
    "test_what_is_determined_is_right_and_the_rest_is_not_told": r"^(pose|known)$",
    "test_readings_that_are_wrong_alike_are_named": r"^tracker, frame known-mirrored$",
    "test_a_plan_keeps_to_what_its_instrument_can_measure": r"^(pose|sphere)$",
    "test_a_plan_is_rehearsed_from_the_file_to_the_file": r"^tracker$",
    "test_offsets_of_exact_arms_are_as_uncertain_as_stated": r"^(sphere|dial|laser \+ tracker)$",
    "test_offsets_come_back_through_the_program_of_every_arm": r"^(irb120|ur10e|kr10_r1100_2|m10ia|tx2_60)$",
}

# As the command line does (`cli.main`): by default the collector takes a good part of the time.
gc.set_threshold(50_000, 20, 20)


def pytest_collection_finish() -> None:
    """What has been collected stays to the end, and need not be looked at again by the garbage collector."""
    gc.freeze()


def pytest_unconfigure() -> None:
    if "chromium" in sys.modules:
        sys.modules["chromium"].close_browser()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--shard", type=_shard, metavar="K/N", help="the tests of the K-th of N parts alone")


def _shard(stated: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", stated)
    if not found or int(found[1]) > int(found[2]):
        raise argparse.ArgumentTypeError(f"{stated!r} is no part, such as 1/4")
    return int(found[1]), int(found[2])


@pytest.hookimpl(tryfirst=True)  # before `-m` chooses
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        name, _, parameters = item.name.partition("[")
        if name in AT_LENGTH and re.search(AT_LENGTH[name], parameters.removesuffix("]")):
            item.add_marker(pytest.mark.long)
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.timeout(3600))
    if shard := config.getoption("--shard"):
        others = [item for item in items if zlib.crc32(item.nodeid.encode()) % shard[1] != shard[0] - 1]
        config.hook.pytest_deselected(items=others)
        left_out = set(others)
        items[:] = [item for item in items if item not in left_out]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of recordings that the project does not ship; without it the test is skipped."""
    stated = os.environ.get("ZEROBEAM_SHARED_DATA")
    folder = Path(stated) if stated else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not (folder / "mukca").is_dir():
        pytest.skip(f"no recordings at {folder}; name their folder in ZEROBEAM_SHARED_DATA")
    return folder


@pytest.fixture(scope="session", autouse=True)
def kernel_cache(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder of compiled kernels for all tests, and not the user's own: a kernel is compiled again only when
    its source, the compiler or its flags have changed, all of which its name has.

    What `tests/support/made_once.py` keeps is kept for one session; the workers of pytest-xdist share it.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder, made = pytestconfig.rootpath / "build" / "kernels", shared / "made"
    with pytest.MonkeyPatch.context() as patch:
        for name, path in (("ZEROBEAM_CACHE", folder), ("ZEROBEAM_TESTS_MADE", made)):
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            patch.setenv(name, str(path))
        yield folder


@pytest.fixture
def refused() -> Callable[..., BadInput]:
    """Call something that must raise BadInput, and give the error for a closer look."""

    def call(function: Callable[..., object], *args: object, **kwargs: object) -> BadInput:
        with pytest.raises(BadInput) as caught:
            function(*args, **kwargs)
        return caught.value

    return call


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_linear_algebra() -> Iterator[None]:
    """Matrices are small here: with more threads than idle cores the tests take many times as long."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield
