"""A fit with what it was made from, and its text."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.support.console import plain

from ...remarks import Remark, documents, lines
from ..estimates_to_database import updated_database
from ..result import OutputError
from .specification import Specification

if TYPE_CHECKING:
    from flightmech import SimModel


POOR = 0.5  # of the variance of an output about its mean, that the model must explain
PULLED = 3.0  # prior standard errors by which an estimate may depart before it is reported


@dataclass(frozen=True)
class Performed:
    """A fit with what it was made from.

    Attributes
    ----------
    specification : Specification
    sim : SimModel
    records : tuple of Dataset
        The manoeuvres.
    fit : OutputError
    """

    specification: Specification
    sim: SimModel
    records: tuple[xr.Dataset, ...]
    fit: OutputError

    @property
    def explained(self) -> xr.DataArray:
        """Part of the variance of each output about its mean that the model explains, (manoeuvre, output)."""
        rows = [
            [1.0 - float((rest[name] ** 2).sum() / ((record[name] - record[name].mean()) ** 2).sum()) for name in rest.data_vars]
            for record, rest in zip(self.records, self.fit.residuals)
        ]
        names = list(self.fit.residuals[0].data_vars)
        return xr.DataArray(np.array(rows), {"manoeuvre": np.arange(1, len(rows) + 1), "output": names}, ("manoeuvre", "output"))

    @property
    def remarks(self) -> list[Remark]:
        """Remarks beyond `OutputError.remarks`: outputs that the model does not explain, estimates far from what was known."""
        found = []
        for (k, j), share in np.ndenumerate(self.explained.values):
            if share < POOR:
                name = self.explained["output"].values[j]
                words = f"record {k + 1}, {name}: the model explains {share:.0%} of its movement; a term is missing, or the record is wrong"
                found.append(Remark("unexplained", words, str(name), float(share), POOR))
        e = self.fit.estimates
        for name, value, start, sigma in zip(*(e[key].values for key in ("parameter", "estimate", "start", "prior_stderr"))):
            if abs(value - start) > PULLED * sigma:
                far = float(abs(value - start) / sigma)
                words = f"{name} lies {far:.1f} prior standard errors from {start:g}: check units, signs and model"
                found.append(Remark("prior", words, str(name), far, PULLED))
        return found

    def report(self) -> str:
        """Return estimates, noise, shares and remarks as text."""
        head = [self.specification.title] if self.specification.title else []
        text = [*head, self.fit.report(), "", "explained of each output's movement:"]
        width = max(len(name) for name in self.explained["output"].values)
        for name in self.explained["output"].values:
            text.append(f"  {name!s:{width}s}" + "".join(f"{float(x):9.1%}" for x in self.explained.sel(output=name)))
        return "\n".join([*text, *lines(self.remarks)])

    def as_dict(self) -> dict[str, Any]:
        """Return estimates and remarks, made of types that JSON knows."""
        e = self.fit.estimates
        columns = [str(name) for name, x in e.data_vars.items() if x.dims == ("parameter",)]
        rows = {str(name): {key: e[key].values[k] for key in columns} for k, name in enumerate(e["parameter"].values)}
        noise = {str(name): self.fit.noise["stderr"].sel(output=name).values for name in self.fit.noise["output"].values}
        about = {"title": self.specification.title, **e.attrs, "parameters": rows, "noise": noise}
        explained = {str(name): self.explained.sel(output=name).values for name in self.explained["output"].values}
        return plain(
            {
                **about,
                "explained": explained,
                "covariance": e["covariance"].values,
                "remarks": documents([*self.fit.remarks, *self.remarks]),
            }
        )

    def write_database(self, path: str | Path) -> list[str]:
        """Write the database with the estimates in it; return the parameters that have no place there."""
        import aerodb

        db, left = updated_database(aerodb.open(self.specification.database), self.fit)
        aerodb.save(db, path)
        return left
