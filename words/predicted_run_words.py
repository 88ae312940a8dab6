"""What a held-out run says of the estimates, in sentences."""

from __future__ import annotations

from ..analysis.diagnostics.predicted_run import PredictedRun
from ..analysis.status import LACK_OF_FIT
from . import numbers
from .finding_words import predicted_run_message
from .wording import capital, clipped, counted, ended, listed, shown


def predicted_run_sentences(run: PredictedRun) -> list[str]:
    """How it was predicted, how well, and what is no prediction."""
    sentences = [_how(run)]
    if run.rms_mm is not None and run.expected_mm is not None and run.u_mm is not None:
        sentences.append(
            f"The errors are {numbers.significant(run.rms_mm, unit='mm')} rms. From noise and fit"
            f" {numbers.significant(run.expected_mm, unit='mm')} are expected, including the standard"
            f" uncertainty of the prediction, {numbers.significant(run.u_mm, unit='mm')}."
        )
        if run.rms_deg is not None and run.expected_deg is not None:
            sentences.append(
                f"Rotations are off by {numbers.significant(run.rms_deg, unit='deg')} rms; expected from"
                f" noise and fit: {numbers.significant(run.expected_deg, unit='deg')}."
            )
        sentences.append(_gain(run.rms_mm, run.rms_before_mm))
    if run.p_value is not None and run.factor is not None:
        p = f"p-value {numbers.p_value(run.p_value)}"
        if run.p_value < LACK_OF_FIT:
            factor = numbers.significant(run.factor, 2)
            sentences.append(
                f"The errors are {factor} times what noise and fit explain ({p}): the estimates do not carry"
                " over to this run as stated."
            )
        else:
            sentences.append(f"The errors agree with noise and fit ({p}).")
    if (message := predicted_run_message(run)) is not None:
        sentences.append(ended(capital(message)))
    return sentences


def _how(run: PredictedRun) -> str:
    text = f"Everything is estimated from the analysed run; {clipped(shown(run.run), 60)} is predicted."
    if run.targets_placed:
        one = len(run.targets_placed) == 1
        names = listed([clipped(name) for name in run.targets_placed])
        text += (
            f" The position{'' if one else 's'} of {names}, which the analysed run lacks,"
            f" {'is' if one else 'are'} estimated from the held-out run itself. The components of the"
            " residuals that this takes up do not count, neither in what is expected nor in the degrees of"
            " freedom."
        )
    return text


def _gain(rms: float, before: float | None) -> str:
    if before is None:
        return "There is no comparison with nominal values: their fit of targets and tool did not converge."
    text = (
        "With nominal joints and links, and targets and free tool fitted to the analysed run, they are"
        f" {numbers.significant(before, unit='mm')}"
    )
    return f"{text}: {numbers.significant(before / rms, 2)} times as much." if rms > 0 else f"{text}."


def predicted_run_alt(run: PredictedRun) -> str:
    """The figure in a sentence."""
    rows = [row for row in run.measurements if row.error_mm is not None]
    worst = max(rows, key=lambda row: row.error_mm or 0.0)
    count, name = counted(len(rows), "measurement"), clipped(shown(run.run), 60)
    largest = numbers.or_words(worst.error_mm, "", "mm")
    return (
        f"Prediction errors of {count} of {name}, nominal against calibrated; the largest with calibration is"
        f" {largest} at measurement {worst.shot}."
    )
