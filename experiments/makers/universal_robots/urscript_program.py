"""A plan as a URScript program (Universal Robots): movej, dialogues at each posture, the joints by textmsg.

PolyScope does not let a person jog while a program runs: the program itself turns a joint by the degrees that
are typed, or lets go for freedrive. `textmsg` prints six digits of a float; whole numbers it prints in full.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import LOG, LOG_PLAN, PlanStep, decimal, head_lines, made_for, short_hash, steps_of

AXES = 6
_ACCELERATION = 20.0  # deg/s2
_LARGEST_STEP = 10.0  # deg, of a typed rotation
_LISTENER = re.compile(r"(?P<host>[A-Za-z0-9][A-Za-z0-9.-]{0,252}):(?P<port>\d{1,5})")


def urscript_program(plan: Plan, motion: ProgramMotion) -> str:
    """Text of the program."""
    note = made_for(plan, "universal-robots", "a URScript program", AXES, "a URScript joint vector")
    if plan.robot.n != AXES:
        raise BadInput("a URScript joint vector has six joints", found=f"{plan.robot.n} joints")
    steps = steps_of(plan, motion)
    lines = [
        *(f"# {line}" for line in head_lines(plan, motion, note)),
        "# At each posture dialogues ask for the joint to turn and by how much, until the beam is on the",
        "# centre of the PSD; 0 records the joints in the log (textmsg), which zerobeam import",
        "# universal-robots reads.",
        "def zb_plan():",
        *_FUNCTIONS,
        f"  global zb_v = d2r({decimal(motion.speed)})",
        f"  global zb_a = d2r({decimal(_ACCELERATION)})",
        _opened(motion.listener),
        f'  zb_log("{LOG_PLAN} {short_hash(plan)}")',
        f'  first = request_integer_from_primary_client("Begin with posture (0 to {len(steps) - 1})")',
        *(line for step in steps for line in _visit(step, motion)),
        '  popup("All postures are recorded.", title="zerobeam", blocking=True)',
        "end",
    ]
    return "\n".join(lines) + "\n"


def _opened(listener: str | None) -> str:
    if listener is None:
        return "  global zb_heard = False"
    match = _LISTENER.fullmatch(listener)
    if match is None or not 0 < int(match["port"]) < 65536:
        raise BadInput(
            "--listener is not understood", found=listener, allowed="HOST:PORT, such as 192.168.0.10:50007"
        )
    return f'  global zb_heard = socket_open("{match["host"]}", {int(match["port"])}, "zb")'


def _visit(step: PlanStep, motion: ProgramMotion) -> Iterator[str]:
    yield f"  if first <= {step.number}:"
    blend = f", r={decimal(motion.zone / 1000, 3)}" if motion.zone else ""
    for row in step.via:
        yield f"    movej({_vector(row)}, a=zb_a, v=zb_v{blend})"
    yield f"    movej({_vector(step.joints)}, a=zb_a, v=zb_v)"
    target = one_line(step.target).replace("\\", "/").replace('"', "'")[:24]
    yield f'    zb_centre("{step.number}", "Posture {step.number}, {target}: ")'
    yield "  end"


def _vector(joints: tuple[float, ...]) -> str:
    return f"[{', '.join(f'd2r({decimal(value)})' for value in joints)}]"


_FUNCTIONS = f"""
  def zb_log(text):
    textmsg(text)
    if zb_heard:
      socket_send_line(text, "zb")
    end
  end
  def zb_centre(posture, title):
    centred = False
    while not centred:
      asked = str_cat(title, "joint to turn (1 to 6), 7: freedrive, 0: record")
      joint = request_integer_from_primary_client(asked)
      if joint == 0:
        sync()
        q = get_actual_joint_positions()
        m = [0, 0, 0, 0, 0, 0]
        i = 0
        while i < 6:
          m[i] = floor(r2d(q[i])*1000000+0.5)
          i = i + 1
        end
        zb_log(str_cat(str_cat("{LOG} ", posture), str_cat(" microdegrees ", to_str(m))))
        centred = True
      elif joint == 7:
        freedrive_mode()
        popup("Lead the arm by hand, then press Continue.", title="zerobeam", blocking=True)
        end_freedrive_mode()
      elif joint > 0 and joint < 7:
        by = request_float_from_primary_client(str_cat(title, "degrees to turn it by"))
        if norm(by) <= {_LARGEST_STEP:g}:
          goal = get_target_joint_positions()
          goal[joint-1] = goal[joint-1] + d2r(by)
          movej(goal, a=zb_a, v=zb_v)
          sleep(0.5)
        end
      end
    end
  end""".splitlines()[1:]
