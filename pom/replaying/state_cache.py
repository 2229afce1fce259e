"""Reconstructed records kept next to the flights of a batch, so that an interrupted one does not reconstruct them again."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path

import h5py
import xarray as xr

import flightmech
import flighttest
from flightmech.support.atomic_write import written_atomically
from flightmech.support.kept_stages.content_hashes import content_hash
from flighttest.records.plain_groups import plain_group

from ..cases.case import PomCase
from .reference_states import recorded_states


@dataclass(frozen=True)
class KeptStates:
    """Reconstructed states of raw records.

    Attributes
    ----------
    folder : Path or None
        Keeps them under the hash of the record, of its name map, of the aircraft with all that its file names, of the biases and of
        the programs that reconstruct; without it nothing is kept.
    biases : Dataset or None
        Constants of the instruments (`recorded_states`).
    """

    folder: Path | None
    biases: xr.Dataset | None
    _aircraft: dict[str, flightmech.Aircraft] = field(default_factory=dict, repr=False)  # read once in a batch

    def read(self, case: PomCase) -> xr.Dataset | None:
        """Return the states of the record of a case; None when they are not kept."""
        file = self._file(case)
        if file is None or not file.is_file():
            return None
        with h5py.File(file, "r") as content:
            states = plain_group(content)
        return xr.load_dataset(file, engine="h5netcdf") if states is None else states

    def make(self, case: PomCase) -> xr.Dataset:
        """Reconstruct the record of a case and keep its states.

        Raises
        ------
        SchemaError, IdentificationError
            As `recorded_states`.
        """
        states, file = recorded_states(case, self.biases), self._file(case)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with written_atomically(file) as part:
                states.to_netcdf(part, engine="h5netcdf")
        return states

    def identity(self, case: PomCase) -> str:
        """Return the hash of all that the states of the record of a case come from, but for the windows of its cases."""
        if case.aircraft and case.aircraft not in self._aircraft:
            self._aircraft[case.aircraft] = flightmech.read_aircraft(case.aircraft)
        files = [hashlib.sha256(Path(name).read_bytes() if name else b"").hexdigest() for name in (case.record, case.names)]
        return content_hash(program(), files, self._aircraft.get(case.aircraft), self.biases)

    def _file(self, case: PomCase) -> Path | None:
        if self.folder is None or not case.aircraft:
            return None
        return self.folder / "states" / f"{self.identity(case)}.nc"


@cache
def program() -> str:
    """Return the hash of the modules that read and reconstruct, with the versions of the libraries they count with."""
    digest = hashlib.sha256()
    for package in (flightmech, flighttest):
        folder = Path(str(package.__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.read_bytes())
    return " ".join([digest.hexdigest(), *(f"{name} {version(name)}" for name in ("numpy", "scipy", "xarray"))])
