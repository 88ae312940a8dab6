"""What the controller says when it refuses: HTTP status, return code, words.

The codes and their names are those of "Robot controller return codes" in the manual of Robot Web Services
(3HAC050973-001). Answers of RobotWare 6.16 have been published for a symbol, a resource or a signal that
there is not, an invalid argument, a start in the wrong state, mastership that another client holds and a
signal written in manual mode. Assumed, for want of anything public, are MODE_REJECT and NOT_HELD with their
status, and that HELD answers whatever needs what another client holds (it may be MASTER_REJECT, -1073445859,
as well: the rig knows both).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Code:
    """`status` is HTTP's; the name that the manual gives to the number is beside each."""

    status: int
    number: int
    words: str


NO_SUCH_SYMBOL = Code(400, -1073414146, "Symbol not found")  # SYS_CTRL_E_FAIL
NO_SUCH_RESOURCE = Code(404, -1073414146, "Resource not found")  # SYS_CTRL_E_FAIL
NO_SUCH_SIGNAL = Code(404, -1073445866, "Invalid IO signal name")  # SYS_CTRL_E_UNRESOLVED_URL
INVALID_ARGUMENT = Code(400, -1073445879, "Invalid argument")  # SYS_CTRL_E_INVALIDARG
# SYS_CTRL_E_EXEC_STATE
EXECUTION_STATE = Code(400, -1073442809, "Operation not allowed for current PGM state")
# SYS_CTRL_E_MODE_REJECT
MODE_REJECT = Code(403, -1073445860, "Operation not allowed in this operation mode")
REJECTED = Code(403, -1073445881, "Rejected")  # SYS_CTRL_E_REJECT
# SYS_CTRL_E_RESOURCE_HELD
HELD = Code(403, -1073445862, "Requested resource is held by someone else")
NOT_HELD = Code(403, -1073445880, "Resource is not held")  # SYS_CTRL_E_RESOURCE_NOT_HELD


class RequestRefused(Exception):
    """A request that the controller does not carry out."""

    def __init__(self, code: Code, why: str = "") -> None:
        self.code = code
        # The real one puts the place in its source before the words, and the code behind them.
        words = f"{code.words}: {why}" if why else code.words
        self.message = f"{words} code:{code.number} icode:-1"
        super().__init__(self.message)
