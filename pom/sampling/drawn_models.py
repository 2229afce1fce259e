"""Models drawn from the posterior of a database."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
from flightmech import SimModel
from flightmech.errors import SchemaError
from flightmech.simulation import table_values, with_table_values

from ..archive.origins import sha256
from ..judging.evidence import flown_model
from .instruments import standard_normal


@dataclass(frozen=True)
class DrawnModels:
    """Models whose tables are drawn from the posterior of a database.

    Attributes
    ----------
    model : SimModel
        The model itself, as the FMU holds it.
    database : DataTree
        Terms with standard errors.
    nodes : dict of str to array (draw, *axes)
        Drawn values by term.
    seed : int
    source : str
        What the database is called in the results.
    """

    model: SimModel
    database: xr.DataTree
    nodes: dict[str, np.ndarray]
    seed: int
    source: str

    @classmethod
    def of(cls, fmu: str | Path, database: str | Path | xr.DataTree, count: int, seed: int = 0) -> DrawnModels:
        """Return draws for a model.

        Parameters
        ----------
        fmu : path
            Of this program; its tables are exchanged.
        database : path or DataTree
            The database from which the FMU was made, with standard errors.
        count : int
            Number of draws.
        seed : int

        Raises
        ------
        SchemaError
            An FMU of another program, a database without standard errors, or one whose values the FMU does not hold.
        """
        model = flown_model(fmu)
        if model is None:
            raise SchemaError(str(fmu), ["the FMU holds no tables of this program; samples need a model of `aeromatch`"])
        db = database if isinstance(database, xr.DataTree) else aerodb.open(database)
        called = str(db.attrs.get("title", "")) if isinstance(database, xr.DataTree) else _called(Path(database))
        common = {name: standard_normal(name, count, seed) for name in aerodb.update.common_errors(db)}
        nodes = aerodb.update.draw(db, count, seed, common=common)
        if not nodes:
            raise SchemaError(called, ["no term has standard errors, there is nothing to draw; give the identified database"])
        leaves = aerodb.terms(db)
        held = table_values(model, {name: leaves[name]["value"].shape for name in nodes})
        other = [name for name in nodes if not np.array_equal(held[name], leaves[name]["value"].values)]
        if other:
            text = f"{called}: {len(other)} terms have other values than in {fmu} ({', '.join(other[:3])}); give the database of this FMU"
            raise SchemaError("database of a model", [text])
        return cls(model, db, nodes, seed, called)

    @property
    def count(self) -> int:
        """Number of draws."""
        return len(next(iter(self.nodes.values())))

    @cached_property
    def models(self) -> list[SimModel]:
        """One model per draw."""
        return [with_table_values(self.model, {name: values[k] for name, values in self.nodes.items()}) for k in range(self.count)]


def _called(file: Path) -> str:
    return f"{file.name}, sha256 {sha256(file)}"
