"""The outcome of one case: signals, tolerances, trim and verdicts of every model against one flight
record.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.support.console import to_json_types
from flightmech.support.figures import html_table, new_figure, to_display_quantity
from pom.cases.case import PomCase
from pom.samples import SampledReplay
from pom.tolerances.bands import row_remarks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple")


def result_figure(
    title: str, signals: xr.Dataset, tolerance: xr.Dataset, channels: Sequence[str]
) -> Figure:
    """Return the figure.

    Parameters
    ----------
    title : str
    signals : Dataset (run, time)
        Of a result; run ``flight`` first. [SI]
    tolerance : Dataset (time)
        Half width of the bands. [SI]
    channels : sequence of str
        What to draw, from the top.

    Raises
    ------
    UnknownName
        A channel that is not among the signals.
    AeromatchError
        matplotlib is not installed.
    """
    for name in channels:
        if name not in signals:
            raise UnknownName(name, map(str, signals.data_vars), "channel of the result")
    figure = new_figure(9.0, 1.9 * len(channels) + 0.8)
    axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    time = signals["time"].values
    for ax, name in zip(axes, channels, strict=True):
        flight, unit = to_display_quantity(name, signals[name].sel(run="flight").values)
        if name in tolerance:
            low, high = (
                to_display_quantity(
                    name, signals[name].sel(run="flight").values + sign * tolerance[name].values
                )[0]
                for sign in (-1, 1)
            )
            ax.fill_between(
                time,
                low,
                high,
                where=np.isfinite(low),
                color="0.85",
                linewidth=0,
                label="tolerance",
            )
        ax.plot(time, flight, color="black", linewidth=1.2, label="flight")
        models = [str(run) for run in signals["run"].values if run != "flight"]
        for number, run in enumerate(models):
            model, _ = to_display_quantity(name, signals[name].sel(run=run).values)
            ax.plot(time, model, color=_COLOURS[number % len(_COLOURS)], linewidth=1.0, label=run)
        ax.set_ylabel(f"{name} [{unit}]")
        ax.grid(linewidth=0.3)
    axes[0].legend(frameon=False, fontsize="small", ncols=4)
    axes[0].set_title(title, fontsize="medium")
    axes[-1].set_xlabel("time [s]")
    return figure


_Made = TypeVar("_Made")

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
NOTICES = ("record", "watch", "far_from_evidence", "tables_left", "waived")
"""Kinds of remarks that stand next to the verdict in index, page and terminal: an error of the flight record, a watched channel off,
terms far from what flight found, tables left."""
VERDICTS = ("pass", "fail", "invalid", "not_tested", "advisory")
STATUSES = ("pass", "limits_exceeded", "record_error", "fail", "invalid", "not_tested")
"""Of a case flown by one model, from best to worst; ``limits_exceeded`` is a pass with a trim beyond its limits, ``record_error`` a
pass against a flight record in which a check found an error."""

PASSED = STATUSES[:3]
"""Statuses of a case in which every criterion passes."""


@dataclass(frozen=True)
class PomResult:
    """Replay of one case by one or more models.

    Attributes
    ----------
    case : PomCase
        The resolved case.
    conditions : dict of str to float
        Initial conditions and configuration of the flight at the start of the window. [SI]
    signals : Dataset (run, time)
        Every compared or shown channel; run ``flight`` first, then the models; NaN where a run has
        no such channel. [SI]
    tolerance : Dataset (time)
        Half width per channel with a time-history band; NaN outside the window of the criterion.
        [SI]
    inputs : Dataset (time)
        What drove the models. [SI]
    trim : DataFrame
        Index ``quantity``, one column for flight and one per model: initial values, biases found
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
        Which model crashed, hung or refused, and how; empty when all ran.  Its rows are ``invalid``
        and carry the text.
    samples : dict of str to Samples
        By model: flights by draws from the posterior of its database and of the instruments
        (`pom.sampling`); empty without any.
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
        """Return what another process gets: the fields, and what was made `once`."""
        return {
            name: self.__dict__[name]
            for name in (*(item.name for item in fields(self)), "_made")
            if name in self.__dict__
        }

    @property
    def runs(self) -> list[str]:
        """Names of the models, in order, without ``flight``."""
        return list(self._runs)

    @cached_property
    def _runs(self) -> tuple[str, ...]:
        return tuple(str(run) for run in self.signals["run"].values if run != "flight")

    def once(self, make: Callable[[PomResult], _Made]) -> _Made:
        """Return what a function makes of this result, made once: page, paper and numbers of a
        report need the same tables.
        """
        made: dict[Any, Any] = self.__dict__.setdefault("_made", {})
        if make not in made:
            made[make] = make(self)
        return made[make]

    def keep(self, make: Callable[[PomResult], _Made], made: _Made) -> None:
        """Have `once` give what the function made of this very result before, such as in another
        process.
        """
        self.__dict__.setdefault("_made", {})[make] = made

    @cached_property
    def rows(self) -> tuple[Mapping[Hashable, Any], ...]:
        """The rows of `verdict` as mappings, made once: a report needs them many times."""
        return tuple(MappingProxyType(row) for row in to_records(self.verdict))

    def verdict_records(self) -> list[dict[str, Any]]:
        """Return the rows of `verdict` as plain data for files, every remark a mapping."""
        return [
            {str(k): v for k, v in row.items()} | {"remarks": [r.as_dict() for r in row["remarks"]]}
            for row in self.rows
        ]

    def groups(self, run: str) -> dict[str, str]:
        """Return the verdict of every group that applies: the best of its alternatives."""
        return group_verdicts(
            self.case, {row["criterion"]: row["verdict"] for row in self.rows if row["run"] == run}
        )

    def status(self, run: str) -> str:
        """Return one of `STATUSES`.

        ``pass`` when every group has a passing alternative; ``limits_exceeded`` when it has, but
        the trim of the model is beyond its limits and the case file does not state why that is
        allowed; ``record_error`` when it has, but the flight record has an error
        (`pom.checking.with_record_checks`).  A group of advisory rows only (correct trend) waits
        for an engineer's tick and does not count; a case without any passing group is never a pass.
        """
        mine = [row for row in self.rows if row["run"] == run]
        return status_of(
            self.groups(run), any(map(has_trim_remark, mine)), any(map(is_on_faulty_record, mine))
        )

    def passed(self, run: str) -> bool:
        """Whether `run` passes the case: every group has a passing alternative, and the trim is
        within its limits.
        """
        return self.status(run) == "pass"

    def worst(self, run: str) -> Mapping[Hashable, Any] | None:
        """Return the verdict row that decides: of the alternatives the best, of the groups the
        worst ratio.
        """
        best: dict[str, Mapping[Hashable, Any]] = {}
        for row in self.rows:
            if (
                row["run"] != run
                or row["verdict"] not in ("pass", "fail")
                or row["measure"] == "setup"
                or math.isnan(row["worst_ratio"])
            ):
                continue
            best[row["group"]] = min(best.get(row["group"], row), row, key=_ratio)
        return max(best.values(), key=_ratio, default=None)

    def plot(self, channels: Sequence[str] | None = None) -> Figure:
        """Return a figure of the flight, its tolerance bands and the models.

        Parameters
        ----------
        channels : sequence of str, optional
            Those that are judged, and without them all, when not given.

        Raises
        ------
        UnknownName
            A channel that the result does not hold.
        AeromatchError
            matplotlib is not installed.
        """
        judged = [str(row["channel"]) for row in self.rows if row["channel"] in self.signals]
        chosen = list(dict.fromkeys(judged)) or list(map(str, self.signals.data_vars))
        return result_figure(self.case.title, self.signals, self.tolerance, channels or chosen)

    def _repr_html_(self) -> str:
        """Return the verdicts as a table for a notebook."""
        columns = ("run", "criterion", "tolerance_text", "worst", "unit", "worst_ratio", "verdict")
        statuses = [f"{run}: {self.status(run)}" for run in self.runs]
        return html_table(
            f"{self.case.id} {self.case.title}",
            columns,
            ([row[name] for name in columns] for row in self.rows),
            statuses,
        )

    def to_json(self) -> str:
        """Return the whole result as one JSON document; NaN becomes null, samples keep nine
        significant digits.
        """
        return json.dumps(to_json_types(self._document()), ensure_ascii=False)

    def _document(self) -> dict[str, Any]:
        return {
            "case": self.case.to_dict(),
            "conditions": self.conditions,
            "status": {run: self.status(run) for run in self.runs},
            "signals": _dataset_to_dict(self.signals),
            "tolerance": _dataset_to_dict(self.tolerance),
            "inputs": _dataset_to_dict(self.inputs),
            "trim": to_split_dict(self.trim),
            "verdict": self.verdict_records(),
            "failure": self.failure,
            "samples": {
                run: {**found.document(), "fan": _dataset_to_dict(found.fan)}
                for run, found in self.samples.items()
            },
        }

    @classmethod
    def from_json(cls, text: str) -> PomResult:
        """Rebuild a result from `to_json`."""
        item = json.loads(text)
        trim = pd.DataFrame(
            item["trim"]["data"], item["trim"]["index"], item["trim"]["columns"], dtype=float
        )
        trim.index.name = "quantity"
        return cls(
            case=PomCase.from_dict(item["case"]),
            conditions={name: _number(value) for name, value in item["conditions"].items()},
            signals=_dataset_from_dict(item["signals"]),
            tolerance=_dataset_from_dict(item["tolerance"]),
            inputs=_dataset_from_dict(item["inputs"]),
            trim=trim,
            verdict=make_verdict_table(item["verdict"]),
            failure=item["failure"],
            samples={
                run: SampledReplay.of_document(one, _dataset_from_dict(one["fan"]))
                for run, one in item.get("samples", {}).items()
            },
        )


def to_records(table: pd.DataFrame) -> list[dict[Hashable, Any]]:
    """Return the rows of a table of numbers, texts and remarks as ``to_dict("records")`` does, in a
    fifth of the time.
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


def _ratio(row: Mapping[Hashable, Any]) -> float:
    return float(row["worst_ratio"])


_BEST = ("pass", "advisory", "fail", "not_tested", "invalid")


def group_verdicts(case: PomCase, verdicts: Mapping[str, str]) -> dict[str, str]:
    """Return the verdict of every group of a case that applies, from the verdicts of its criteria.

    A precondition that holds proves nothing and does not count; one that does not hold makes the
    case invalid.
    """
    found: dict[str, str] = {}
    for criterion in case.criteria:
        verdict = verdicts.get(criterion.name)
        if criterion.applies and verdict and (criterion.measure, verdict) != ("setup", "pass"):
            found[criterion.group] = min(
                found.get(criterion.group, verdict), verdict, key=_BEST.index
            )
    return found


def status_of(
    groups: Mapping[str, str], limits_exceeded: bool = False, record_error: bool = False
) -> str:
    """Return the status of a case from the verdicts of its groups, its trim and its record, as
    `PomResult.status`.
    """
    verdicts = set(groups.values())
    for verdict in ("invalid", "fail", "not_tested"):
        if verdict in verdicts:
            return verdict
    if "pass" not in verdicts:
        return "not_tested"
    if record_error:
        return "record_error"
    return "limits_exceeded" if limits_exceeded else "pass"


_NAMED = 12  # hexadecimal digits of a name of results
_SIGNED = ("criterion", "run", "tolerance_text", "fraction", "verdict")


def results_name(results: Sequence[PomResult]) -> str:
    """Return a name for what is judged and found: the first digits of the SHA-256 of all verdicts
    with their ratios to six digits.

    Two reports with the same verdicts have the same name, whoever signs them; a signature may state
    which results it is for.
    """
    content: list[list[Any]] = []
    for result in results:
        entry: list[Any] = [result.case.name, result.failure]
        for row in result.rows:
            entry.append([*(str(row[key]) for key in _SIGNED), f"{row['worst_ratio']:.6g}"])
        content.append(entry)
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:_NAMED]


def status_text(status: str) -> str:
    """Return a status as a terminal prints it: whatever is not a plain pass in capitals."""
    return {"pass": "pass", "limits_exceeded": "LIMITS", "record_error": "RECORD"}.get(
        status, status.upper()
    )


def trim_remarks(result: PomResult, run: str) -> list[str]:
    """Return what the trim of a model has beyond its limits, each once."""
    return _texts(result, run, ("trim",))


def record_remarks(result: PomResult, run: str) -> list[str]:
    """Return the errors of the flight record of a result, each once."""
    return _texts(result, run, ("record",))


def run_notices(result: PomResult, run: str) -> list[str]:
    """Return what no criterion judges and a reader has to know of a run, each once: kinds `NOTICES`
    of its remarks.
    """
    return _texts(result, run, NOTICES)


def _texts(result: PomResult, run: str, kinds: tuple[str, ...]) -> list[str]:
    texts: dict[str, None] = {}
    for row in result.rows:
        if row["run"] != run:
            continue
        for remark in row["remarks"]:
            if remark.kind in kinds:
                texts[remark.text] = None
    return list(texts)


def has_trim_remark(row: Mapping[Hashable, Any]) -> bool:
    """Whether a row of the verdict table carries a remark on a trim beyond its limits."""
    return any(remark.kind == "trim" for remark in row["remarks"])


def is_on_faulty_record(row: Mapping[Hashable, Any]) -> bool:
    """Whether a row of the verdict table carries an error of the flight record."""
    return any(remark.kind == "record" for remark in row["remarks"])


def make_verdict_table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Return the verdict table of rows; numbers become float (missing: NaN), remarks `RowRemark`,
    all else text (missing: empty).
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
    columns |= {
        column: np.array([row.get(column, math.nan) for row in rows], float) for column in NUMBERS
    }
    columns["remarks"] = pd.Series([row_remarks(row) for row in rows], dtype=object)
    return pd.DataFrame(columns, columns=list(VERDICT_COLUMNS))


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _dataset_to_dict(data: xr.Dataset) -> dict[str, Any]:
    return {
        "coords": {str(name): data[name].values.tolist() for name in data.coords},
        "variables": {
            str(name): {
                "dims": list(map(str, item.dims)),
                "attrs": dict(item.attrs),
                "values": _rounded(item.values).tolist(),
            }
            for name, item in data.data_vars.items()
        },
        "attrs": dict(data.attrs),
    }


def _rounded(values: np.ndarray) -> np.ndarray:
    """Return samples to nine significant digits: far beyond any sensor, and half the length of a
    double in full.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        digits = 8 - np.floor(np.log10(np.abs(values)))
    scale = 10.0 ** np.where(np.isfinite(digits), np.clip(digits, -300, 22), 0.0)
    return (
        np.rint(values * scale) / scale
    )  # scale is an exact power of ten: the quotient is the double nearest to the decimal


def _dataset_from_dict(item: dict[str, Any]) -> xr.Dataset:
    variables = {
        name: (v["dims"], np.array(v["values"], float), v["attrs"])
        for name, v in item["variables"].items()
    }
    return xr.Dataset(variables, coords=item["coords"], attrs=item["attrs"])
