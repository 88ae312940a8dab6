"""Causes of a misfit in words: what each is called, what is different under it, what mends it."""

from __future__ import annotations

from collections.abc import Sequence

from ..analysis.diagnostics.diagnosis import Explanation, Misreading
from ..analysis.diagnostics.suspects import Cause
from . import numbers
from .numbers import times
from .wording import clipped, listed

MOST_MEASUREMENTS = 10

CAUSES: dict[Cause, str] = {
    "swapped_joints": "joint columns exchanged",
    "sign": "sign of a joint",
    "zero": "zero of a joint",
    "units": "unit of the angles",
    "coupling": "coupled joints",
    "metres": "unit of the readings",
    "mirrored": "left-handed frame",
    "quaternion": "order of the quaternions",
    "inverse": "inverse rotations",
    "inverse_pose": "inverse poses",
    "rows": "joints of another measurement",
    "twist": "sign of a twist",
    "convention": "Denavit-Hartenberg convention",
    "arm": "another arm",
    "length": "one link parameter",
    "tool": "tool",
    "spot": "axes of the spots",
    "placement": "one placement",
    "measurements": "single measurements",
    "repeats": "repeats that differ from the first measurements",
    "moved_target": "moved target",
    "jump": "zero of a joint that jumped",
    "drift": "drift during the run",
    "lag": "joints read while the arm moved",
    "backlash": "backlash",
    "gain": "gear ratio or encoder scale of a joint",
    "noise": "noise understated",
    "geometry": "link geometry",
    "gravity": "deflection under gravity",
    "harmonics": "first harmonics of the joints",
}
_LARGER = {"geometry": "the links", "gravity": "gravity", "harmonics": "the first harmonics"}
_SPOTS = {
    "exchanged": "spot_mm with its two axes exchanged",
    "rotated by 90°": "spot_mm rotated by 90°",
    "rotated by −90°": "spot_mm rotated by −90°",
    "negated": "spot_mm negated (it is the position of the spot, not of the target)",
    "first negated": "the first axis of spot_mm negated",
    "second negated": "the second axis of spot_mm negated",
    "exchanged and negated": "spot_mm with its two axes exchanged and negated",
}
_AGAIN = "and analyse again"
# Mended by another file: by a new import, or by a new recording.
_BY_ANOTHER_RUN = frozenset(
    {"swapped_joints", "sign", "units", "coupling", "metres", "mirrored", "quaternion", "inverse"}
    | {"inverse_pose", "rows", "repeats", "jump", "drift", "lag", "backlash", "gain"}
)


def changed(explanation: Explanation) -> str:
    """What is different under this explanation."""
    joints = [f"J{joint}" for joint in explanation.joints]
    targets = [clipped(name) for name in explanation.targets]
    amount, of = explanation.amount, explanation.of
    match explanation.cause:
        case "swapped_joints":
            return f"with {listed(joints)} exchanged"
        case "sign":
            return f"with the sign of {joints[0]} reversed"
        case "zero":
            how = "added to" if amount > 0 else "subtracted from"
            quarter = amount % 90 == 0
            by = numbers.exact(abs(amount)) if quarter else numbers.significant(abs(amount))
            return f"with {numbers.with_unit(by, 'deg')} {how} {joints[0]}"
        case "units":
            if amount > 1:
                return "with the joint angles read as radians"
            return "with the joint angles divided by 57.3 (converted from radians to degrees twice)"
        case "coupling":
            how = "added to" if amount > 0 else "subtracted from"
            return f"with {joints[0]} {how} {joints[1]} (coupled joints)"
        case "metres":
            return f"with measured_mm of {clipped(of)} read as metres"
        case "mirrored":
            axis = "xyz"[round(amount) - 1] if amount else "one axis"
            return f"with the sign of {axis} of {clipped(of)} reversed (a left-handed frame)"
        case "quaternion":
            return f"with measured_quat of {clipped(of)} read as x, y, z, w"
        case "inverse":
            return f"with the rotations of {clipped(of)} inverted, its positions as they are"
        case "inverse_pose":
            return (
                f"with the poses of {clipped(of)} inverted (they were of the instrument as the body sees it)"
            )
        case "rows":
            which = "before" if amount > 0 else "after"
            return f"with the joints of each measurement taken from the one {which} it"
        case "twist":
            end = "the flange" if len(joints) == 1 else joints[1]
            return f"with the sign of the twist from {joints[0]} to {end} reversed in the robot file"
        case "convention":
            return f"with the rows of the robot file read as {of} Denavit-Hartenberg parameters"
        case "arm":
            return f"with the arm {of}"
        case "length":
            return f"with {of} {_signed(amount, _unit(of))} in the robot file"
        case "tool" if of == "point":
            return f"with the point of the tool {_size(amount, 'mm')} elsewhere"
        case "tool":
            return f"with the direction of the beam rotated by {_size(amount, 'deg')}"
        case "spot":
            return f"with {_SPOTS[of]}"
        case "placement":
            return f"without the measurements at {listed(targets)}"
        case "measurements":
            return f"without {_called(explanation)}"
        case "repeats":
            return f"without the repeats {_numbers(explanation)}"
        case "moved_target":
            return f"with {targets[0]} moved {_between(explanation)}"
        case "jump":
            return f"with the zero of {joints[0]} {_signed(amount, 'deg')} {_between(explanation)}"
        case "drift":
            what = f"the zero of {joints[0]}" if joints else targets[0]
            return f"with {what} drifting by {_size(amount, 'deg' if joints else 'mm')} over the run"
        case "lag":
            share = numbers.significant(100 * abs(amount), 2)
            side = "behind" if amount > 0 else "ahead of"
            return f"with the recorded joints {share} % of each motion {side} the arm"
        case "backlash":
            which = listed(joints) if joints else "all joints"
            return f"with backlash in {which}"
        case "gain":
            share, size = numbers.significant(100 * abs(amount), 2), "larger" if amount >= 0 else "smaller"
            return f"with the motions of {joints[0]} {share} % {size} than recorded"
        case "noise":
            return f"with {times(amount)} times the stated noise"
        case "geometry" if amount <= 1:
            return "with link geometry estimated"
        case "geometry" | "gravity" | "harmonics":
            return f"with {_LARGER[explanation.cause]} {times(amount)} times the stated tolerance"


def by_another_run(explanation: Explanation) -> bool:
    """Whether what is to be done makes another run file: the present one is not to be analysed again."""
    return explanation.cause in _BY_ANOTHER_RUN


def mend(explanation: Explanation) -> str:
    """What to do about a cause, as sentences."""
    joints, targets = [f"J{joint}" for joint in explanation.joints], list(map(clipped, explanation.targets))
    of = explanation.of
    match explanation.cause:
        case "swapped_joints":
            return (
                f"Exchange the columns of {listed(joints)}: import the recording again with them exchanged"
                f" (zerobeam import csv --columns), {_AGAIN}."
            )
        case "sign":
            return (
                f"Reverse the sign of {joints[0]} in the recording (zerobeam import csv --reversed), or of"
                f" its axis in the robot file, {_AGAIN}."
            )
        case "zero":
            return f"Correct the zero of {joints[0]} in the recording, or theta_deg of its row, {_AGAIN}."
        case "units":
            return f"Import the recording again with the right --units, {_AGAIN}."
        case "coupling":
            from_ground = explanation.amount > 0
            counted = "ground" if from_ground else "link"
            by_hand = "add joint 2 to joint 3" if from_ground else "subtract joint 2 from joint 3"
            return (
                f"Joint 3 was read with another counting: import the recording with --j3 {counted}, or"
                f" {by_hand} in the run, {_AGAIN}."
            )
        case "metres":
            return (
                f"Multiply measured_mm of {clipped(of)} by 1000, or import it again with its unit, {_AGAIN}."
            )
        case "mirrored":
            axis = "xyz"[round(explanation.amount) - 1] if explanation.amount else "y, or any one axis,"
            quat = "a quaternion goes with it: its components of the other two axes change their sign"
            return f"Reverse the sign of {axis} in measured_mm of {clipped(of)} ({quat}), {_AGAIN}."
        case "quaternion":
            again = f"Import the poses of {clipped(of)} again"
            return f"{again} with --quaternion-columns in the order w,x,y,z, {_AGAIN}."
        case "inverse" | "inverse_pose":
            which = "rotation" if explanation.cause == "inverse" else "pose"
            return f"Import the poses of {clipped(of)} again with --inverse {which}, {_AGAIN}."
        case "rows":
            return f"Put the joints of each measurement into its own line of the run, {_AGAIN}."
        case "twist":
            return f"Correct the sign of this twist in the robot file, {_AGAIN}."
        case "convention":
            return f"State convention: {of} in the robot file, {_AGAIN}."
        case "arm":
            return (
                f"Check the type plate of the arm. If it agrees, state robot: {of} in the header, {_AGAIN}."
            )
        case "length":
            return f"Measure or look up {of}, correct it in the robot file, {_AGAIN}."
        case "tool":
            key = "point_mm" if of == "point" else "direction"
            return f"Calibrate the tool again and correct tool.{key}, or state calibrated: false, {_AGAIN}."
        case "spot":
            return f"Correct spot_mm in every measurement as this says, {_AGAIN}."
        case "placement":
            return (
                f"Remove the measurements at {listed(targets)}, or record them again with the target fixed."
            )
        case "measurements":
            again = "it" if len(explanation.measurements) == 1 else "them"
            return (
                f"Analyse without {_called(explanation)} (--drop), correct {again} by the original record and"
                f" import again, or measure {again} again.{_readings(explanation.readings)}"
            )
        case "repeats":
            return (
                "Something changed during the run: look for what moved or slipped (target, instrument, arm)"
                f" before measurement {explanation.measurements[0]}, and record the run again."
            )
        case "moved_target":
            return (
                f"Give {targets[0]} another name in the measurements from {explanation.measurements[1]} on,"
                " or record the run again."
            )
        case "jump":
            return (
                f"Look for what slipped at {joints[0]} (belt, coupling, encoder) before measurement"
                f" {explanation.measurements[1]}, and record the run again; the measurements on one side may"
                " be analysed alone."
            )
        case "drift":
            return "Let the arm warm up and fasten the target. Then record the run again."
        case "lag":
            return (
                "Record the joints after the arm has come to rest (a longer dwell), and record the run again."
            )
        case "backlash":
            return (
                "Approach every posture from the same side, and record the run again; have the gears checked."
            )
        case "gain":
            return (
                f"Check the gear ratio (pulses per degree) of {joints[0]}, correct the recording, {_AGAIN}."
            )
        case "noise":
            return f"State noise as measured (repeat one posture), or noise.scale: estimated, {_AGAIN}."
        case "geometry" if explanation.amount <= 1:
            return (
                "Remove geometry: exact from the header (of a run its first line), so that the links are"
                f" estimated, {_AGAIN}."
            )
        case "geometry":
            return f"State the larger geometry.tolerance in the header if this arm is that far off, {_AGAIN}."
        case "gravity":
            return (
                f"State a larger geometry.gravity_deg in the header if this arm deflects so much, {_AGAIN}."
            )
        case "harmonics":
            return (
                f"State a larger geometry.harmonics_deg in the header if its gears are so far off, {_AGAIN}."
            )


def _unit(of: str) -> str:
    return "mm" if of.rpartition(".")[2] in ("a", "b", "d") else "deg"


def _size(amount: float, unit: str) -> str:
    return numbers.significant(abs(amount), 2, unit)


def _signed(amount: float, unit: str) -> str:
    sign = "+" if amount >= 0 else numbers.MINUS
    return (
        f"{sign}{numbers.significant(abs(amount), 2, unit) if unit else numbers.significant(abs(amount), 2)}"
    )


def _between(explanation: Explanation) -> str:
    return f"between measurements {explanation.measurements[0]} and {explanation.measurements[1]}"


def _called(explanation: Explanation) -> str:
    """The measurements by their numbers, as commands take them, and the row of the file that they were
    imported from, or the line of the run."""
    places = dict(explanation.sources)
    if len(explanation.measurements) == 1 and (source := places.get(explanation.measurements[0])):
        file, _, line = source.rpartition(":")
        number = f"measurement {explanation.measurements[0]}"
        row = "line" if file.endswith(".jsonl") else "row"
        return f"{number} ({row} {line} of {clipped(file)})"
    rows = {source.rpartition(":")[0]: True for source in places.values()}
    noun = "measurement" if len(explanation.measurements) == 1 else "measurements"
    text = f"{noun} {_numbers(explanation)}"
    if len(rows) != 1 or len(places) < len(explanation.measurements):
        return text
    (file,) = rows
    lines = [places[n].rpartition(":")[2] for n in explanation.measurements]
    rows_of = "lines" if file.endswith(".jsonl") else "rows"
    return f"{text} ({rows_of} {listed(lines, MOST_MEASUREMENTS)} of {clipped(file)})"


def _readings(readings: Sequence[Misreading]) -> str:
    """Which value of the measurement it may be, behind a sentence."""
    if not readings:
        return ""
    if len(readings) == 1:
        (one,) = readings
        return f" If one value is wrong, it is that of J{one.joint} ({_instead(one)})."
    each = [f"J{one.joint} ({_instead(one)})" for one in readings]
    return f" If one value is wrong, it is that of one of these joints: {listed(each, last='or')}."


def _instead(one: Misreading) -> str:
    recorded = numbers.exact(one.recorded)
    fitted = numbers.estimate(one.fitted, one.u, one.unit)
    text = f"{fitted} ± {numbers.spread(2 * one.u, one.unit)} instead of {recorded}"
    if one.meant is None:
        return text
    return f"{text}; {one.meant.replace('-', numbers.MINUS)} mistyped as {recorded}?"


def _numbers(explanation: Explanation) -> str:
    return listed([str(n) for n in explanation.measurements], MOST_MEASUREMENTS)
