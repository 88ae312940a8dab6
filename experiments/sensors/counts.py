"""What a PSD amplifier's counts mean (YAML, `zerobeam/psd-calibration/1`): its zero, gains and full light."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ...model.arrays import Matrix
from ...model.files.validation import Name, Positive, SourcedModel, read_model, refusal, tuple_of
from .psd import PAIR_LIGHT, PsdKind

CALIBRATION_SCHEMA: Literal["zerobeam/psd-calibration/1"] = "zerobeam/psd-calibration/1"

_ELECTRODES = "in the order x+, x-, y+, y-"


class PsdCalibration(SourcedModel):
    """The content of a calibration file: of one amplifier with one PSD and one laser."""

    schema_: Literal["zerobeam/psd-calibration/1"] = Field(
        alias="schema", description="kind and version of the file"
    )
    amplifier: Name = Field(description="the name by which the amplifier calls itself")
    dark_counts: Annotated[tuple[float, float, float, float], tuple_of(4)] = Field(
        description=f"mean counts of each electrode with the face covered, {_ELECTRODES}"
    )
    gains: Annotated[tuple[Positive, Positive, Positive, Positive], tuple_of(4)] = Field(
        description="what the counts of each electrode above dark are multiplied by to be alike for the same "
        f"current, {_ELECTRODES}"
    )
    full_light_counts: Positive = Field(
        description="sum of the four, dark taken off and gains applied, with the laser's full light on the "
        "centre of the face, less the same with the laser off"
    )
    lowest_counts: int = Field(description="the ADC's lowest count; a reading there is cut off")
    saturation_counts: Annotated[tuple[int, int, int, int], tuple_of(4)] = Field(
        description="highest count that each electrode can measure, of the ADC or of the amplifier before"
        " it, "
        f"{_ELECTRODES}"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for i, (dark, highest) in enumerate(zip(self.dark_counts, self.saturation_counts, strict=True)):
            if not self.lowest_counts < dark < highest:
                raise refusal(
                    f"the dark counts of electrode {i + 1} are not between its lowest and highest",
                    key=("dark_counts", i),
                    found=f"{dark:g}",
                    allowed=f"above {self.lowest_counts}, below {highest}",
                    remedy="raise the amplifier's zero, or correct lowest_counts and saturation_counts",
                )
        return self

    def currents(self, counts: Matrix, kind: PsdKind) -> Matrix:
        """(..., 4) shares of the laser's full light from counts (..., 4) as a `Psd` of this kind has them.

        Full light is a sum of `full_light_counts` here and of twice the `PAIR_LIGHT` there.
        """
        share = 2 * PAIR_LIGHT[kind] / self.full_light_counts
        return np.asarray((counts - self.dark_counts) * np.multiply(self.gains, share))

    def counts(self, currents: Matrix, kind: PsdKind) -> Matrix:
        """(..., 4) whole counts that the amplifier would send for currents (..., 4): `currents` backwards."""
        share = 2 * PAIR_LIGHT[kind] / self.full_light_counts
        counts = np.rint(currents / np.multiply(self.gains, share) + self.dark_counts)
        return np.clip(counts, self.lowest_counts, self.saturation_counts)

    def saturation(self, kind: PsdKind) -> float:
        """The largest current that every electrode can measure: a saturated one reads no less."""
        return float(self.currents(np.array(self.saturation_counts), kind).min())


def read_calibration(path: Path) -> PsdCalibration:
    """A calibration file, every key of it checked."""
    return read_model(PsdCalibration, path, CALIBRATION_SCHEMA)
