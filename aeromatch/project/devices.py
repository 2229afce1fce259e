"""Section of a project file that names the recordings of a device: ``[devices.NAME]``."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Annotated

from pydantic import Field

from aeromatch.project.files import FlightFiles, OptionalFile
from flightmech.errors import UnknownName
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits


class DeviceSection(Strict):
    """``[devices.NAME]``: what the host of a training device recorded, judged as a model is."""

    recordings: FlightFiles = Field(
        description="Pattern of the recordings, or several; a recording has the name of its case.",
        examples=["device/*.csv"],
    )
    names: OptionalFile = Field(
        default=None,
        examples=["device/host.toml"],
        description="Name map of the recordings, when names, units or signs are not the canonical "
        "ones.",
    )
    start: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["0 s"],
        description="Instant of the recordings at the start of the window of their case; without "
        "it both clocks are one.",
    )
    master: OptionalFile = Field(
        default=None,
        examples=["master/results.nc"],
        description="Results of an earlier report, with which a recurrent test compares the "
        "device.",
    )
    recurrent_share: Annotated[float, Field(gt=0.0, le=1.0)] | None = Field(
        default=None,
        examples=[0.2],
        description="Criterion of the recurrent test: share of each tolerance; without it 0.2 "
        "before the edition of 2016, then 0.4.",
    )

    @property
    def files(self) -> list[Path]:
        """All files of the device."""
        return [*self.recordings.values(), *filter(None, (self.names, self.master))]

    def problems(self, position: str, cases: Collection[str]) -> Iterator[str]:
        """Yield what is wrong with the recordings of a device, for cases by name."""
        for name in self.recordings:
            if name not in cases:
                yield f"{position}.recordings: {UnknownName(name, cases, 'case')}"
        if self.recurrent_share is not None and self.master is None:
            yield f"{position}.recurrent_share: needs master, the report to compare with"
