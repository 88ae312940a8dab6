"""The languages whose positions are read, with their forms of poses, joints and configurations; and those of
which joints alone are read."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from ...model.arrays import Matrix
from ...model.kinematics.inverse import (
    Branch,
    abb_configuration,
    fanuc_configuration,
    is_abb_configuration,
    is_fanuc_configuration,
    is_kuka_turn,
    kuka_status,
    kuka_turn,
)
from ...model.kinematics.orientation import (
    from_abc,
    from_quaternion,
    from_rotation_vector,
    from_rpy,
    from_xyz,
    from_zyz,
)
from .as_reader import read_as
from .basic_readers import read_melfa, read_pacscript, read_spel
from .cobot_readers import read_drl, read_urscript
from .job_readers import read_fanuc, read_inform
from .krl_reader import read_krl
from .position import (
    NUMBER,
    BackupReading,
    FileReading,
    JointLanguage,
    PositionLanguage,
    SourceFile,
    is_computed,
    numbers_in,
)
from .rapid_reader import read_rapid
from .val3_reader import read_val3


def _is_abb(texts: Sequence[str], branch: Branch, joints: Matrix) -> bool:
    return is_abb_configuration(tuple(map(float, texts)), branch, joints)


def _abb(texts: Sequence[str], branch: Branch, joints: Matrix) -> Sequence[str]:
    return [str(each) for each in abb_configuration(branch, joints)]


def _is_kuka(texts: Sequence[str], branch: Branch, joints: Matrix) -> bool:
    status = int(texts[0]) & 7 == kuka_status(branch)
    return status and (len(texts) < 2 or is_kuka_turn(int(texts[1]), joints))


def _kuka(texts: Sequence[str], branch: Branch, joints: Matrix) -> Sequence[str]:
    status = int(texts[0]) & ~7 | kuka_status(branch)
    return [
        texts[0] if status == int(texts[0]) else str(status),
        *(str(int(each) & ~63 | kuka_turn(joints)) for each in texts[1:]),
    ]


def _is_fanuc(texts: Sequence[str], branch: Branch, joints: Matrix) -> bool:
    letters = " ".join(re.findall(r"[A-Z]", texts[0]))
    return is_fanuc_configuration(letters, tuple(int(turn) for turn in texts[1].split(",")), branch, joints)


def _fanuc(texts: Sequence[str], branch: Branch, joints: Matrix) -> Sequence[str]:
    letters, turns = fanuc_configuration(branch, joints)
    same = re.findall(r"[A-Z]", texts[0]) == letters.split()
    return [texts[0] if same else letters, ", ".join(map(str, turns))]


_SLACK = 1e-3  # deg by which a joint may be beyond a border that is stated for it


def _is_yaskawa(texts: Sequence[str], branch: Branch, joints: Matrix) -> bool:
    """///RCONF: no flip (R within 90 degrees of 180), lower arm, rear; R, T, S beyond half a turn."""
    no_flip, lower, rear, *beyond = (text == "1" for text in texts)
    folded = abs((float(joints[3]) + 180) % 360 - 180)
    flipped = folded > 90 - _SLACK if no_flip else folded < 90 + _SLACK
    turns = zip(beyond, np.abs(joints[[3, 5, 0]]).tolist(), strict=True)
    return (
        (lower, rear) == (branch.behind_arm, branch.behind)
        and flipped
        and all(value > 180 - _SLACK if far else value < 180 + _SLACK for far, value in turns)
    )


RAPID = PositionLanguage(
    "RAPID",
    "abb",
    (".mod", ".modx", ".prg", ".sys", ".sysx"),
    read_rapid,
    remark=r"![^\n]*",
    pose=from_quaternion,
    form="X,Y,Z,Q1,Q2,Q3,Q4",
    pose_decimals=(5, 5, 5, 9, 9, 9, 9),
    matches=_is_abb,
    configuration=_abb,
    null=frozenset({"tool0", "wobj0"}),
    mark=r"^\s*(?:MODULE\s|%%%)|\b(?:CONST|PERS|VAR)\s+(?:robtarget|jointtarget)\b",
)
KRL = PositionLanguage(
    "KRL",
    "kuka",
    (".src", ".dat", ".sub"),
    read_krl,
    remark=r";[^\n]*",
    pose=from_abc,
    form="X,Y,Z,A,B,C",
    matches=_is_kuka,
    configuration=_kuka,
    up=-1,
    mark=r"^\s*(?:GLOBAL\s+)?DEF(?:DAT|FCT)?\s+\S",
    beside=r"\$(?:config|machine)\.dat",
    frames_in="$config.dat",
)
FANUC = PositionLanguage(
    "TP",
    "fanuc",
    (".ls", ".va"),
    read_fanuc,
    pose=from_rpy,
    form="X,Y,Z,W,P,R",
    pose_decimals=(3,) * 6,
    joint_decimals=3,
    matches=_is_fanuc,
    configuration=_fanuc,
    padded=True,
    mark=r"^/PROG\b|\$POSREG\b|\$MNU(?:FRAME|TOOL)\b",
    beside=r"sysframe\.va|.*\.ls",
    frames_in="SYSFRAME.VA",
)


def _within_half_a_turn(texts: Sequence[str], branch: Branch, joints: Matrix) -> bool:
    """Of languages whose words for a configuration are not interpreted: it has no further turns."""
    return bool((np.abs(joints[[0, 3, 5]]) < 180 + _SLACK).all())


AS = PositionLanguage(
    "AS",
    "kawasaki",
    (".as", ".pg", ".lc", ".sy"),
    read_as,
    remark=r";[^\n]*",
    pose=from_zyz,
    form="X,Y,Z,O,A,T",
    null=frozenset({"null"}),
    up=-1,
    by_joint2=True,
    mark=r"^\.(?:PROGRAM|TRANS|JOINTS|SYSDATA|NETCONF)\b",
)
INFORM = PositionLanguage(
    "INFORM",
    "yaskawa",
    (".jbi", ".cnd"),
    read_inform,
    remark=r"'[^\n]*",
    pose=from_rpy,
    form="X,Y,Z,RX,RY,RZ",
    pose_decimals=(3, 3, 3, 4, 4, 4),
    joint_decimals=0,
    matches=_is_yaskawa,
    null=frozenset({"base"}),
    unit="pulse",
    mark=r"^/JOB\b",
    beside=r"(?:uframe|tool)\.cnd",
    frames_in="TOOL.CND and UFRAME.CND",
)
SPEL = PositionLanguage(
    "SPEL+",
    "epson",
    (".pts", ".prg"),
    read_spel,
    remark=r"'[^\n]*",
    pose=from_abc,
    form="X,Y,Z,U,V,W",
    matches=_within_half_a_turn,
    by_joint2=True,
    unpublished=True,
    beside=r".*",
    mark=r"^[ \t]*Function[ \t]+\w+|^[ \t]*Point\d+[ \t]*\{|^nNumberOfPoints=",
)
MELFA = PositionLanguage(
    "MELFA-BASIC",
    "mitsubishi",
    (".prg", ".mb4", ".mb5", ".mb6"),
    read_melfa,
    remark=r"'[^\n]*",
    pose=from_rpy,
    form="X,Y,Z,A,B,C",
    pose_decimals=(4,) * 6,
    joint_decimals=4,
    matches=_within_half_a_turn,
    null=frozenset({"0", "p_ntool"}),
    by_joint2=True,
    unpublished=True,
    mark=r"^[ \t]*(?:\d+[ \t]+)?(?:Mov|Mvs)[ \t]+[\w(]|^[PJ]\w*(?:\(\d+\))?=\([-+.\d]",
)


def _is_staubli(texts: Sequence[str], branch: Branch, joints: Matrix) -> bool:
    """lefty in front of axis 1; elbow and wrist have the signs of joints 3 and 5."""
    shoulder = "righty" if branch.behind else "lefty"
    signs = ["positive" if joints[i] >= 0 else "negative" for i in (2, 4)]
    return list(texts) == [shoulder, f"e{signs[0]}", f"w{signs[1]}"]


VAL3 = PositionLanguage(
    "VAL3",
    "staubli",
    (".dtx", ".pgx", ".pjx"),
    read_val3,
    remark=r"//[^\n]*",
    pose=from_xyz,
    form="X,Y,Z,RX,RY,RZ",
    matches=_is_staubli,
    null=frozenset({"world[0]", "flange[0]"}),
    by_joint2=True,
    beside=r".*",
    mark=r"<(?:Database|dataList)\b",
)
DRL = PositionLanguage(
    "DRL",
    "doosan",
    (".drl",),
    read_drl,
    remark=r"#[^\n]*",
    pose=from_zyz,
    form="X,Y,Z,A,B,C",
    null=frozenset({"base"}),
    by_joint2=True,
    case_sensitive=True,
    mark=r"\b(?:a?move(?:[jlc]|jx|s[jx]|b)|pos[jx]|set_tcp)\s*\(",
)
PACSCRIPT = PositionLanguage(
    "PacScript",
    "denso",
    (".pcs", ".pac"),
    read_pacscript,
    remark=r"'[^\n]*|(?i:\brem\b)[^\n]*",
    pose=from_rpy,
    form="X,Y,Z,RX,RY,RZ",
    matches=_within_half_a_turn,
    unpublished=True,
    mark=r"^[ \t]*(?:Sub|Program|Function)[ \t]+\w|^[ \t]*Move[ \t]+\w+[ \t]*,",
)
URSCRIPT = PositionLanguage(
    "URScript",
    "universal-robots",
    (".script", ".urp"),
    read_urscript,
    remark=r"#[^\n]*",
    pose=from_rotation_vector,
    form="X,Y,Z,RX,RY,RZ",
    pose_decimals=(9,) * 6,
    joint_decimals=9,
    null=frozenset({"base"}),
    unit="rad",
    mark=r"\b(?:move[jlpc]|get_inverse_kin|set_tcp)\s*\(",
)
LANGUAGES = (RAPID, KRL, FANUC, INFORM, AS, SPEL, MELFA, VAL3, DRL, PACSCRIPT, URSCRIPT)


_I, _M = re.IGNORECASE, re.MULTILINE
_VALUES = rf"(?P<values>[ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})+)[ \t]*"
_SIX = rf"(?P<values>[ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER}){{5}})(?![\w.])"
_ANY_SIX = re.compile(rf"(?<![\w.])(?<![-+]){_SIX}")
_ANY_LIST = re.compile(r"(?<=\()(?P<values>[^()\n]*(?:,[^()\n]*){5,})(?=\))")
_SLIM = re.compile(rf"^[ \t]*MOVEX[^()\n]*\bM1J[ \t]*,[ \t]*[PL][ \t]*,[ \t]*\({_VALUES}\)[^()\n]*$", _I | _M)
_LIST = re.compile(rf"^[ \t]*(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*\[{_VALUES}\][ \t\r]*$", _M)
_FLOATS = re.compile(
    rf"^[ \t]*float\[\][ \t]+(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*\{{{_VALUES}\}}[ \t\r]*$", _M
)
_LISTED = re.compile(
    r"^[ \t]*(?:float\[\][ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*"
    r"[\[{](?P<values>[^,=\n]*(?:,[^,=\n]*){5,})[\]}][ \t\r]*$",
    _M,
)
_CALL = re.compile(
    rf'\b(?P<word>PTP|Line|Change\w+)[ \t]*\((?:[ \t]*"(?P<how>[^"\n]*)"[ \t]*,)?[ \t]*\{{?{_SIX}'
)
_POSTURE = re.compile(r"zb_[pmv]\d", _I)


def _in_joints(file: SourceFile, entry: re.Match[str]) -> bool:
    """Whether an entry is joints: in TMscript where a motion, or its name in a plan's program, says so."""
    groups = entry.groupdict()
    if "word" in groups:
        return groups["word"] == "PTP" and file.text[slice(*entry.span("how"))] == "JPP"
    if entry.re is not _FLOATS:
        return True
    by_joints = rf'\bPTP[ \t]*\([ \t]*"JPP"[ \t]*,[ \t]*{entry["name"]}\b'
    return _POSTURE.match(entry["name"]) is not None or re.search(by_joints, file.text) is not None


def _read(every: re.Pattern[str], *entries: re.Pattern[str]) -> Callable[[BackupReading], None]:
    """Reads the values of entries; `every` text that looks like a position has to be one."""

    def read(reading: BackupReading) -> None:
        for file in reading.files:
            here, starts = FileReading(file, reading), set()
            for match in (match for entry in entries for match in entry.finditer(file.bare)):
                spans = numbers_in(match["values"], match.start("values"))
                at = spans[0][0]
                starts.add(at)
                label = match.groupdict().get("name") or here.inline(at)[1]
                axes = range(len(spans)) if _in_joints(file, match) else None
                if not (match.groupdict().get("word") or "").startswith("Change"):
                    here.add(at, f"{file.name}:{label}", label, spans, axes=axes)
            for match in _LISTED.finditer(file.bare):
                places = range(*match.span("values"))
                if starts.isdisjoint(places) and is_computed(match["values"]):
                    reading.made.append((file, file.line(places.start), match["name"]))
                    starts |= {*places}
            for match in every.finditer(file.bare):
                start = match.end("values") - len(match["values"].lstrip())
                if start not in starts:
                    here.unread(start, "this position is not understood")

    return read


SLIM = JointLanguage("SLIM", "nachi", (".slim",), _read(_ANY_LIST, _SLIM), remark=r"'[^\n]*")
TMSCRIPT = JointLanguage(
    "TMscript", "techman", (".tms",), _read(_ANY_SIX, _FLOATS, _CALL), remark=r"//[^\n]*|/\*[\s\S]*?\*/"
)
JOINT_LIST = JointLanguage(
    "joint list", "franka", (".py", ".txt"), _read(_ANY_SIX, _LIST), remark=r"#[^\n]*", unit="rad"
)
