"""Result of one case: signals, tolerances, trim and verdicts of every model and one record."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from operator import itemgetter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.short_text import ShortText
from flightmech.support.console import to_json_types
from flightmech.support.figures import html_table
from pom.cases.case import PomCase
from pom.result_signals import dataset_from_dict, dataset_to_dict, result_figure
from pom.samples import SampledReplay
from pom.status import (
    PASSED,
    group_verdicts,
    has_departure,
    has_remark,
    has_trim_remark,
    is_on_faulty_record,
    ratio_shows_verdict,
    status_of,
)
from pom.tolerances.bands import row_remarks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Product = TypeVar("_Product")

VERDICT_COLUMNS = (
    "run",
    "criterion",
    "channel",
    "measure",
    "group",
    "window_start",
    "window_stop",
    "tolerance_text",
    "applied_text",
    "fraction",
    "width",
    "unit",
    "flight_value",
    "model_value",
    "worst",
    "worst_ratio",
    "at",
    "first_exit",
    "inside",
    "verdict",
    "remarks",
    "provenance",
)
NUMBERS = (
    "window_start",
    "window_stop",
    "fraction",
    "width",
    "flight_value",
    "model_value",
    "worst",
    "worst_ratio",
    "at",
    "first_exit",
    "inside",
)


@dataclass(frozen=True)
class PomResult(ShortText):
    """Replay of one case by one or more models.

    Attributes
    ----------
    case : PomCase
        The resolved case.
    conditions : dict of str to float
        Initial conditions and configuration at the start of the window. [SI]
    signals : Dataset (run, time)
        Every compared or shown channel.  Run ``flight`` comes first, then the models.  NaN if a run
        has no such channel. [SI]
    tolerance : Dataset (time)
        Half width per channel with a time-history band; NaN outside the window of the criterion.
        [SI]
    inputs : Dataset (time)
        Inputs of the models. [SI]
    trim : DataFrame
        Index ``quantity``, one column for flight and one per model: initial values, trim biases
        (``trim.*``), residual accelerations (``residual.*``). [SI]
    verdict : DataFrame
        One row per criterion and model, columns `VERDICT_COLUMNS`.  Times in s on the clock of the
        record; ``tolerance_text`` as printed, ``applied_text`` as applied (fraction, base,
        numbers), ``fraction`` the share of the tolerance; ``width`` (smallest half width in the
        window, or the half width of the scalar), ``flight_value`` and ``model_value`` (of a measure
        that is one number, else NaN) and ``worst`` (signed, model minus flight) in ``unit``, the
        unit of the table; ``worst_ratio`` = largest ``|difference| / half width``; ``inside`` =
        share of samples inside; ``verdict`` one of `VERDICTS`; ``remarks`` a tuple of `RowRemark`.
    failure : str
        Names of the models that crashed, hung or failed, and the cause; empty when all ran.  Their
        rows are ``invalid`` and have the text as a remark.
    samples : dict of str to SampledReplay
        By model: replays by draws from the posterior of its database and of the instruments
        (`pom.sampling`); may be empty.
    """

    case: PomCase
    conditions: dict[str, float]
    signals: xr.Dataset
    tolerance: xr.Dataset
    inputs: xr.Dataset
    trim: pd.DataFrame
    verdict: pd.DataFrame
    failure: str = ""
    samples: Mapping[str, SampledReplay] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for another process: the fields and the products of `once`."""
        names = [item.name for item in fields(self)] + ["_products"]
        # `_products` exists only after the first call of `once` or `keep`
        return {name: self.__dict__[name] for name in names if name in self.__dict__}

    def with_case(self, case: PomCase) -> PomResult:
        """Return the result with a case that differs in the texts of its page only.

        Its criteria stay those of the flight (`pom.judging.applicability.settle_case`).
        """
        result = replace(self, case=replace(case, criteria=self.case.criteria))
        # no product of `once` depends on these texts
        result.__dict__["_products"] = dict(self.__dict__.get("_products", {}))
        return result

    @property
    def runs(self) -> list[str]:
        """Names of the models, in order, without ``flight``."""
        return list(self._runs)

    @cached_property
    def _runs(self) -> tuple[str, ...]:
        return tuple(str(run) for run in self.signals["run"].values if run != "flight")

    def once(self, make: Callable[[PomResult], _Product]) -> _Product:
        """Return ``make(self)``, computed at the first call only.

        Page, paper and numbers of a report need the same tables.
        """
        products: dict[Any, Any] = self.__dict__.setdefault("_products", {})
        if make not in products:
            products[make] = make(self)
        return products[make]

    def keep(self, make: Callable[[PomResult], _Product], product: _Product) -> None:
        """Store ``make(self)`` for `once`, for example from another process."""
        self.__dict__.setdefault("_products", {})[make] = product

    @cached_property
    def rows(self) -> tuple[Mapping[Hashable, Any], ...]:
        """The rows of `verdict` as mappings; a report reads them many times."""
        return tuple(MappingProxyType(row) for row in to_records(self.verdict))

    def verdict_records(self) -> list[dict[str, Any]]:
        """Return the rows of `verdict` as plain data for files, every remark a mapping."""
        records = []
        for row in self.rows:
            record = {str(key): value for key, value in row.items()}
            record["remarks"] = [remark.as_dict() for remark in row["remarks"]]
            records.append(record)
        return records

    def groups(self, run: str) -> dict[str, str]:
        """Return the verdict of every group that applies: the best of its alternatives."""
        verdicts = {row["criterion"]: row["verdict"] for row in self.rows if row["run"] == run}
        return group_verdicts(self.case, verdicts)

    def status(self, run: str) -> str:
        """Return one of `STATUSES`.

        ``pass``: every group has a passing alternative.  ``pass_with_departures``: as ``pass``, but
        the case departs from the printed row or from normal practice.  ``limits_exceeded``: as
        ``pass``, but the trim of the model is beyond its limits and the case file does not state
        why that is allowed.  ``record_error``: as ``pass``, but the flight record has an error
        (`pom.checking.with_record_checks`).  ``leak``: as ``pass``, but samples of the record
        identified the model.  ``not_driven``: as ``pass``, but the answer of the model does not
        follow its inputs (`pom.probing`).  ``demonstration``: curves without a tolerance, no pass.
        A group of advisory rows only (correct trend) waits for
        an engineer's tick and does not count.  A case without any passing group is never a pass.
        """
        rows = [row for row in self.rows if row["run"] == run]
        return status_of(
            self.groups(run),
            limits_exceeded=any(map(has_trim_remark, rows)),
            record_error=any(map(is_on_faulty_record, rows)),
            departures=any(map(has_departure, rows)),
            leak=any(has_remark(row, "leak") for row in rows),
            not_driven=any(has_remark(row, "not_driven") for row in rows),
        )

    def passed(self, run: str) -> bool:
        """Return whether the status of `run` is a plain pass."""
        return self.status(run) == "pass"

    def worst(self, run: str) -> Mapping[Hashable, Any] | None:
        """Return the verdict row that decides, or None without a judged row.

        Of the alternatives of a group it is the best ratio, of the groups the worst.
        """
        best: dict[str, Mapping[Hashable, Any]] = {}
        for row in self.rows:
            if row["run"] == run and _has_ratio(row):
                best[row["group"]] = min(best.get(row["group"], row), row, key=_worst_ratio)
        return max(best.values(), key=_worst_ratio, default=None)

    def deciding_row(self, run: str) -> Mapping[Hashable, Any]:
        """Return the verdict row that decides the status of a run; empty if there is none.

        Page, paper and terminal print this row.  It is that of `worst` if the run passes or if a
        ratio is above one.  Otherwise it is the first row with the status, such as a mode that is
        missing or a row that is not tested; its ratio may be NaN.
        """
        worst = self.worst(run) or {}
        status = self.status(run)
        # A ratio within the band decides nothing about a case that is not tested or not valid.
        is_decided = status == "fail" and worst.get("worst_ratio", 0.0) > 1.0
        if status in PASSED or is_decided:
            return worst
        applying = {criterion.name for criterion in self.case.criteria if criterion.applies}
        groups = self.groups(run)
        for row in self.rows:
            is_of_status = groups.get(row["group"]) == row["verdict"] == status
            if row["run"] == run and is_of_status and row["criterion"] in applying:
                return row
        return worst

    def plot(self, channels: Sequence[str] | None = None) -> Figure:
        """Return a figure of the flight, its tolerance bands and the models.

        Parameters
        ----------
        channels : sequence of str, optional
            Default: the judged channels; all channels if none is judged.

        Raises
        ------
        UnknownName
            The result has no such channel.
        AeromatchError
            matplotlib is not installed.
        """
        if not channels:
            judged = [str(row["channel"]) for row in self.rows if row["channel"] in self.signals]
            # several criteria may judge one channel
            channels = list(dict.fromkeys(judged)) or list(map(str, self.signals.data_vars))
        title, tolerance = self.case.title, self.tolerance
        return result_figure(title, self.signals, tolerance=tolerance, channels=channels)

    def report(self) -> str:
        """Return the status of each model, and the criterion that decides, as text."""
        lines = [f"{self.case.name}: {self.case.id} {self.case.title}"]
        for run in self.runs:
            line = f"{run}: {self.status(run)}"
            row = self.deciding_row(run)
            if row and ratio_shows_verdict(row):
                line += (
                    f", {row['criterion']} is {row['worst_ratio']:.2f} of its tolerance "
                    f"({row['tolerance_text']})"
                )
            elif row:
                # a row without a number has a reason
                reasons = (remark.text for remark in row["remarks"] if remark.kind != "values")
                line += f", {row['criterion']}: {next(reasons, 'no number')}"
            lines.append(line)
        if self.failure:
            lines.append(f"failure: {self.failure}")
        return "\n".join(lines)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the verdicts as a table, a row for each criterion and model."""
        return self.verdict.copy()

    def _repr_html_(self) -> str:
        """Return the verdicts as a table for a notebook."""
        columns = ("run", "criterion", "tolerance_text", "worst", "unit", "worst_ratio", "verdict")
        rows = self.verdict[list(columns)].itertuples(index=False)
        statuses = [f"{run}: {self.status(run)}" for run in self.runs]
        return html_table(f"{self.case.id} {self.case.title}", columns, rows, notes=statuses)

    def to_json(self) -> str:
        """Return the result as one JSON document.

        NaN becomes null, samples keep nine significant digits.
        """
        return json.dumps(to_json_types(self._document()), ensure_ascii=False)

    def _document(self) -> dict[str, Any]:
        samples = {}
        for run, sampled in self.samples.items():
            samples[run] = {**sampled.document(), "fan": dataset_to_dict(sampled.fan)}
        return {
            "case": self.case.to_dict(),
            "conditions": self.conditions,
            "status": {run: self.status(run) for run in self.runs},
            "signals": dataset_to_dict(self.signals),
            "tolerance": dataset_to_dict(self.tolerance),
            "inputs": dataset_to_dict(self.inputs),
            "trim": to_split_dict(self.trim),
            "verdict": self.verdict_records(),
            "failure": self.failure,
            "samples": samples,
        }

    @classmethod
    def from_json(cls, text: str) -> PomResult:
        """Rebuild a result from `to_json`."""
        item = json.loads(text)
        trim = pd.DataFrame(**item["trim"], dtype=float)
        trim.index.name = "quantity"
        # null stands for NaN in the document
        values = np.array(list(item["conditions"].values()), float).tolist()
        conditions = dict(zip(item["conditions"], values, strict=True))
        samples = {}
        for run, sampled in item.get("samples", {}).items():
            samples[run] = SampledReplay.of_document(sampled, dataset_from_dict(sampled["fan"]))
        return cls(
            case=PomCase.from_dict(item["case"]),
            conditions=conditions,
            signals=dataset_from_dict(item["signals"]),
            tolerance=dataset_from_dict(item["tolerance"]),
            inputs=dataset_from_dict(item["inputs"]),
            trim=trim,
            verdict=make_verdict_table(item["verdict"]),
            failure=item["failure"],
            samples=samples,
        )


def to_records(table: pd.DataFrame) -> list[dict[Hashable, Any]]:
    """Return the rows of a table of numbers, texts and remarks as ``to_dict("records")`` does.

    It skips the type conversions of pandas, which these columns do not need.
    """
    columns = [table[name].tolist() for name in table.columns]
    return [dict(zip(table.columns, row, strict=True)) for row in zip(*columns, strict=True)]


def to_split_dict(table: pd.DataFrame) -> dict[str, Any]:
    """Return a table of numbers as ``to_dict("split")`` does."""
    return {
        "index": table.index.tolist(),
        "columns": table.columns.tolist(),
        "data": table.to_numpy(float).tolist(),
    }


def _has_ratio(row: Mapping[Hashable, Any]) -> bool:
    # A precondition (`setup`) decides whether the case is valid; its ratio is not compared.
    if row["measure"] == "setup":
        return False
    return row["verdict"] in ("pass", "fail") and not math.isnan(row["worst_ratio"])


_worst_ratio = itemgetter("worst_ratio")

_NAME_DIGITS = 12  # hexadecimal digits of a name of results
_HASHED_COLUMNS = ("criterion", "run", "tolerance_text", "fraction", "verdict")


def results_name(results: Sequence[PomResult]) -> str:
    """Return a name for results: the first digits of the SHA-256 of their verdicts.

    The hash covers every verdict with its ratio to six digits.  Two reports with the same verdicts
    have the same name, whoever signs them.
    """
    content: list[list[Any]] = []
    for result in results:
        entry: list[Any] = [result.case.name, result.failure]
        for row in result.rows:
            texts = [str(row[key]) for key in _HASHED_COLUMNS]
            entry.append([*texts, f"{row['worst_ratio']:.6g}"])
        content.append(entry)
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:_NAME_DIGITS]


def make_verdict_table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Return the verdict table of rows.

    Missing numbers become NaN, missing texts are empty, and remarks become `RowRemark`.
    """
    text_columns = [name for name in VERDICT_COLUMNS if name not in (*NUMBERS, "remarks")]
    # One string array for all columns: pandas is slow for many short ones.
    cells: list[str] = []
    for name in text_columns:
        cells += [str(row.get(name, "")) for row in rows]
    texts = pd.Series(cells, dtype=str).array
    columns: dict[str, Any] = {}
    for k, name in enumerate(text_columns):
        columns[name] = texts[k * len(rows) : (k + 1) * len(rows)]
    for name in NUMBERS:
        columns[name] = np.array([row.get(name, math.nan) for row in rows], float)
    # dtype object: pandas must not split the tuples of remarks
    columns["remarks"] = pd.Series([row_remarks(row) for row in rows], dtype=object)
    return pd.DataFrame(columns, columns=list(VERDICT_COLUMNS))
