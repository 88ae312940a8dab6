"""What a judgement says: its verdict, its sentence, and the reason of one parameter."""

from zerobeam.analysis.observability.causes import cause_for
from zerobeam.analysis.observability.identifiability import Identified
from zerobeam.analysis.status import Status, Verdict, verdict_of
from zerobeam.model.likelihood.parameters import Parameter
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.observability import reason
from zerobeam.words.plan_catalogue import determined_because


def verdict(problem: Problem, identified: Identified) -> Verdict:
    return verdict_of(identified.status[problem.parameters.block("offset")])


def reason_for(identified: Identified, item: Parameter, status: Status) -> str | None:
    cause = cause_for(identified.facts.null_space, item, status)
    return None if cause is None else reason(cause)


class _Row:
    def __init__(self, item: Parameter, status: Status) -> None:
        self.name, self.group, self.status = item.name, item.group, status


def sentence_of(problem: Problem, identified: Identified) -> str:
    rows = [
        _Row(item, status) for item, status in zip(problem.parameters.items, identified.status, strict=True)
    ]
    return determined_because(rows, identified.facts.null_space)
