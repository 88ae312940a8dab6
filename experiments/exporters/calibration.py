"""What of a run may be applied to a robot: the offsets that its shots tell, judged as by `analyse`."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from ...analysis.analyse import require_noise_data
from ...analysis.diagnostics.displacement import displacement, displacement_sentence
from ...analysis.diagnostics.notes import LACK_OF_FIT
from ...analysis.estimation.fit import AgainstNoise, LikelihoodFit, fit_likelihood
from ...analysis.observability.identifiability import Identified, identify_at
from ...analysis.observability.verdict import listed, reason_for
from ...analysis.result import Status, versions
from ...model.errors import BadInput, FitFailed
from ...model.files.reading import did_you_mean
from ...model.files.run import Run
from ...model.parameters import Parameter
from ...model.problem import Problem
from ...model.robot import JointKind

SEED = 0  # of the fit's starts, as of `analyse` unless asked for otherwise
MEANING = "true position = recorded position + offset"
_NORMAL_95 = 1.959963984540054  # half width of the central 95 % of a unit normal


@dataclass(frozen=True)
class Offset:
    """One joint's offset, `unit` deg or mm. `estimate`, `std`, `interval95` are None where nothing is known.

    `applied` is what an exported file adds to the recorded position: the estimate, or 0 where the offset is
    held or `left_out`. `joint` is the joint's name in its robot file, which may hold any character.
    """

    name: str
    joint: str
    kind: JointKind
    unit: str
    status: Status
    left_out: bool
    estimate: float | None
    std: float | None
    interval95: tuple[float, float] | None
    reason: str | None

    @property
    def exported(self) -> bool:
        return self.status in ("identified", "weak") and not self.left_out

    @property
    def applied(self) -> float:
        return (self.estimate or 0.0) if self.exported else 0.0

    @property
    def internal(self) -> float:
        """`applied` in rad or mm."""
        return float(np.radians(self.applied)) if self.kind == "revolute" else self.applied

    @property
    def sentence(self) -> str:
        """What a file says of it, in ASCII on one line."""
        if self.status == "held":
            told = f"HELD at 0, not estimated: {self.reason}"
        elif self.estimate is None:
            told = f"UNIDENTIFIABLE, left out: {self.reason}"
        else:
            told = f"{self.estimate:+.6f} {self.unit}, std {self.std:.2g} {self.unit}, "
            told += self.status if self.status == "identified" else "WEAK: known poorly only"
            told += ", LEFT OUT on request" if self.left_out else ""
        return one_line(f"{self.name} ({self.joint}): {told}")


@dataclass(frozen=True)
class Calibration:
    """All offsets of a robot in the order of its joints, and what they were made from."""

    offsets: tuple[Offset, ...]
    run: str
    sha256: str
    robot: str
    shots: int
    versions: dict[str, str]
    warnings: tuple[str, ...]

    @property
    def head(self) -> list[str]:
        """Short lines of ASCII with which a file says what it holds and where that is from."""
        lines = [
            one_line(f"zerobeam {self.versions['zerobeam']}: joint offsets of {self.robot}"),
            one_line(f"from the run {self.run}, {self.shots} shots"),
            f"sha256 of the run: {self.sha256}",
            "applied by, on: ______________________",
            f"{MEANING}. An offset that is held or left out counts as 0.",
            *(offset.sentence for offset in self.offsets),
            *(one_line(f"note: {sentence}") for sentence in self.warnings),
        ]
        return [row for line in lines for row in textwrap.wrap(line, 100, subsequent_indent="    ")]


def one_line(text: str) -> str:
    """Text that may hold any character, as ASCII on one line; control and other characters as escapes."""
    told = text.replace("±", "+-")
    return re.sub(r"[^ -~]", lambda found: found.group().encode("unicode_escape").decode(), told)


def calibration(
    run: Run, *, allow_weak: bool = False, allow_displaced: bool = False, without: Sequence[str] = ()
) -> Calibration:
    """The offsets of a run, ready to be applied; `without` are names of offsets to leave out.

    BadInput where an offset is unidentifiable, or weak and not allowed to be, and not left out; where the
    shots contradict the model, in which case no status can be relied on; where nothing is left to apply.
    That a target seems to have moved may be allowed: then it stands among the warnings. FitFailed where the
    fit did not converge.
    """
    # One thread, as in `analyse`: the last bits depend on it.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            return _calibration(run, allow_weak, allow_displaced, without)
        except BadInput as error:
            raise error.at(run.path, run.header_line) from error


def _calibration(run: Run, allow_weak: bool, allow_displaced: bool, without: Sequence[str]) -> Calibration:
    run.require_analysable()
    problem = Problem.from_run(run)
    require_noise_data(problem)
    fit = fit_likelihood(problem, seed=SEED)
    if not fit.converged:
        raise FitFailed(
            f"{run.path}: the fit did not converge ({fit.reason}): nothing can be exported\n"
            "  to do:   look at the run with zerobeam analyse; record more shots, in varied postures"
        )
    identified = identify_at(fit)
    std = problem.parameters.unscaled(fit.std)
    against = fit.against_noise(identified.facts.rank)
    dof = against.dof
    _require_consistent(fit, against)
    moved = _displaced(fit, allow_displaced)
    quantile = float(stdtrit(dof, 0.975)) if problem.noise.estimated and dof > 0 else _NORMAL_95
    block = problem.parameters.block("offset")
    names = problem.parameters.names[block]
    _check_without(without, problem.parameters.items[block])
    offsets = []
    for i, joint in enumerate(run.robot.joints):
        item, status = problem.parameters.items[i], identified.status[i]
        known = status in ("identified", "weak")
        value, half = float(fit.x[i]), quantile * float(std[i])
        offsets.append(
            Offset(
                name=item.name,
                joint=joint.name,
                kind=joint.kind,
                unit=item.unit,
                status=status,
                left_out=names[i] in without,
                estimate=item.shown(value) if known or item.held else None,
                std=item.shown_std(value, float(std[i])) if known else None,
                interval95=(item.shown(value - half), item.shown(value + half)) if known else None,
                reason=reason_for(identified, item, status),
            )
        )
    _require_told(offsets, identified, allow_weak)
    return Calibration(
        tuple(offsets),
        run.path.name,
        run.sha256,
        run.robot.name,
        problem.shots,
        versions(),
        (*moved, *run.warnings),
    )


def _require_consistent(fit: LikelihoodFit, against: AgainstNoise) -> None:
    """BadInput where estimates and stds may not be relied on although the fit converged.

    There is no option to go on: with noise that is understated no status means anything, and the run's header
    can state it as it is.
    """
    if against.p_value is not None and against.p_value < LACK_OF_FIT:
        raise BadInput(
            "the shots contradict the model, so no offset can be relied on",
            found=f"misses {np.sqrt(against.chi2 / against.dof):.1f} times what the stated noise explains",
            allowed=f"misses as large as these with a chance of at least {LACK_OF_FIT:g}",
            remedy="look for the cause with zerobeam report (a shot or target that is off, geometry, play);"
            " or state the noise as it is: noise.scale: estimated in the header widens all intervals",
        )
    if fit.other_basins:
        raise BadInput(
            "the shots do not tell which of several sets of offsets is the true one",
            found=f"{fit.other_basins} more fitting nearly as well",
            remedy="record more shots, in varied postures",
        )


def _displaced(fit: LikelihoodFit, allowed: bool) -> tuple[str, ...]:
    """The sentence that a target seems to have moved, if so; BadInput where that is not allowed.

    An arm whose geometry is not quite as drawn can look like that too, and no new run would mend it: so it
    can be allowed, but not unnoticed.
    """
    moved = displacement(fit)
    if moved is None or not moved.significant:
        return ()
    if not allowed:
        raise BadInput(
            "the shots contradict the model, so no offset can be relied on",
            found=displacement_sentence(moved),
            remedy="give the target another name in the shots after it was moved, or record anew; or"
            " --allow-displaced, if it was not moved: the file then says so",
        )
    return (displacement_sentence(moved),)


def _check_without(without: Sequence[str], items: Sequence[Parameter]) -> None:
    free = [item.name for item in items if not item.held]
    for name in without:
        if name not in free:
            raise BadInput(
                "--without names an offset that is not estimated",
                found=name,
                allowed=", ".join(free) or "none: all are held",
                remedy=did_you_mean(name, free),
            )


def _require_told(offsets: Sequence[Offset], identified: Identified, allow_weak: bool) -> None:
    def named(status: Status) -> list[Offset]:
        return [offset for offset in offsets if offset.status == status and not offset.left_out]

    unknown, weak = named("unidentifiable"), named("weak")
    if unknown:
        raise BadInput(
            f"{listed([offset.name for offset in unknown])} cannot be exported: the data do not tell",
            found="; ".join(f"{offset.name}: {offset.reason}" for offset in unknown),
            allowed="identified offsets, and weak ones with --allow-weak",
            remedy=f"record shots that tell, or leave out by name: {_leaving_out(unknown)}",
        )
    if weak and not allow_weak:
        raise BadInput(
            f"{listed([offset.name for offset in weak])} cannot be exported as known: the data tell little",
            found="; ".join(
                f"{offset.name}: std {offset.std:.2g} {offset.unit} ({offset.reason})" for offset in weak
            ),
            allowed="identified offsets, and weak ones with --allow-weak",
            remedy=f"record more shots; or --allow-weak; or leave out by name: {_leaving_out(weak)}",
        )
    if not any(offset.exported for offset in offsets):
        raise BadInput(
            "there is nothing to export: every offset is held or left out",
            found="; ".join(offset.sentence for offset in offsets),
        )


def _leaving_out(offsets: Sequence[Offset]) -> str:
    return " ".join(f"--without {offset.name}" for offset in offsets)
