"""Measurements of a plan without a robot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..analysis.covariance import parameter_among
from ..experiments.simulate import Truth, simulated_shots
from ..model.files.header import RUN_SCHEMA
from ..model.files.plan import Plan
from ..model.files.run import Run
from ..model.options import require_number
from ..words.provenance import SIMULATED
from .checked_arguments import require_mapping, require_plan


def simulate(
    plan: Plan, offsets: Mapping[str, float] | None = None, *, seed: int = 0, name: str = "simulated"
) -> Run:
    """Measurements of a plan as a simulated arm gives them, servoed onto the target and read with the noise
    that the plan states.

    Parameters
    ----------
    plan
        What is measured.
    offsets
        True values by name, such as {"J2": 0.3}, in degrees (mm for prismatic joints); other parameters, such
        as "tool.x", in their units. What is not named is nominal. None: random offsets of about 1 degree
        (1 mm), and random errors of an uncalibrated tool.
    seed
        Of the random numbers.
    name
        What reports call the run.

    Returns
    -------
    Run
        Its header's `provenance` states the true values.

    Raises
    ------
    BadInput
        There is no parameter of a name in `offsets`, or its value is not a finite number.
    RigFault
        From a posture the target cannot be met.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> good = zb.read_run(demo_runs()[0].path)
    >>> plan = zb.Plan.from_arrays(
    ...     robot="irb1600",
    ...     tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     postures=good.joints,
    ...     unit="rad",
    ...     noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ...     target_priors={"psd": {"guess_mm": (900, 0, 0)}},
    ... )
    >>> zb.simulate(plan, offsets={"delta2": 0.3}, seed=1)
    <Run simulated: 9 measurements of psd, irb1600>
    """
    require_plan(plan)
    require_number(seed, 0, "seed", whole=True)
    rng = np.random.default_rng(seed)
    if offsets is None:
        truth = Truth.drawn(plan, rng)
    else:
        require_mapping(offsets, "offsets", '{"J2": 0.3}: values in degrees (mm) by name')
        names, values = Truth.with_values(plan, {}).problem.parameters.names, {}
        for parameter, value in offsets.items():
            name_of_it = parameter_among(names, parameter, "offsets")
            require_number(value, -np.inf, f"offsets[{parameter!r}]")
            values[name_of_it] = value
        truth = Truth.with_values(plan, values)
    provenance = {**plan.header.provenance, "origin": SIMULATED, **truth.provenance()}
    header = plan.header.model_copy(update={"schema_": RUN_SCHEMA, "provenance": provenance})
    return Run.of_shots(header, plan.robot, list(simulated_shots(truth, rng)), name)
