"""An arm's file against poses of its pendant, in sentences: what agrees, and which entry does not."""

from __future__ import annotations

from ..analysis.pendant_check.pose_check import EntryChange, PendantCheck
from ..model.arrays import Matrix
from ..model.kinematics.orientation import orientation
from . import numbers
from .numbers import MINUS
from .wording import counted, listed

_FORMS: dict[str, str] = {
    "quaternion": "quaternion",
    "abc": "A, B, C of KUKA (about z, y, x)",
    "wpr": "W, P, R (about fixed x, y, z)",
    "rotation-vector": "rotation vector",
    "xyz": "Rx, Ry, Rz of Stäubli (about x, the new y, the new z)",
    "zyz": "O, A, T (about z, the new y, the new z)",
}
_FROM = {"link": "link 2", "ground": "the ground"}
_NEAR = 0.02  # share of a value by which two are the same but for their sign or unit


def check_sentences(check: PendantCheck) -> list[str]:
    """The verdict, then what follows, a sentence or two each."""
    poses = counted(len(check.deviations), "pose")
    if check.agrees:
        return [_agreement(check, poses), *_unchecked(check)]
    if not check.suspects:
        return ["The file disagrees with the pendant.", *_without_suspect(check)]
    lines = [change_sentence(change) for change in check.suspects]
    few = "" if len(check.deviations) > 1 else " One pose determines little: add one at another posture."
    if len(lines) == 1:
        return [f"The file disagrees with the pendant. If one entry is wrong, it is this:{few}", *lines]
    if check.same_arm:
        head = "If one entry is wrong, it is one of these; each makes the same arm:"
    else:
        head = (
            "If one entry is wrong, it is one of these; these postures do not distinguish them, another will:"
        )
    return [f"The file disagrees with the pendant. {head}{few}", *lines]


def change_sentence(change: EntryChange) -> str:
    """Which entry is wrong, and what it would have to be."""
    entry, old, new = change.entry, change.old, change.new
    match change.kind:
        case "value" if isinstance(old, float | int) and isinstance(new, float | int):
            return _value(change, float(old), float(new))
        case "swap":
            return f"{entry} are exchanged."
        case "convention":
            return f"convention: the rows are {new}, not {old}."
        case "metres":
            return f"{entry} are in {new}, not in {old}."
        case "radians":
            return f"{entry} are in {new}, not in {old}."
        case "order":
            return f"{entry}: they are {new}, not {old}."
        case "joint3":
            return f"{entry}: joint 3 is counted from {_FROM[str(new)]}, not from {_FROM[str(old)]}."
        case "sign":
            return (
                f"{entry}: the joint moves the other way. Add 180° to the twist (alpha_deg; of joint 1"
                " base.rpy_deg) before it and to that behind it, and reverse the signs of its d_mm and"
                " theta_deg."
            )
        case "exchange":
            return f"{entry}: the pendant shows them in the other order (pendant: {{order: …}})."
    right, wrong = (_FORMS.get(str(side), str(side)) for side in (new, old))
    return f"{entry}: they are {right}, not {wrong}. The file may be right."


def _value(change: EntryChange, old: float, new: float) -> str:
    entry, bound, unit = change.entry, change.bound, change.unit
    right, wrong = numbers.exact(round(new, 3), unit), numbers.exact(round(old, 3), unit)
    within = f" ± {numbers.significant(bound, 1, unit)}" if bound > (0.05 if unit == "mm" else 0.005) else ""
    scale = abs(new)
    if old and abs(old + new) <= max(_NEAR * scale, bound):
        why = f"has the wrong sign: {right} agrees, {wrong} does not"
    elif not old:
        why = f"is missing: {right}{within} agrees, {wrong} does not"
    elif unit == "mm" and abs(1000 * old - new) <= max(_NEAR * scale, bound):
        why = f"is in metres: {right}{within} agrees"
    elif unit == "deg" and abs(57.29578 * old - new) <= max(_NEAR * scale, bound):
        why = f"is in radians: {right} agrees"
    else:
        why = f"is {wrong}; {right}{within} agrees"
    return f"{entry} {why}.{_alike(entry)}"


def _alike(entry: str) -> str:
    if "flange" in entry or "of the tip" in entry:
        return " A tool that is active on the pendant has the same effect: select none."
    if "base" in entry:
        return " Another base frame that is selected on the pendant has the same effect."
    return ""


def _agreement(check: PendantCheck, poses: str) -> str:
    worst_mm = max(each.place_mm for each in check.deviations)
    worst_deg = max(each.angle_deg for each in check.deviations)
    allowed_mm = max(each.allowed_mm for each in check.deviations)
    allowed_deg = max(each.allowed_deg for each in check.deviations)
    return (
        f"The file agrees with the {poses} of the pendant: within {_size(worst_mm, 'mm')} and"
        f" {_size(worst_deg, 'deg')}; the digits that are shown allow {_size(allowed_mm, 'mm')} and"
        f" {_size(allowed_deg, 'deg')}."
    )


def _size(value: float, unit: str) -> str:
    return numbers.with_unit(numbers.fixed(value, 3 if unit == "deg" else 2), unit)


def _unchecked(check: PendantCheck) -> list[str]:
    entries = check.unchecked_entries
    if not entries:
        return []
    return [
        f"These postures do not check: {listed(entries, 12)}. Add a posture in which all joints have"
        " different values, none 0."
    ]


def _without_suspect(check: PendantCheck) -> list[str]:
    lines = []
    if check.tool is not None:
        lines.append(
            f"A tool that is active on the pendant explains it: {_frame(check.tool)}. Select none and read"
            " the poses again; if none was active, this is what the flange of the file lacks (flange: …)."
        )
    if check.frame is not None:
        lines.append(
            f"Another base frame that is selected on the pendant explains it: {_frame(check.frame)}. Select"
            " that of the robot and read the poses again; else the base of the file lacks this (base: …)."
        )
    return lines or [
        "No change of one entry explains it: two entries or more are wrong, or a pose belongs to other joint"
        " values."
    ]


def _frame(pose: Matrix) -> str:
    position = ", ".join(numbers.fixed(value, 1) for value in pose[:3, 3].tolist())
    turns = ", ".join(numbers.fixed(value, 2) for value in orientation(pose[:3, :3]).roll_pitch_yaw)
    return f"xyz_mm: [{position}], rpy_deg: [{turns}]".replace(MINUS, "-")
