"""Manoeuvres of a record: as it marks them, or as its controls and motion show them."""

from __future__ import annotations

import pandas as pd
import xarray as xr

from flighttest.flight_programme.manoeuvre_finding.finding import find_manoeuvres
from flighttest.records.record import marked_manoeuvres


def marked_or_found(record: xr.DataTree | xr.Dataset) -> pd.DataFrame:
    """Return the manoeuvres of a record, or of the states of a path of this record.

    A record without marks is searched, as `flighttest.manoeuvre_finding.find_manoeuvres` does.
    Kinds and times of found manoeuvres are to be confirmed.

    Parameters
    ----------
    record : DataTree or Dataset
        States of a path are not searched.

    Returns
    -------
    DataFrame
        One row per manoeuvre: ``manoeuvre control start end note``, times in seconds of the record.
        Found manoeuvres have the column ``confidence`` too, and ``attrs["origin"]`` is ``found``,
        otherwise ``marked``.

    Raises
    ------
    SchemaError
        The record marks no manoeuvre, and has no control channel in which one can be found.

    See Also
    --------
    flighttest.records.marked_manoeuvres : The marks alone, an empty table without marks.
    """
    table = marked_manoeuvres(record)
    if len(table) or isinstance(record, xr.Dataset):
        table.attrs["origin"] = "marked"
        return table
    found = find_manoeuvres(record)
    found.attrs["origin"] = "found"
    return found
