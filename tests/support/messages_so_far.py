"""What a run says while its measurements are being made."""

from zerobeam.analysis.solution import Solution
from zerobeam.model.files.header import Header
from zerobeam.words.case import RunCase
from zerobeam.words.entries import Message
from zerobeam.words.message import message_of_run


def message_so_far(solution: Solution, run: str, header: Header) -> Message:
    """The message of what was measured, of a run of that name."""
    return message_of_run(RunCase.so_far(solution, run, header.model_dump(mode="json")))
