"""A misfit in words: what speaks against the model, what that means for the answer, what may explain it,
what each of these causes is called and what mends it.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..analysis.diagnostics.diagnosis import Explanation, Misreading, undecided
from ..analysis.diagnostics.suspects import Cause
from ..analysis.misfit import (
    BeyondPrior,
    Criterion,
    ImplausibleNoise,
    LackOfFit,
    Misfit,
    NominalContradicted,
    OffPrior,
    PlacementsDisagree,
    TightPrior,
)
from ..analysis.observability.changes import ChangeAt, Displacement, RepeatsApart, RunChange
from ..analysis.recordings.steps import RecordingStep
from ..analysis.status import LACK_OF_FIT
from . import numbers
from .numbers import p_words, times
from .wording import Namer, capital, clipped, listed

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
_WHERE = "of a run its first line"
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
        case "tool" if of != "direction":
            return f"with the beam along {of} of the flange"
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
            return f"with {_LARGER[explanation.cause]} {times(amount)} times the tolerance"


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
        case "tool" if of not in ("point", "direction"):
            return f"Look how the laser is mounted, correct tool.direction to {of} if it is so, {_AGAIN}."
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
                f"Compare {_called(explanation)} with the original record.{_readings(explanation.readings)}"
                f" Correct {again} and import again, measure {again} again, or analyse without {again}."
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
            estimated = "so that the links are estimated"
            return f"Remove geometry: exact from the header ({_WHERE}), {estimated}, {_AGAIN}."
        case "geometry":
            larger = f"geometry.tolerance {times(explanation.amount)} times as large"
            return f"State {larger} in the header ({_WHERE}) if this arm is that far off, {_AGAIN}."
        case "gravity":
            return (
                f"State geometry.gravity_deg {times(explanation.amount)} times as large in the header"
                f" ({_WHERE}) if this arm deflects so much, {_AGAIN}."
            )
        case "harmonics":
            return (
                f"State geometry.harmonics_deg {times(explanation.amount)} times as large in the header"
                f" ({_WHERE}) if its gears are so far off, {_AGAIN}."
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
        return f" If one joint value is wrong, it is most likely that of J{one.joint} ({_instead(one)})."
    each = [f"J{one.joint} ({_instead(one)})" for one in readings]
    return (
        f" If one joint value is wrong, it may be that of {listed(each, last='or')}: the measurements do not"
        " decide which."
    )


def _instead(one: Misreading) -> str:
    recorded = numbers.exact(one.recorded)
    fitted = numbers.estimate(one.fitted, one.u, one.unit)
    text = f"{fitted} ± {numbers.spread(2 * one.u, one.unit)} instead of {recorded}"
    if one.meant is None:
        return text
    return f"{text}; {one.meant.replace('-', numbers.MINUS)} mistyped as {recorded}?"


def _numbers(explanation: Explanation) -> str:
    return listed([str(n) for n in explanation.measurements], MOST_MEASUREMENTS)


UNVALIDATED = "no estimate or uncertainty of this run is validated"
_MOST_NAMED = 8
_MOST_ALTERNATIVES = 3
_NEVER = 1e-12  # a p-value below this says nothing more: no noise is so normal
_LEVEL = f"{100 * (1 - 2 * LACK_OF_FIT):.1f} %"
_NOISE = {"all": "estimated noise", "joint": "estimated noise of the joints", "spot": "estimated spot noise"}


def criterion_sentence(criterion: Criterion, name: Namer = str) -> str:
    """One criterion, without a full stop at its end; `name` writes names."""
    match criterion:
        case LackOfFit(with_priors=True):
            return (
                f"Residuals and priors together are larger than noise and priors allow (χ²"
                f" {criterion.chi2:.0f}, {criterion.dof} dof, {p_words(criterion.p_value)}): noise, priors or"
                " geometry are not as stated, or the best fit was not found. Add measurements, so that it"
                " can be checked"
            )
        case LackOfFit():
            rms = "" if criterion.rms_mm is None else f"; {criterion.rms_mm:.2f} mm rms"
            by_links = criterion.geometry == "estimated"  # χ² has what links are off, too
            explained = "what noise and tolerances allow" if by_links else "the stated noise"
            return (
                f"Lack of fit: residuals are {times(criterion.factor)} times {explained}"
                f" (χ² {criterion.chi2:.0f}, {criterion.dof} dof, {p_words(criterion.p_value)}{rms}): the"
                f" {criterion.geometry} geometry does not describe this arm, a column, sign, zero, unit,"
                " target or measurement is not as stated, or the noise is understated"
            )
        case ImplausibleNoise(of, factor, interval, plausible):
            low, high = (times(end) for end in interval)
            bound = f"{plausible:g} times" if factor > 1 else f"1/{plausible:g} of"
            side = "above" if factor > 1 else "below"
            return (
                f"The {_NOISE[of]} is {times(factor)} times the stated ({_LEVEL} interval {low} to {high}),"
                f" {side} the {bound} that noise.plausible_factor allows: the model does not describe these"
                " measurements, or the stated noise is wrong"
            )
        case BeyondPrior(parameters, limit):
            named, one = (
                listed([_off(parameter, name) for parameter in parameters], _MOST_NAMED),
                len(parameters) == 1,
            )
            return (
                f"{named} {'is' if one else 'are'} beyond {limit:g} prior standard deviations: the model does"
                f" not describe this arm, or {'this prior is' if one else 'these priors are'} too narrow"
            )
        case NominalContradicted():
            return (
                "The nominal geometry does not describe this arm: links within typical tolerances explain"
                f" {times(criterion.factor)} times the remaining scatter (F({criterion.rank},"
                f" {criterion.dof}), {p_words(criterion.p_value)}). With links the residuals are"
                f" {times(criterion.after)} times the stated noise instead of {times(criterion.before)}"
            )
        case TightPrior():
            largest = numbers.significant(criterion.estimate, 2, criterion.unit)
            by = "assumed" if criterion.assumed else "stated"
            return (
                f"The {by} tolerance of {tolerance_words(criterion, name)} is too small: the estimates"
                f" (up to {largest}, {name(criterion.largest)}) are larger than it allows (χ²"
                f" {criterion.chi2:.0f}, {criterion.dof} dof, {p_words(criterion.p_value)}). It would have to"
                f" be {needed_words(criterion)}"
            )
        case PlacementsDisagree():
            count = len(criterion.placements)
            return (
                f"The placements disagree: the offsets that each of the {count} would have alone differ by"
                f" {times(criterion.factor)} times what the scatter within them explains (F({criterion.rank},"
                f" {criterion.dof}), {p_words(criterion.p_value)}), most of all at {criterion.most}: the"
                f" {criterion.geometry} geometry does not describe this arm, or a placement is wrong"
            )
        case Displacement():
            return displacement_sentence(criterion)
        case RecordingStep():
            return step_sentence(criterion)
        case RepeatsApart(again=again, size_mm=size):
            apart = f"{repeats_disagree(again)}: they are {numbers.significant(size, 2, 'mm')} apart"
            return (
                f"{apart} ({p_words(criterion.p_value)}). Something changed during the run, or one of the"
                " readings is wrong, or the noise is understated"
            )
        case RunChange(p_value=p_value, elsewhere=elsewhere):
            if not elsewhere:
                return f"It seems that {change_words(criterion)} ({p_words(p_value)})"
            others = [change_words(one) for one in elsewhere[:_MOST_ALTERNATIVES]]
            return (
                f"Something changed during the run ({p_words(p_value)}), and the measurements do not decide"
                f" what: {', or '.join([change_words(criterion), *others])}"
            )


_TOLERANCES = {
    "length": ("the links' lengths", "geometry.tolerance.length_mm"),
    "angle": ("the links' angles", "geometry.tolerance.angle_deg"),
    "gravity": ("deflection under gravity", "geometry.gravity_deg"),
    "harmonics": ("the first harmonics", "geometry.harmonics_deg"),
}


def tolerance_words(prior: TightPrior, name: Namer = str) -> str:
    """What has the tolerance."""
    return _TOLERANCES[prior.of][0] if prior.of in _TOLERANCES else name(prior.of)


def needed_words(prior: TightPrior) -> str:
    """What the tolerance would have to be."""
    factor = f"{times(prior.times)} times as large"
    if prior.needed is None or prior.stated is None:
        return factor
    needed, tolerance = numbers.significant(prior.needed, 2, prior.unit), numbers.exact(prior.stated)
    return f"{needed} instead of {numbers.with_unit(tolerance, prior.unit)} ({factor})"


def larger_tolerance(prior: TightPrior) -> str:
    """What to do about it, as a sentence."""
    key = _TOLERANCES[prior.of][1] if prior.of in _TOLERANCES else f"the sigma of {prior.of}"
    value = "" if prior.needed is None else f" {numbers.significant(prior.needed, 2)}"
    colon = ":" if prior.of in _TOLERANCES and value else ""
    if not value:
        value = f" {times(prior.times)} times as large"
    known = "it is known that this arm deviates so much" if prior.assumed else "this arm deviates so much"
    return f"If {known}, state {key}{colon}{value} in the header ({_WHERE}), {_AGAIN}."


def misfit_headline(misfit: Misfit) -> str:
    """What is wrong, first of all; the first criterion, and what follows for the answer."""
    first = criterion_sentence(misfit.criteria[0]).removeprefix("Lack of fit: ")
    more = len(misfit.criteria) - 1
    also = f" {more} more {'criterion agrees' if more == 1 else 'criteria agree'}." if more else ""
    return f"{capital(first)}.{also} {capital(UNVALIDATED)}."


def displacement_sentence(moved: Displacement) -> str:
    """Which target moved, when and how far, without a full stop."""
    p_value = f"= {moved.p_value:.0e}" if moved.p_value > _NEVER else f"< {_NEVER:.0e}"
    others = [
        f"{point.target} moved between {point.after_shot} and {point.before_shot}"
        for point in moved.elsewhere[:_MOST_ALTERNATIVES]
    ]
    if moved.alone is not None:
        others.append(f"measurement {moved.alone} alone is wrong")
    doubt = f"; nearly as likely: {', or '.join(others)}" if others else ""
    return (
        f"{_moving(moved.target, moved.station)} seems to have moved{_by(moved)} between measurements"
        f" {moved.after_shot} and {moved.before_shot} (p {p_value}){doubt}"
    )


def _moving(name: str, station: bool) -> str:
    """A target, or an instrument that stands in the world: it moves relative to the arm."""
    return f"Instrument {clipped(name)}, or the arm's base," if station else f"Target {clipped(name)}"


def _by(moved: Displacement) -> str:
    if moved.size_mm is not None and moved.size_std_mm is not None:
        return f" by {moved.size_mm:.1f} ± {moved.size_std_mm:.1f} mm"
    along = [
        f"{shift:.1f} ± {std:.1f} mm along {axis}"
        for axis, shift, std in zip("xyz", moved.shift_mm, moved.std_mm, strict=True)
        if shift is not None and std is not None
    ]
    return f" by {' and '.join(along)}" if along else ""


def change_words(one: ChangeAt) -> str:
    """What changed, when and by how much."""
    what = clipped(str(one.target)) if one.joint is None else f"the zero of J{one.joint}"
    amount = numbers.estimate(one.amount, one.std, numbers.unit_of(one.unit))
    between = f"measurements {one.after_shot} and {one.before_shot}"
    if one.how == "drift":
        return f"{what} drifted by {amount} from measurement {one.after_shot} to {one.before_shot}"
    return f"{what} jumped by {amount} between {between}"


def step_sentence(step: RecordingStep) -> str:
    """Which measurements of a recording are off together, without a full stop."""
    shots = measurements(step.first_shot, step.last_shot)
    size = "" if step.size_mm is None else f" by {numbers.significant(step.size_mm, 2, 'mm')}"
    return (
        f"{_moving(step.target, step.station)} seems to have slipped: {shots} are off"
        f" the rest of its recording{size} ({p_words(step.p_value)}, Holm-adjusted)"
    )


def measurements(first: int, last: int) -> str:
    """Measurements from a number to another, by both."""
    return f"measurement {first}" if first == last else f"measurements {first} to {last}"


def repeats_disagree(again: Sequence[int]) -> str:
    """That what was measured `again` does not agree with the first time."""
    repeat, agree = ("repeats", "does") if len(again) == 1 else ("repeat", "do")
    shots = capital(measurements(again[0], again[-1]))
    return f"{shots} {repeat} earlier ones and {agree} not agree with them"


def _off(parameter: OffPrior, name: Namer) -> str:
    return (
        name(parameter.name)
        if parameter.stds is None
        else f"{name(parameter.name)} ({parameter.stds:+.1f})".replace("(-", f"({numbers.MINUS}")
    )


_LESS = 0.9  # of the residuals, above which it is the estimates that a cause explains


def explanation_sentence(tried: Explanation) -> str:
    """What is changed, and what that leaves: without a full stop."""
    left = f"{times(tried.factor)} times the noise instead of {times(tried.before)}"
    if _explains_estimates(tried):
        left = f"{_estimates_within(tried)}; residuals {times(tried.factor)} times the noise"
    return f"{changed(tried)}: {left}"


def _explains_estimates(tried: Explanation) -> bool:
    return tried.factor > _LESS * tried.before


def _estimates_within(tried: Explanation) -> str:
    return (
        f"the estimates are within {numbers.significant(tried.farthest, 2)} prior standard deviations"
        f" instead of {times(tried.farthest_before)}"
    )


def alternatives(explanations: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """Those between which the measurements do not decide, at most three: of more each cause once, the
    likeliest among them. Measurements that may be wrong come first: they are compared with the record at
    once."""
    rivals = sorted(undecided(explanations), key=lambda one: one.cause != "measurements")
    if len(rivals) <= _MOST_ALTERNATIVES:
        return tuple(rivals)
    causes = [one.cause for one in rivals]
    once = [one for k, one in enumerate(rivals) if one.cause not in causes[:k]]
    shown = [*once, *(one for one in rivals if one not in once)][:_MOST_ALTERNATIVES]
    return tuple(shown if explanations[0] in shown else [*shown[:-1], explanations[0]])


def cause_sentence(explanations: Sequence[Explanation]) -> str:
    """The best explanation of a misfit with its rivals, and what it leaves."""
    best, *rivals = explanations
    if open_ := alternatives(explanations):
        questions = [f"{CAUSES[one.cause]} ({changed(one)})" for one in open_]
        odds = [open_[0].odds / one.odds for one in open_]
        ratios = " : ".join(numbers.significant(each, 2) if k else "1" for k, each in enumerate(odds))
        evidence = f" (evidence {ratios})" if min(odds) >= 1 else ""  # else not in the order of it
        text = f"The measurements do not decide what is wrong: {', or '.join(questions)}{evidence}."
        return text if best.agrees else f"{text} None of these alone explains the residuals."
    left = f"the residuals are {times(best.factor)} times what is expected instead of {times(best.before)}"
    if _explains_estimates(best):
        left = _estimates_within(best)
    named = "Most likely" if best.agrees else "Closest"  # what leaves a misfit is not likely
    text = f"{named}: {CAUSES[best.cause]}. {capital(changed(best))} {left}."
    if best.links_of_an_exact_arm:
        text += " The arm was taken as exact (geometry: exact)."
    if rivals:
        next_best = f"{changed(rivals[0])} (evidence ratio {evidence_ratio(rivals[0])})"
        also = [changed(rival) for rival in rivals[1:]]
        text += f" Next best: {listed([next_best, *also], _MOST_ALTERNATIVES)}."
    return text if best.agrees else f"{text} That alone does not explain them."


def diagnosis_said(explanations: tuple[Explanation, ...]) -> str:
    """How far to trust the explanations of a result; there is at least one."""
    if not explanations[0].agrees:
        return "None of these alone explains the residuals to the noise: something else is wrong too."
    if undecided(explanations):
        return "The measurements do not decide between the first of these: check each. Nothing was applied."
    if len(explanations) > 1:
        return "The first is at least 20 times as likely as any other. Nothing was applied."
    return "No other cause that was tried is within an evidence ratio of 1:1000. Nothing was applied."


def evidence_ratio(rival: Explanation) -> str:
    """Of a rival to the best explanation: 1:40."""
    return f"1:{numbers.significant(max(1 / rival.odds, 1.0), 2)}"
