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
    "test_no_worker_is_left": r"^Ctrl-C at the start$",
    "test_the_weight_multiplies_all_that_a_shot_adds": r"-(modified|scara|bent)-",
    "test_sums_over_shots_by_both_paths": r"^terms-|^slopes-(?!irb1600|gantry)",
    "test_rows_by_both_paths": r"^(?!irb1600|gantry)",
    "test_without_a_compiler_the_numbers_are_the_same": r"^(?!irb1600-sep|gantry)",
    "test_the_p_values_are_uniform": r"^(two|calibrated-known|open)",
    "test_the_sandwich_is_the_scatter_of_many_runs": r"^(open laser|two targets)",
    "test_a_robust_fit_is_there_on_request_and_names_the_shot_that_is_off": r"^student",
    "test_no_output_of_a_run_claims_what_its_shots_cannot_tell": r"^(dinova_1|three shots|joint 1 freed)",
    "test_the_unit_of_length_does_not_matter": r"^(0\.001|10\.0)",
    "test_the_placements_of_every_arm_disagree": r"separate$",
    "test_every_command_answers_or_refuses_in_one_message": r"^revolute laser",
    "test_no_number_is_made_up": r"(with geometry|x-pattern)$",
    "test_no_offset_of_one_joint_is_told_as_known": r"^(prismatic laser|revolute laser-free)",
    "test_it_is_one_well_formed_file_that_fetches_nothing": r"^(?!good$|hostile$|geometry$)",
    "test_every_cell_of_the_page_is_in_the_pdf": r"^(?!geometry$)",
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
    "test_a_plan_is_rehearsed_from_the_file_to_the_file": r"^(?!tracker$)",
    "test_offsets_of_exact_arms_are_as_uncertain_as_stated": r"^(?!laser$|pose$|tracker$)",
    "test_offsets_come_back_through_the_program_of_every_arm": r"^(irb120|ur10e|kr10_r1100_2|m10ia|tx2_60)$",
    "test_the_power_is_that_of_the_count": r"^40$",
    "test_of_other_instruments_a_right_robot_agrees_and_a_wrong_one_does_not": r"^plane$",
    "test_what_is_written_is_read_back": r"^(misfit|hostile)$",
    "test_an_estimated_noise_does_not_hide_the_exchange": r"^separate$",
    "test_the_judge_and_the_package_have_the_same_model_of_each_kind": r"^(laser, free|plane)$",
    "test_the_whole_of_emcee_and_of_scipy_stats_is_there": r"^(?!move)",
    "test_steps_are_not_found_where_there_are_none": r"^0\.4$",
    "test_a_reading_whose_std_is_understated_fails_the_same_check": r"^(?!tracker$)",
    "test_every_view_leaves_nobody_out_and_asks_its_server_alone": r"^(?!laptop)",
    "test_no_file_leads_a_job_out_of_the_folder": r"^(?!arm\.yaml-run$|\.\./outside\.yaml-cell$)",
    "test_a_zero_beyond_its_prior_is_named_though_others_take_up_more_of_the_links": r"^zero of J2",
    "test_a_request_to_end_stops_the_motion_and_says_how_to_go_on": r"^heard$",
    "test_every_figure_is_svg_with_a_text_for_those_who_do_not_see_it": r"^(held_out|uncalibrated)$",
    "test_a_file_that_finds_no_room_is_a_fault_and_one_message": r"^(plan-a lim|report-a lim|batch-a full)",
    "test_the_blocks_of_a_page_run_in_their_order": r"^docs/(?!files\.md|five|reference)",
    "test_an_arm_whose_base_frame_is_above_its_mounting_face": r"^lrmate",
    "test_hostile_names_are_shown_as_they_are_and_do_nothing": r"^hostile",
    "test_a_start_recovers_a_random_truth": r"[1-9]$",
}

# … and whole ones: statistics of many runs, and ways through several commands. Shorter ones run their code.
WHOLE = {
    "test_places_are_about_the_arm",
    "test_a_joint_is_turned_in_the_picture_and_undone",
    "test_pictures_of_something_else_are_a_misfit",
    "test_a_save_that_meets_another_version_shows_both_and_takes_either",
    "test_intervals_hold_and_controls_are_detected",
    "test_what_a_tracker_reads_is_entered_as_it_is_asked_for",
    "test_an_instrument_of_the_page_of_instruments",
    "test_a_verdict_that_is_wrong_is_noticed",
    "test_a_small_study_is_carried_out_and_shown",
    "test_ctrl_c_ends_jobs_and_those_who_follow_them",
    "test_the_app_opens_and_fits_a_run_of_several_instruments",
    "test_four_points_of_a_tracker_lower_the_error_of_the_tcp_as_predicted",
    "test_halves_of_a_real_arm_predict_each_other",
    "test_false_alarms_are_as_rare_as_stated",
    "test_of_many_measurements_a_part_is_tried_first",
    "test_the_uncertainty_is_that_of_what_serves_the_arm_best",
    "test_with_an_estimated_scale_they_are_uniform_as_well",
    "test_the_errors_are_as_long_as_is_expected",
    "test_a_plan_that_tells_both_tells_both",
    "test_links_that_explain_every_residual_leave_the_noise_its_size",
    "test_no_gauge_is_called_known_with_geometry",
    "test_a_verdict_that_is_wrong_is_noticed_with_geometry",
    "test_what_runs_of_an_uncertain_arm_notice_is_as_predicted",
    "test_those_of_a_run_are_those_of_many_more_draws",
    "test_the_false_alarm_rate_is_as_stated",
    "test_what_was_not_read_at_a_posture_is_no_evidence_of_a_step",
    "test_a_factor_of_few_degrees_of_freedom_is_chance",
    "test_arms_within_their_tolerances_raise_no_alarm",
    "test_in_the_frame_of_the_page",
    "test_an_attended_command_ends_with_who_began_it",
    "test_time_left_is_a_bound_where_it_is_one",
    "test_a_file_that_was_deleted_is_not_made_again_unasked",
    "test_the_browser_is_opened_without_the_token_in_its_command_line",
    "test_the_intervals_hold_what_they_promise",
    "test_the_interval_holds_the_noise_as_often_as_it_says",
    "test_more_measurements_know_more",
    "test_killed_at_any_instant_no_shot_is_lost_and_the_run_ends_the_same",
    "test_what_a_killed_batch_left_in_the_folder_of_a_run_is_in_nobodys_way",
    "test_all_files_are_there_over_those_of_before_and_stay_when_a_number_is_none",
    "test_a_plan_of_coverage_has_one_page",
    "test_a_study_for_a_machine",
    "test_report_prints_the_json_that_it_wrote",
    "test_a_bag_that_stands_for_far_more_than_its_size_is_refused",
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
        at_length = name in AT_LENGTH and re.search(AT_LENGTH[name], parameters.removesuffix("]"))
        if at_length or name in WHOLE:
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
