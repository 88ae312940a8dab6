"""A fleet in a history: models, arms and instruments together, by real results that are made other arms'."""

from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from arms_over_years import without_offset
from histories import a_result, write_result

from zerobeam.experiments.history.arm_history import ArmDrift, Rate, arm_drift
from zerobeam.experiments.history.fleet_drift import FleetDrift, fleet_drift
from zerobeam.experiments.history.stored_result import StoredResult, read_entry
from zerobeam.model.records import to_json
from zerobeam.reports.history.history_tables import drift_blocks, ends_words, fleet_blocks, rate_words
from zerobeam.reports.style.blocks import Block, Paragraph, Table


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> StoredResult:
    """A real result as a history gives it back."""
    path = write_result(tmp_path_factory.mktemp("one") / "result.json", a_result())
    own = read_entry(path, lambda sha256: None)
    names = [name for name in StoredResult.__dataclass_fields__ if name != "document_sha256"]
    return StoredResult(**{name: getattr(own, name) for name in names}, document_sha256=own.document_sha256)


def arm(
    one: StoredResult,
    serial: str,
    instruments: str,
    *,
    model: str = "irb1600",
    rate: float = 0.0,
    bias: float = 0.0,
) -> ArmDrift:
    """Quarterly results by instruments of one letter each; delta3 walks, and B is biased there."""
    random = np.random.default_rng([ord(letter) for letter in serial])
    alone = one.without_prior
    made, state = [], np.zeros(len(alone.names))
    for t, instrument in enumerate(instruments):
        values = random.multivariate_normal(state, np.array(alone.covariance))
        values[1] += bias * (instrument == "B")
        state[1] += rate * random.normal() / 2
        fields = {
            **one.__dict__,
            "serial": serial,
            "model": model,
            "without_prior": replace(alone, values=values.tolist()),
            "measured_at": datetime(2024, 1, 15) + t * timedelta(days=91),
            "instrument": instrument.replace(".", ""),
        }
        made.append(StoredResult(**fields))
    return arm_drift((serial, model), made, [], 0.5)


def texts(blocks: list[Block]) -> str:
    found = [own.text for own in blocks if isinstance(own, Paragraph)]
    for own in blocks:
        if isinstance(own, Table):
            found += [own.caption, *(" | ".join(cell.text for cell in row.cells) for row in own.rows)]
    return "\n".join(found)


@pytest.fixture(scope="module")
def mixed(one: StoredResult) -> tuple[list[ArmDrift], FleetDrift]:
    """Arms of one model that walk fast, one of another that a biased B measures, one with one result."""
    arms = [arm(one, f"fast {k}", "AABABA", rate=1.0) for k in range(4)]
    arms.append(arm(one, "slow", "ABABAB", model="kr6_r900", bias=0.15))
    arms.append(arm(one, "lone", "A", model="kr6_r900"))
    return arms, fleet_drift(arms)


@pytest.mark.long
def test_the_joint_that_walks_fast_is_named(mixed: tuple[list[ArmDrift], FleetDrift]) -> None:
    _, found = mixed
    assert [(own.model, own.offset) for own in found.models if own.drifts] == [("irb1600", "delta3")]
    (own,) = [own for own in found.models if own.drifts]
    assert own.median.interval95[0] < 1.0 < own.median.interval95[1]
    assert own.arms == 4
    assert found.too_few == 1
    assert {own.serial for own in found.arms} == {"fast 0", "fast 1", "fast 2", "fast 3", "slow"}


def test_the_biased_instrument_is_named_and_a_jump_says_so(mixed: tuple[list[ArmDrift], FleetDrift]) -> None:
    arms, found = mixed
    assert [(own.instrument, own.offset) for own in found.biases if own.alarm] == [("B", "delta3")]
    said = texts(list(fleet_blocks(found)))
    assert "B | A | J3" in said
    assert said.count("| differs") == 1
    assert said.count("| drifts") == 1
    assert "perhaps a bias: A and B" in said
    assert "not whose bias it is" in said
    assert "in common is never determined" in said
    suspected = [own for own in arms if any(jump.instruments for jump in own.jumps)]
    assert {own.serial for own in found.suspects} <= {own.serial for own in suspected}
    assert {own.biased for own in found.suspects} <= {("A", "B"), ("B", "A")}
    for own in suspected:
        assert "instrument changed, a possible cause: " in texts(list(drift_blocks(own)))


@pytest.mark.long
def test_an_instrument_that_measured_everything_is_not_determined(one: StoredResult) -> None:
    found = fleet_drift([arm(one, f"{k}", "AAA") for k in range(2)])
    assert found.biases == ()
    said = texts(list(fleet_blocks(found)))
    assert "Bias of A: not determined (" in said
    assert "It is the only instrument." in said
    apart = fleet_drift([arm(one, "0", "AAA"), arm(one, "1", "BB.B")])
    said = texts(list(fleet_blocks(apart)))
    assert "Biases between these are not determined" in said
    assert "A; B." in said
    assert "1 result without an instrument" in said


@pytest.mark.long
def test_arms_with_few_results_borrow_and_say_so(one: StoredResult) -> None:
    found = fleet_drift(
        [arm(one, "few", "AA"), *(arm(one, f"many {k}", "AAAAA", rate=1.0) for k in range(4))]
    )
    (few,) = [own for own in found.arms if own.serial == "few"]
    (own,) = [walk for walk in few.walks if walk.offset == "delta3"]
    assert own.borrowed
    assert own.shrunken.median > 1.5 * own.alone.median
    many = [
        walk for arm in found.arms for walk in arm.walks if arm.serial != "few" and walk.offset == "delta3"
    ]
    assert not any(walk.borrowed for walk in many)
    assert "Some rates of 1 arm (few) are known more by the other arms of the model" in texts(
        list(fleet_blocks(found))
    )


def test_an_offset_that_no_arm_determines_twice_is_not_known(one: StoredResult) -> None:
    alone = arm(one, "a", "A")
    base = alone.used[0]
    assert base.without_prior is not None
    later = replace(
        base,
        without_prior=without_offset(base.without_prior, "delta2"),
        measured_at=base.measured_at + timedelta(days=91),
    )
    found = fleet_drift([arm_drift(("a", "irb1600"), [base, later], [], 0.5)])
    (own,) = [own for own in found.models if own.offset == "delta2"]
    assert (own.arms, own.median, own.probability, own.drifts) == (0, None, None, False)
    assert "not known" in texts(list(fleet_blocks(found)))
    told = to_json(found)
    assert told["models"][0]["rate"] is None
    assert told["arms"][0]["offsets"][0]["rate"] is None


def test_a_rate_is_said_as_exactly_as_so_many_rates_say_it() -> None:
    ends = (0.00123, 0.0456)
    assert rate_words(Rate(0.0123, ends, 100.0), "deg") == "0.012°"
    assert ends_words(Rate(0.0123, ends, 100.0)) == "0.0012 to 0.046"
    assert rate_words(Rate(0.0123, ends, 20.0), "deg") == "0.01°"
    assert ends_words(Rate(0.0123, ends, 20.0)) == "0.001 to 0.05"
    assert ends_words(Rate(0.0123, (0.0123, 0.0123), 1.0)) == "too few rates agree"


def test_without_arms_there_is_nothing_to_say() -> None:
    assert list(fleet_blocks(fleet_drift([]))) == []
