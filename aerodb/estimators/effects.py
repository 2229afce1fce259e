"""Effects of a set of coefficients: tables over Mach number, angle of attack and deflections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.estimators.coefficient_set import CONDITIONS, RATES, CoefficientSet
from aerodb.estimators.conventions import CONTROLS
from aerodb.store.effects import Effect, join_sentences
from flightmech.errors import SchemaError
from flightmech.units import DEGREE

# Coefficients of each effect of the symmetric aeroplane.
_LONGITUDINAL, _LATERAL = ("CL", "CD", "Cm"), ("CY", "Cl", "Cn")
_OF_VARIABLE = {
    "beta": _LATERAL,
    "phat": _LATERAL,
    "qhat": ("CL", "Cm"),
    "rhat": _LATERAL,
    "alphadothat": ("CL", "Cm"),
    "delta_e": _LONGITUDINAL,
    "delta_f": _LONGITUDINAL,
    "delta_a": _LATERAL,
    "delta_r": _LATERAL,
}
# Distance by which the runs with a deflection may end before those without. [rad]
_REACH = 0.3 * DEGREE
_EQUAL = 1e-6  # two numbers of one condition that differ by less are equal
# Share of the largest rolling or yawing moment in sideslip below which a run is symmetric.
_ASYMMETRIC = 2e-3
_ASYMMETRIC_TOTAL = 0.05  # the same share of usual derivatives
# Derivatives with sideslip of an aeroplane, where the files have none. [1/rad]
_USUAL_SLOPE = {"CY": 0.5, "Cl": 0.1, "Cn": 0.1}
# Share of the lift slope by which derivative and slope of the totals may differ.
_SLOPE_TOLERANCE = 0.1
# Angles in rad that are taken for degrees: none is larger than this, and the lift slope is beyond
# that of any aeroplane. [rad], [1/rad]
_SMALL_ANGLES, _STEEPEST_LIFT = 0.6 * DEGREE, 40.0
# Largest angle of attack or sideslip, and deflection: larger ones are degrees taken for rad. [rad]
_LARGEST_ANGLE, _LARGEST_DEFLECTION = 180.0 * DEGREE, 90.0 * DEGREE


class EstimateTables:
    """Tables of a set whose controls have the product's names.

    Parameters
    ----------
    one : CoefficientSet
        With forces in stability axes.
    mach : float or None
        Mach number of numbers whose file states none.
    """

    def __init__(self, one: CoefficientSet, mach: float | None):
        self.one = one
        numbers = one.numbers
        if numbers["mach"].isna().any():
            if mach is None:
                raise SchemaError(
                    "estimate",
                    [f"mach: the numbers of {_files(one)} state no Mach number; give it"],
                )
            numbers = numbers.fillna({"mach": mach})
        # Angles of a print have few digits: equal ones are equal to the bit.
        axes = [*CONDITIONS, *one.controls]
        self.numbers = numbers.assign(**{name: numbers[name].round(9) for name in axes})
        self.remarks: list[str] = []

    def effects(self) -> list[Effect]:
        """Return the effects of the clean aeroplane, sideslip, rates and controls."""
        basic = {name: self._table(name, "") for name in _LONGITUDINAL}
        absent = [name for name, table in basic.items() if table is None]
        if absent:
            raise SchemaError(
                "estimate",
                [
                    f"{_files(self.one)}: no {' '.join(absent)} of the clean aeroplane; give runs "
                    f"without sideslip, rates and deflections"
                ],
            )
        self._demand_units(basic["CL"])
        self._check_symmetry()
        self._check_slope("lift", "CL")
        self._check_slope("pitching moment", "Cm")
        effects = [self._effect("basic", {k: t for k, t in basic.items() if t is not None})]
        for variable, coefficients in _OF_VARIABLE.items():
            tables = {}
            for name in coefficients:
                table = self._table(name, variable)
                if table is not None:
                    tables[name] = table
            contribution = CONTROLS.get(variable, variable)
            if tables and not any(bool(table.any()) for table in tables.values()):
                self.remarks.append(
                    f"every derivative with {variable} is 0: the program did not estimate it; "
                    f"it is left out"
                )
            elif tables:
                effects.append(self._effect(contribution, tables, variable))
            elif variable not in (*RATES, "alphadothat"):
                increments = self._increments(variable, coefficients)
                if increments is not None:
                    effects.append(increments)
        return effects

    def _effect(
        self, name: str, tables: dict[str, xr.DataArray], regressor: str = "", note: str = ""
    ) -> Effect:
        return Effect(
            name,
            tables,
            regressor,
            references=f"{self.one.program}: {_files(self.one)}",
            comment=join_sentences(f"estimate of {self.one.program}", note),
        )

    def _is_clean(self, numbers: pd.DataFrame, without: Sequence[str] = ()) -> pd.Series:
        """Return whether numbers are of symmetric flight without rates and deflections."""
        clean = pd.Series(True, index=numbers.index)
        for name in ("beta", *RATES, *self.one.controls):
            if name not in without:
                clean &= numbers[name] == 0.0
        return clean

    def _table(self, coefficient: str, variable: str) -> xr.DataArray | None:
        """Return a table over Mach number and alpha of the clean aeroplane, None without any."""
        numbers = self.numbers
        rows = numbers[
            (numbers["coefficient"] == coefficient)
            & (numbers["variable"] == variable)
            & self._is_clean(numbers)
        ]
        return self._grid(rows, ["mach", "alpha"], coefficient)

    def _grid(self, rows: pd.DataFrame, axes: list[str], coefficient: str) -> xr.DataArray | None:
        """Return the values of rows over axes; NaN where there is none; None without any."""
        if rows.empty:
            return None
        spread = rows.groupby(axes)["value"].agg(["min", "max"])
        # Two files may state one condition if they agree.
        contradictory = spread[spread["max"] - spread["min"] > _EQUAL]
        if len(contradictory):
            place = contradictory.index[0]
            mach, alpha = place[0], place[1] / DEGREE
            lines = rows[(rows[axes] == list(place)).all(axis=1)]
            places = ", ".join(f"{r.file} line {r.line}" for r in lines.itertuples())
            raise SchemaError(
                "estimate",
                [
                    f"{coefficient} at Mach {mach:g} and alpha {alpha:g} deg is "
                    f"{spread.loc[place, 'min']:g} and {spread.loc[place, 'max']:g} ({places}); "
                    f"give one of them"
                ],
            )
        series = rows.groupby(axes)["value"].mean()
        return xr.DataArray.from_series(series)

    def _increments(self, variable: str, coefficients: Sequence[str]) -> Effect | None:
        """Return the effect of deflections or sideslip by differences of totals."""
        numbers = self.numbers
        if variable not in numbers:
            return None
        totals = numbers[(numbers["variable"] == "") & self._is_clean(numbers, (variable,))]
        if not (totals[variable] != 0.0).any():
            return None
        tables: dict[str, xr.DataArray] = {}
        for name in coefficients:
            rows = totals[totals["coefficient"] == name]
            table = self._grid(rows, ["mach", "alpha", variable], name)
            if table is None:
                continue
            if 0.0 not in table[variable]:
                raise SchemaError(
                    "estimate",
                    [f"{name} over {variable} has no run at zero; give the clean runs as well"],
                )
            tables[name] = self._increment(name, table, variable)
        if not any(bool(table.any()) for table in tables.values()):
            self.remarks.append(
                f"every increment of {variable} is 0: the program did not estimate it; it is left "
                f"out"
            )
            return None
        if variable == "beta":
            slopes = {name: self._slope(name, table) for name, table in tables.items()}
            return self._effect("beta", slopes, "beta", "slope of the totals over sideslip")
        contribution = CONTROLS[variable]
        effect = self._effect(contribution, tables, "", "differences of totals")
        return Effect(
            effect.name,
            effect.tables,
            zeros={variable: [0.0]},
            references=effect.references,
            comment=effect.comment,
        )

    def _increment(self, name: str, table: xr.DataArray, variable: str) -> xr.DataArray:
        """Return the difference of a table to its values without deflection.

        Runs of a tunnel have slightly different angles, so each deflection is interpolated to the
        angles of the clean runs. Angles that a deflection does not reach are left out, with a
        remark.
        """
        clean = table.sel({variable: 0.0}, drop=True).dropna("alpha", how="any")
        alphas = clean["alpha"].values
        parts = []
        for delta in table[variable].values:
            runs = table.sel({variable: delta}, drop=True).dropna("alpha", how="any")
            if runs.sizes["alpha"] < 2:
                raise SchemaError(
                    "estimate",
                    [
                        f"{name} at {variable} {delta / DEGREE:g} deg has {runs.sizes['alpha']} "
                        f"angles of attack with all Mach numbers; give two or more"
                    ],
                )
            moved = runs.interp(alpha=alphas, kwargs={"fill_value": "extrapolate"})
            low, high = runs["alpha"].values[[0, -1]] + np.array([-1.0, 1.0]) * _REACH
            parts.append((moved - clean).where((alphas >= low) & (alphas <= high)))
        increment = xr.concat(parts, table[variable]).transpose(*table.dims)
        kept = increment.dropna("alpha", how="any")
        lost = sorted(set(alphas) - set(kept["alpha"].values))
        if not kept.sizes["alpha"]:
            raise SchemaError(
                "estimate",
                [
                    f"{name} over {variable}: no angle of attack has all deflections; give runs of "
                    f"all deflections over the same angles"
                ],
            )
        if lost:
            degrees = " ".join(f"{alpha / DEGREE:g}" for alpha in lost)
            self.remarks.append(
                f"{name} over {variable}: not every deflection reaches alpha {degrees} deg; the "
                f"increment there is that of the nearest angle"
            )
        return kept

    def _slope(self, name: str, table: xr.DataArray) -> xr.DataArray:
        """Return the slope through zero of a table over sideslip; remark if it is not straight."""
        beta = table["beta"]
        slope = (table * beta).sum("beta") / (beta**2).sum("beta")
        rest = abs(table - slope * beta).max()
        if float(rest) > 0.1 * float(abs(table).max()):
            degrees = float(abs(beta).max()) / DEGREE
            self.remarks.append(
                f"{name} is not straight over sideslip up to {degrees:g} deg: the slope leaves "
                f"{float(rest):.2g} of {float(abs(table).max()):.2g}"
            )
        return slope

    def _check_symmetry(self) -> None:
        """Remark on a lateral force or moment of the clean aeroplane, which is left out."""
        for name in _LATERAL:
            total = self._table(name, "")
            slope = self._table(name, "beta")
            if total is None:
                continue
            largest = float(abs(total).max())
            # files of totals have no derivative to compare with, and the noise of viscous runs
            if slope is None:
                limit = _ASYMMETRIC_TOTAL * _USUAL_SLOPE[name] * 5.0 * DEGREE
            else:
                limit = _ASYMMETRIC * float(abs(slope).max()) * 5.0 * DEGREE
            if largest > max(limit, 1e-5):
                self.remarks.append(
                    f"{name} of the clean aeroplane without sideslip is up to {largest:.2g}: the "
                    f"model is not symmetric, or a control is deflected that the file does not "
                    f"state; the database takes the aeroplane as symmetric"
                )

    def _demand_units(self, lift: xr.DataArray | None) -> None:
        """Raise if angles are in another unit than stated."""
        problems = []
        limits = dict.fromkeys(("alpha", "beta"), _LARGEST_ANGLE)
        limits |= dict.fromkeys(self.one.controls, _LARGEST_DEFLECTION)
        for name, limit in limits.items():
            largest = float(self.numbers[name].abs().max())
            if largest > limit * (1.0 + 1e-9):
                problems.append(
                    f"{_files(self.one)}: {name} reaches {largest / DEGREE:.4g} deg, at most "
                    f"{limit / DEGREE:g} deg; its numbers are probably degrees, stated as rad"
                )
        if lift is not None and lift.sizes["alpha"] > 1:
            alpha = lift["alpha"].values
            steepest = float(np.nanmax(np.abs(lift.diff("alpha").values), initial=0.0))
            slope = steepest / float(np.diff(alpha).max())
            if np.abs(alpha).max() < _SMALL_ANGLES and slope > _STEEPEST_LIFT:
                problems.append(
                    f"{_files(self.one)}: alpha is from {alpha[0] / DEGREE:.3g} to "
                    f"{alpha[-1] / DEGREE:.3g} deg with a lift slope of {slope:.3g} per rad; its "
                    f"numbers are probably rad, stated as degrees"
                )
        if problems:
            raise SchemaError("estimate", problems)

    def _check_slope(self, words: str, name: str) -> None:
        """Remark if a printed derivative with alpha is not the slope of the totals.

        The difference of either slope is measured in lift slopes: that of the pitching moment is
        then one of the neutral point in chords.
        """
        total, slope = self._table(name, ""), self._table(name, "alpha")
        lift = self._table("CL", "alpha")
        if total is None or slope is None or lift is None or total.sizes["alpha"] < 3:
            return
        gradient = total.differentiate("alpha").isel(alpha=slice(1, -1))
        if gradient.sizes["alpha"] > 1:
            # The derivatives may be at other angles than the totals, as those of a trimmed log.
            gradient = gradient.interp(alpha=slope["alpha"])
        difference = abs((gradient - slope) / lift)
        if not difference.notnull().any():
            return
        worst = float(difference.max())
        if worst > _SLOPE_TOLERANCE:
            self.remarks.append(
                f"the slope of the {words} that {self.one.program} prints differs by "
                f"{100.0 * worst:.0f} % of the lift slope from that of its coefficients over "
                f"alpha: separated flow, wide steps of alpha, a damaged number, or runs of several "
                f"models"
            )


def _files(one: CoefficientSet) -> str:
    """Return the names of the files, the first three of many."""
    if len(one.files) <= 3:
        return ", ".join(one.files)
    return f"{', '.join(one.files[:3])} and {len(one.files) - 3} more"
