"""Calibration of a-priori standard errors on aircraft with published derivatives.

    python benchmarks/prior_calibration.py estimate --program DATCOM   # runs both estimators
    python benchmarks/prior_calibration.py derive                      # the table, and its coverage
    python benchmarks/prior_calibration.py show navion c182 t37        # estimates and published
    python benchmarks/prior_calibration.py flown                       # models of the examples

The first command writes `data/calibration/estimates.csv`: derivatives of the decks in
`data/calibration` by Digital DATCOM (an executable of the user), by OptVL with the body and
without. The second command compares them with `published.csv` and writes
`aerodb/prior/calibrated_errors.csv`; the third prints calibrated estimates of aircraft, with errors
that the aircraft itself did not calibrate.  Both need no program and have no random numbers.

Model: published = b * estimate + s * hypot(relative * |estimate|, absolute) * z, with the relative
and absolute figures of the identification guide, a ratio b and a factor s of the program and term.
s^2 is the mean square of z with `SHRINKAGE` further values at the mean of its class.  The table has
the ratios: leaving out each aircraft in turn, they make the published values more probable.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
from aerodb.edit.joined_sources.prior_sources import METHODS, PriorSource, SourceTable
from aerodb.edit.joined_sources.source_blending import blend_term
from aerodb.estimators.vortex_lattice.estimate import from_decks
from aerodb.estimators.vortex_lattice.geometry import model_of_decks
from aerodb.prior.prior_errors import PRIOR_ERRORS
from aerodb.prior.roles import assign_roles
from datcom_io.decks.deck_file import read_deck, write_deck
from datcom_io.runs.running import run_deck
from datcom_io.runs.splitting import split_deck
from flightmech.errors import AeromatchWarning
from flightmech.terms import make_term
from flightmech.units import DEGREE

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "data" / "calibration"
TABLE = ROOT / "aerodb" / "prior" / "calibrated_errors.csv"
# Term and method class of each derivative.  The tail methods are of one surface in the wash of
# another; the balance of body and tail decides the last class.
QUANTITIES = {
    "CL_alpha": ("CL/basic", "wing-body"),
    "Cl_beta": ("Cl/beta", "wing-body"),
    "Cl_phat": ("Cl/phat", "wing-body"),
    "Cn_phat": ("Cn/phat", "wing-body"),
    "Cl_rhat": ("Cl/rhat", "wing-body"),
    "Cl_delta_a": ("Cl/aileron", "wing-body"),
    "Cn_delta_a": ("Cn/aileron", "wing-body"),
    "CL_qhat": ("CL/qhat", "tail"),
    "Cm_qhat": ("Cm/qhat", "tail"),
    "CL_alphadothat": ("CL/alphadothat", "tail"),
    "Cm_alphadothat": ("Cm/alphadothat", "tail"),
    "CY_phat": ("CY/phat", "tail"),
    "CY_rhat": ("CY/rhat", "tail"),
    "Cn_rhat": ("Cn/rhat", "tail"),
    "CL_delta_e": ("CL/elevator", "tail"),
    "Cm_delta_e": ("Cm/elevator", "tail"),
    "CY_delta_r": ("CY/rudder", "tail"),
    "Cl_delta_r": ("Cl/rudder", "tail"),
    "Cn_delta_r": ("Cn/rudder", "tail"),
    "Cm_alpha": ("Cm/basic", "body"),
    "CY_beta": ("CY/beta", "body"),
    "Cn_beta": ("Cn/beta", "body"),
}
_AXES = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r"}
_STEP = 5.0 * DEGREE
_USUAL_DEFLECTION = 0.3  # [rad], at which the absolute error of a control counts
_USUAL_INCIDENCE = 0.1  # [rad], at which that of the pitching moment counts
SHRINKAGE = 2.0
# Constants of JSBSim's c182 at small incidence that differ from `published.csv`, or add to it.
FLOWN_C182 = {
    "Cm_delta_e": -0.622,
    "Cl_delta_a": -0.15,
    "Cn_delta_a": 0.0216,
    "Cn_delta_r": -0.0645,
}
LEAST_CASES = 3  # aircraft of a ratio
PROGRAMS = ("DATCOM", "OptVL with body", "OptVL")


def estimate(program: str) -> None:
    """Write the derivatives of all decks by all estimators."""
    conditions = pd.read_csv(FOLDER / "conditions.csv", comment="#").set_index("aircraft")
    rows = []
    for name, condition in conditions.iterrows():
        deck = FOLDER / f"{name}.inp"
        share = condition["rudder"]
        rudder = None if np.isnan(share) else (float(share), 0.0, 1.0)
        builds = {
            "DATCOM": partial(from_program, deck, program),
            "OptVL with body": partial(
                from_decks, [deck], rudder=rudder, with_body=True, errors="guide"
            ),
            "OptVL": partial(from_decks, [deck], rudder=rudder, errors="guide"),
        }
        for label, build in builds.items():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AeromatchWarning)
                found = derivatives(build(), float(condition["CL"]))
            for quantity, value in found.items():
                rows.append((name, label, quantity, round(value, 5)))
            print(name, label, len(found), flush=True)
    table = pd.DataFrame(rows, columns=["aircraft", "program", "quantity", "value"])
    with (FOLDER / "estimates.csv").open("w", encoding="ascii") as stream:
        stream.write("# Derivatives by program, stability axes, at the condition of the deck.\n")
        table.to_csv(stream, index=False)


def from_program(deck: Path, program: str) -> xr.DataTree:
    """Return the database of the runs of a study deck."""
    r = model_of_decks([read_deck(deck)]).reference
    aircraft = SimpleNamespace(
        name=deck.stem, S=r.S, cbar=r.cbar, b=r.b, reference=(-r.x, 0.0, -r.z), x_ref_mac=0.25
    )
    listings = []
    with tempfile.TemporaryDirectory() as folder:
        for name, run in split_deck(deck).items():
            path = Path(folder) / f"{name}.inp"
            write_deck(run, path)
            listings.append(run_deck(path, program, folder).listing)
    by_role: dict[str, list[object]] = {}
    for item in assign_roles(listings):
        for role in item.roles:
            by_role.setdefault(role, []).append(item.case)
    return aerodb.from_datcom(aircraft, **by_role)


def derivatives(db: xr.DataTree, lift: float) -> dict[str, float]:
    """Return derivatives in stability axes where the database has a lift coefficient."""
    terms = {name: leaf["value"] for name, leaf in aerodb.terms(db).items()}
    if "mach" in terms["CL/basic"].dims:
        # The highest Mach number is that of the deck; a lower one may be an extension.
        mach = float(terms["CL/basic"]["mach"].max())
        for name, table in terms.items():
            if "mach" in table.dims:
                terms[name] = table.sel(mach=mach, method="nearest")
    lifts = terms["CL/basic"]
    rising = lifts.isel(alpha=slice(0, int(np.argmax(lifts.values)) + 1))
    alpha = float(np.interp(lift, rising.values, rising["alpha"].values))
    found = {}
    for coefficient in ("CL", "Cm"):
        slope = terms[f"{coefficient}/basic"].differentiate("alpha")
        found[f"{coefficient}_alpha"] = float(slope.interp(alpha=alpha))
    for name, table in terms.items():
        coefficient, contribution = name.split("/")
        at = table.interp(alpha=alpha) if "alpha" in table.dims else table
        axis = _AXES.get(contribution)
        if axis and axis in at.dims:
            high, low = (float(at.interp({axis: sign * _STEP})) for sign in (1.0, -1.0))
            found[f"{coefficient}_{axis}"] = (high - low) / (2.0 * _STEP)
        elif axis:
            found[f"{coefficient}_{axis}"] = float(at)
        elif contribution in ("beta", "phat", "qhat", "rhat", "alphadothat"):
            found[f"{coefficient}_{contribution}"] = float(at)
    turned = to_stability(found, alpha)
    return {name: turned[name] for name in QUANTITIES if name in turned}


def to_stability(found: Mapping[str, float], alpha: float) -> dict[str, float]:
    """Return derivatives with moments and rates along stability axes instead of body axes."""
    turned = dict(found)
    turn = np.array([[np.cos(alpha), np.sin(alpha)], [-np.sin(alpha), np.cos(alpha)]])
    for variable in ("beta", "delta_a", "delta_r"):
        names = [f"Cl_{variable}", f"Cn_{variable}"]
        if names[0] in found:
            pair = [found.get(name, 0.0) for name in names]
            turned.update(zip(names, turn @ pair))
    names = ["Cl_phat", "Cl_rhat", "Cn_phat", "Cn_rhat"]
    if all(name in found for name in names):
        matrix = turn @ np.array([found[name] for name in names]).reshape(2, 2) @ turn.T
        turned.update(zip(names, matrix.ravel()))
    if "CY_phat" in found and "CY_rhat" in found:
        pair = turn @ [found["CY_phat"], found["CY_rhat"]]
        turned.update(zip(["CY_phat", "CY_rhat"], pair))
    return {name: float(value) for name, value in turned.items()}


def read_cases() -> pd.DataFrame:
    """Return one row per aircraft, program and derivative: estimate, published value and scale."""
    published = pd.read_csv(FOLDER / "published.csv", comment="#")
    rows = []
    for (aircraft, _), group in published.groupby(["aircraft", "source"], sort=False):
        values = dict(zip(group["quantity"], group["value"]))
        if group["axes"].iloc[0] == "body":
            values = to_stability(values, float(group["alpha"].iloc[0]) * DEGREE)
        rows += [(aircraft, quantity, value) for quantity, value in values.items()]
    # Two sources of one aircraft are one case.
    known = pd.DataFrame(rows, columns=["aircraft", "quantity", "published"])
    known = known.groupby(["aircraft", "quantity"], sort=False, as_index=False).mean()
    cases = known.merge(read_estimates().rename(columns={"value": "estimate"}))
    scales = []
    for row in cases.itertuples():
        scales.append(np.hypot(*guide_parts(row.quantity, row.estimate)))
    return cases.assign(scale=scales, method=[QUANTITIES[q][1] for q in cases["quantity"]])


def read_estimates() -> pd.DataFrame:
    """Return the derivatives of the decks by program."""
    return pd.read_csv(FOLDER / "estimates.csv", comment="#").dropna()


def guide_parts(quantity: str, value: float) -> tuple[float, float]:
    """Return the two parts of the standard error of a derivative by the guide."""
    relative, absolute = guide(quantity)
    return relative * value, absolute


def guide(quantity: str) -> tuple[float, float]:
    """Return relative and absolute standard error of a derivative by the identification guide."""
    relative, absolute = PRIOR_ERRORS[QUANTITIES[quantity][0]]
    if quantity == "CL_alpha":
        return relative, 0.0  # the absolute error is that of the lift at zero incidence
    if quantity == "Cm_alpha":
        return relative, absolute / _USUAL_INCIDENCE
    if "delta" in quantity:
        return relative, absolute / _USUAL_DEFLECTION
    return relative, absolute


def fit_terms(cases: pd.DataFrame, corrected: bool) -> pd.DataFrame:
    """Return ratio, factor and count of each derivative of one program."""
    rows = []
    for quantity, group in cases.groupby("quantity", sort=False):
        weight = group["scale"] ** -2
        ratio, freedom = 1.0, len(group)
        if corrected and len(group) >= LEAST_CASES:
            ratio = float((weight * group["published"] * group["estimate"]).sum())
            ratio /= float((weight * group["estimate"] ** 2).sum())
            freedom -= 1
        z = (group["published"] - ratio * group["estimate"]) / group["scale"]
        method = group["method"].iloc[0]
        rows.append((quantity, method, len(group), ratio, float((z**2).sum()), freedom))
    columns = ["quantity", "method", "count", "ratio", "squares", "freedom"]
    terms = pd.DataFrame(rows, columns=columns)
    pooled = terms.groupby("method")[["squares", "freedom"]].sum()
    mean = (pooled["squares"] / pooled["freedom"])[terms["method"]].to_numpy()
    terms["factor"] = np.sqrt(
        (terms["squares"] + SHRINKAGE * mean) / (terms["freedom"] + SHRINKAGE)
    )
    return terms.set_index("quantity")


def leave_one_out(cases: pd.DataFrame, corrected: bool) -> pd.DataFrame:
    """Return the cases of one program with errors that the other aircraft calibrate.

    Columns ``z``, the residual in standard errors, and ``score``, its log density.
    """
    parts = []
    for aircraft, left_out in cases.groupby("aircraft", sort=False):
        terms = fit_terms(cases[cases["aircraft"] != aircraft], corrected)
        known = left_out[left_out["quantity"].isin(terms.index)]
        row = terms.loc[known["quantity"]]
        error = row["factor"].to_numpy() * known["scale"]
        z = (known["published"] - row["ratio"].to_numpy() * known["estimate"]) / error
        score = -np.log(error) - 0.5 * z**2 - 0.5 * np.log(2.0 * np.pi)
        parts.append(known.assign(z=z, score=score))
    return pd.concat(parts)


def derive() -> None:
    """Write the table of standard errors, and print coverage and score of each choice."""
    cases = read_cases()
    print("| program | bias | values | body | tail | wing-body | all | mean score | mean factor |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    rows = []
    for program in PROGRAMS:
        mine = cases[cases["program"] == program]
        inside = (mine["published"] - mine["estimate"]).abs() <= 2.0 * mine["scale"]
        print(table_row(program, "errors of the guide", mine, inside))
        for corrected in (False, True):
            tested = leave_one_out(mine, corrected)
            terms = fit_terms(mine, corrected)
            factor = np.exp(np.log(terms["factor"]).mean())
            bias = "corrected" if corrected else "carried"
            ends = f" {tested['score'].mean():.2f} | {factor:.2f} |"
            print(table_row(program, bias, tested, tested["z"].abs() <= 2.0) + ends)
        for quantity, row in terms.iterrows():
            term = QUANTITIES[str(quantity)][0]
            relative, absolute = PRIOR_ERRORS[term]
            # The lift at zero incidence is not compared: it keeps the error of the guide.
            scale = 1.0 if quantity == "CL_alpha" else row["factor"]
            rows.append(
                {
                    "program": program,
                    "term": term,
                    "method": row["method"],
                    "count": int(row["count"]),
                    "ratio": round(row["ratio"], 2),
                    "factor": round(row["factor"], 2),
                    "relative": float(f"{row['factor'] * relative:.2g}"),
                    "absolute": float(f"{scale * absolute:.2g}"),
                }
            )
    with TABLE.open("w", encoding="ascii") as stream:
        stream.write(
            "# Ratio of published to estimated derivatives and standard errors of estimates, up to "
            "Mach 0.6,\n# from 11 aircraft. Derived by benchmarks/prior_calibration.py; do not "
            "edit by hand.\n"
        )
        pd.DataFrame(rows).to_csv(stream, index=False)


def table_row(program: str, bias: str, cases: pd.DataFrame, inside: pd.Series) -> str:
    """Return the shares inside two standard errors as a row in Markdown."""
    classes = 100.0 * inside.groupby(cases["method"]).mean()
    shares = [f"{classes[name]:.0f}" for name in ("body", "tail", "wing-body")]
    cells = [program, bias, str(len(cases)), *shares, f"{100.0 * inside.mean():.1f}"]
    return f"| {' | '.join(cells)} |"


def show(names: list[str]) -> None:
    """Print calibrated estimates next to published values, the aircraft left out of its errors."""
    cases = read_cases()
    published = cases.drop_duplicates(["aircraft", "quantity"])
    published = published.set_index(["aircraft", "quantity"])["published"]
    estimates = read_estimates().set_index(["aircraft", "program", "quantity"])["value"]
    for name in names:
        print(f"\n{name}\n\n| derivative | DATCOM | OptVL | both | published |")
        print("|---|---|---|---|---|")
        for quantity in QUANTITIES:
            alone = {}
            for program in ("DATCOM", "OptVL"):
                mine = cases[(cases["program"] == program) & (cases["aircraft"] != name)]
                terms = fit_terms(mine, corrected=True)
                value = estimates.get((name, program, quantity))
                if value is None or quantity not in terms.index:
                    continue
                row = terms.loc[quantity]
                error = row["factor"] * np.hypot(*guide_parts(quantity, value))
                alone[program] = float(row["ratio"] * value), float(error)
            columns = [alone.get("DATCOM"), alone.get("OptVL"), blend(quantity, alone)]
            cells = ["" if item is None else f"{item[0]:.3g} ± {item[1]:.2g}" for item in columns]
            known = published.get((name, quantity))
            cells.append("" if known is None else f"{known:.3g}")
            print(f"| {quantity} | {' | '.join(cells)} |")


def blend(quantity: str, alone: Mapping[str, tuple[float, float]]) -> tuple[float, float] | None:
    """Return value and standard error of both programs by the blend of the product."""
    tables = []
    for program, (value, error) in alone.items():
        name = {"DATCOM": "Digital DATCOM"}.get(program, program)
        source = PriorSource(name, name, METHODS[name], xr.DataTree())
        leaf = make_term([value], {"mach": [0.2]}, stderr=[error], source="estimate")
        tables.append(SourceTable(source, leaf))
    if not tables:
        return None
    leaf = blend_term(QUANTITIES[quantity][0], tables).leaf
    return float(leaf["value"].squeeze()), float(leaf["stderr"].squeeze())


def flown() -> None:
    """Print how far estimates are from the models that flew the recordings of the examples."""
    import derivative_table

    # JSBSim's c182 takes most of its constants from the source of `published.csv`.
    published = read_cases().query("aircraft == 'c182'").drop_duplicates("quantity")
    c182 = dict(zip(published["quantity"], published["published"])) | FLOWN_C182
    models = {"t37": derivative_table.jsbsim_values(0.459, 2.0 * DEGREE), "c182": c182}
    # The pitch damping of JSBSim's T37 is three times that of any estimate.
    models["t37"].pop("Cm_qhat")
    cases = read_cases()
    estimates = read_estimates().set_index(["aircraft", "program", "quantity"])["value"]
    for aircraft, model in models.items():
        for program in ("DATCOM", "OptVL"):
            mine = cases[(cases["program"] == program) & (cases["aircraft"] != aircraft)]
            terms = fit_terms(mine, corrected=True)
            by_guide, calibrated = [], []
            for quantity, value in model.items():
                estimated = estimates.get((aircraft, program, quantity))
                if estimated is None or quantity not in terms.index:
                    continue
                row = terms.loc[quantity]
                scale = float(np.hypot(*guide_parts(quantity, estimated)))
                by_guide.append((value - estimated) / scale)
                residual = value - row["ratio"] * estimated
                calibrated.append(residual / (scale * row["factor"]))
            sizes = [np.sqrt(np.mean(np.square(one))) for one in (by_guide, calibrated)]
            print(
                f"{aircraft}, {program}: {len(by_guide)} derivatives, rms of the difference in "
                f"standard errors {sizes[0]:.2f} (guide), {sizes[1]:.2f} (calibrated)"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("command", choices=["estimate", "derive", "show", "flown"])
    parser.add_argument("aircraft", nargs="*", help="for show")
    parser.add_argument("--program", default="datcom", help="Digital DATCOM executable")
    given = parser.parse_args()
    if given.command == "estimate":
        estimate(given.program)
    elif given.command == "derive":
        derive()
    elif given.command == "show":
        show(given.aircraft)
    else:
        flown()


if __name__ == "__main__":
    main()
