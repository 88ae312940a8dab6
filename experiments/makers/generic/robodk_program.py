"""A plan as a Python program for RoboDK: MoveJ, a message at each posture, the joints into a text file.

RoboDK counts joint 3 as the robot's controller does (its limits of a FANUC are those of the pendant).
`Joints()` is that of the real robot where RoboDK drives it (RUNMODE_RUN_ROBOT); in a simulation it is the
commanded one, which is no measurement: such a log is marked as a rehearsal, and is not imported.
"""

from __future__ import annotations

from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..plan_programs import LOG, LOG_PLAN, REHEARSAL, head_lines, short_hash, steps_of


def robodk_program(plan: Plan, motion: ProgramMotion, name: str) -> str:
    """Text of the program; the log is called `name`.log."""
    rows = "".join(
        f"    ({step.number}, {step.target!a}, {list(map(list, step.via))}, {list(step.joints)}),\n"
        for step in steps_of(plan, motion)
    )
    linear = any(joint.kind == "prismatic" for joint in plan.robot.joints)
    return _PROGRAM.format(
        head="\n".join(line.replace("\\", "/").replace('"', "'") for line in head_lines(plan, motion, None)),
        rows=rows,
        log=ascii(f"{name}.log"),
        speed=motion.speed,
        zone=motion.zone if motion.zone else -1,
        plan=f"{LOG_PLAN} {short_hash(plan)}",
        posture=LOG,
        rehearsal=REHEARSAL,
        unit="deg",
        joints=plan.robot.n,
        slides="  # mm where a joint slides" if linear else "",
    )


_PROGRAM = '''"""
{head}

Run it in RoboDK, connected to the robot, in the mode Run on robot. At each posture a message waits: jog the
wrist by the pendant until the beam is on the centre of the PSD, then press OK. zerobeam import robodk reads
the log.
"""

from robodk.robolink import ITEM_TYPE_ROBOT, RUNMODE_RUN_ROBOT, Robolink

# Number, target, intermediate postures, joints in degrees{slides}.
POSTURES = [
{rows}]
LOG = {log}


def note(text):
    with open(LOG, "a") as log:
        log.write(text + "\\n")


rdk = Robolink()
robot = rdk.ItemUserPick("Robot of the plan", ITEM_TYPE_ROBOT)
if not robot.Valid() or len(robot.Joints().list()) < {joints}:
    raise SystemExit("no robot with {joints} joints was chosen")
real = rdk.RunMode() == RUNMODE_RUN_ROBOT
said = "{posture}" if real else "{rehearsal}"
robot.setSpeedJoints({speed})
robot.setRounding({zone})
note("{plan}")
for number, target, between, joints in POSTURES:
    for via in between:
        robot.MoveJ(via)
    robot.MoveJ(joints)
    robot.WaitMove()
    rdk.ShowMessage("Posture %d, %s: jog, beam on the centre of the PSD." % (number, target), True)
    values = robot.Joints().list()[:{joints}]
    note("%s %d {unit} %s" % (said, number, " ".join("%.6f" % value for value in values)))
rdk.ShowMessage("All postures are recorded: " + LOG, True)
'''
