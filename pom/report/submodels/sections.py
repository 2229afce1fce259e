"""Engine: the deck over corrected speed next to the a-priori one (as [LR743] Fig. 6), schedule and
time constants, constants.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.figures import make_svg_figure
from flighttest.submodels.control_loading.motion import (
    CUTOFF,
    control_signals,
    force_regressors,
    is_sliding,
)
from flighttest.submodels.control_loading.result import IdentifiedLoading
from flighttest.submodels.control_loading.simulation import SimulatedWindow
from flighttest.submodels.engine.result import EngineFit
from flighttest.submodels.ground_effect.result import GroundEffect
from flighttest.submodels.landing_gear.identification import IdentifiedGear
from pom.diagnosis.corrected_model import corrected_terms, correction_reasons
from pom.diagnosis.term_swaps import by_submodel
from pom.report.presentation.quantities import MISSING, fixed_decimals, format_number
from pom.report.submodels.section import (
    EQUATION_ERROR,
    OUTPUT_ERROR,
    PanelOf,
    Picture,
    Section,
    SectionLine,
    SectionTable,
    estimate_cells,
    make_picture,
)

TOTALS = ("friction", "damping", "mass")
MOST = 6  # windows of free motion that are drawn, those of the largest travel
LOOPS, CONTROL_POINTS = 4, 400  # speeds whose force over the travel is drawn, and samples of each
ONE_SPEED, STILL = 0.1, 20.0  # dynamic pressures that count as one: relative, and about zero [Pa]
LABELS = {
    "column": ("column, cm", 100.0),
    "wheel": ("wheel, deg", 180.0 / np.pi),
    "pedal": ("pedal, cm", 100.0),
}


def control_loading(
    name: str,
    found: IdentifiedLoading,
    flown: Sequence[SimulatedWindow] = (),
    driven: Sequence[xr.Dataset] = (),
) -> Section:
    """Return the section of one control; `flown` its simulated free motion, `driven` the records of
    its slow motion.
    """
    loading, sliding = found.loading, found.slid.estimates.attrs
    unit = "N m" if loading.item == "wheel" else "N"
    measures = [
        (
            "force at the hand",
            EQUATION_ERROR,
            f"rms {format_number(sliding['residual_rms'], 3)} {unit}, R² "
            f"{fixed_decimals(sliding['R2'], 4)}",
        )
    ]
    if found.cable is not None:
        measures.append(
            (
                "stretch of the cable",
                EQUATION_ERROR,
                f"rms {format_number(found.cable.attrs['rms'], 2)} {'rad' if unit == 'N m' else 'm'}",
            )
        )
    if flown:
        rms = [one.misfit()[0] for one in flown]
        measures.append(
            (
                "free motion, simulated",
                "check, not fitted",
                f"rms {fixed_decimals(100 * min(rms), 0)} to "
                f"{fixed_decimals(100 * max(rms), 0)} % of the travel",
            )
        )
    names = [str(term) for term in found.estimates["term"].values]
    constants = tuple(
        (n.replace("_", " "), *estimate_cells(*found.value(n))) for n in names if ":" not in n
    )
    totals = tuple(
        (f"{n}, both ends", *estimate_cells(*found.total(n)))
        for n in TOTALS
        if n in loading.constants and found.cable is not None
    )
    hinge = tuple((n, *estimate_cells(*found.value(n))) for n in names if ":" in n)
    head = ("", "estimate", "standard error")
    grids = (
        SectionTable(
            f"Constants of a circuit of order {found.order}, SI",
            ("constant", *head[1:]),
            constants + totals,
        ),
        SectionTable(f"Hinge moment {loading.model}, per radian", ("term", *head[1:]), hinge),
    )
    remarks = tuple(
        f"{a} and {b} go together in every manoeuvre; only differences between manoeuvres "
        f"separate them"
        for a, b in found.collinear
    )
    return Section(
        name,
        tuple(measures),
        grids,
        (*_force_loops(name, found, driven), *_free_motion(name, loading.item, flown)),
        remarks,
    )


def _force_loops(
    name: str, found: IdentifiedLoading, driven: Sequence[xr.Dataset]
) -> tuple[Picture, ...]:
    """Return the force at the hand over the travel, recorded and by the identified constants, the
    dynamic pressure rising.

    Samples in which the control slides: friction makes the two branches of a loop, its half width.
    """
    loading, loops = found.loading, []
    theta = found.slid.estimates["estimate"].values
    (title, factor), unit = LABELS[loading.item], "N m" if loading.item == "wheel" else "N"
    for one in driven:
        moved = control_signals(loading, one, CUTOFF)
        used = is_sliding(loading, one, moved, CUTOFF)
        if used.any():
            rows = (
                factor * moved["travel"].values,
                moved[f"F_{loading.item}"].values,
                force_regressors(loading, moved) @ theta,
            )
            loops.append((float(moved["qbar"].values[used].mean()), np.array(rows)[:, used]))
    chosen = _of_speeds(loops)
    panels = [
        PanelOf(
            f"force, {unit}; dynamic pressure {fixed_decimals(max(qbar, 0.0) / 1e3, 1)} kPa",
            title,
            tuple(
                SectionLine(rows[0], force, css, marks=True)
                for force, css in zip(rows[1:], ("run-0", "run-3"), strict=True)
            ),
        )
        for qbar, rows in chosen
    ]
    words = (
        f"Force at the {loading.item} over its travel while it slides, recorded and by the "
        f"identified constants, at {len(panels)} speeds"
    )
    return (
        (
            make_picture(
                f"force-{name}", panels, (("run-0", "recorded"), ("run-3", "identified")), words
            ),
        )
        if panels
        else ()
    )


def _of_speeds(loops: Sequence[tuple[float, np.ndarray]]) -> list[tuple[float, np.ndarray]]:
    """Return dynamic pressure and samples (3, sample) of a few speeds, from the lowest to the
    highest; near ones joined.
    """
    joined: list[tuple[float, np.ndarray]] = []
    for qbar, rows in sorted(loops, key=lambda loop: loop[0]):
        if joined and qbar - joined[-1][0] < ONE_SPEED * qbar + STILL:
            joined[-1] = joined[-1][0], np.hstack([joined[-1][1], rows])
        else:
            joined.append((qbar, rows))
    chosen = (
        [joined[k] for k in np.unique(np.linspace(0, len(joined) - 1, LOOPS).round().astype(int))]
        if joined
        else []
    )
    return [(qbar, rows[:, :: max(1, rows.shape[1] // CONTROL_POINTS)]) for qbar, rows in chosen]


def _free_motion(name: str, item: str, flown: Sequence[SimulatedWindow]) -> tuple[Picture, ...]:
    if not flown:
        return ()
    title, factor = LABELS[item]
    panels = []
    for one in sorted(flown, key=lambda one: -np.ptp(one.travel[:, 0]))[:MOST]:
        time = one.time - one.time[0]
        curves = tuple(
            SectionLine(time, factor * one.travel[:, k], css)
            for k, css in enumerate(("run-0", "run-3"))
        )
        panels.append(PanelOf(title, "time, s", curves))
    words = (
        f"Free motion of the {item}, recorded and simulated with the identified constants, "
        f"{len(panels)} of {len(flown)} windows"
    )
    return (
        make_picture(
            f"free-{name}", panels, (("run-0", "recorded"), ("run-3", "simulated")), words
        ),
    )


CODES = ("run-0", "run-2", "run-3", "run-4", "run-5")
CHANGES = 4  # power changes that are drawn, those of the largest change of speed
MACHS = 3  # Mach numbers of the deck that are drawn
UNITS = {"corrected_thrust": "N", "thrust": "N", "fuel_flow": "kg/s", "corrected_fuel_flow": "kg/s"}
ENGINE_SHOWN = {
    "n2_command": "n2 at rest, 1",
    "n1_command": "n1 at rest, 1",
    "n2_up_time": "time constant up, s",
    "n2_down_time": "time constant down, s",
}


def engine_section(name: str, found: EngineFit) -> Section:
    """Return the section of an identified engine."""
    measures: list[tuple[str, str, str]] = []
    grids: list[SectionTable] = []
    pictures: list[Picture] = []
    remarks: list[str] = []
    constants: dict[str, tuple[float, float]] = {}
    tables: dict[str, Any] = {}
    for part, title in (
        (found.spools, "governor and spools"),
        (found.start, "start and shut-down"),
    ):
        if part is not None:
            constants |= part.constants
            tables |= part.tables
            measures.append((title, OUTPUT_ERROR, _noise(part)))
    if found.spools is not None:
        pictures += _responses(name, found.spools.responses)
        remarks += found.spools.remarks
    if found.static is not None:
        static = found.static
        rms = [
            f"{title} {fixed_decimals(100 * float(np.sqrt(np.mean(v**2))), 2)} % of the "
            f"thrust, {len(v)} points"
            for title, v in static.residuals.items()
        ]
        measures.append(("static thrust", EQUATION_ERROR, "; ".join(rms)))
        factors = zip(static.speeds, static.factor, static.stderr, static.determined, strict=True)
        cells = tuple(
            (format_number(x, 4), *estimate_cells(f, e), "flight" if known else "as a priori")
            for x, f, e, known in factors
        )
        grids.append(
            SectionTable(
                "Corrected over a-priori thrust",
                ("corrected speed", "factor", "standard error", "source"),
                cells,
            )
        )
        pictures += _deck(name, static.prior, static.leaf)
        remarks += static.remarks
    for title, table in found.steady.items():
        residual = f"rms {format_number(table.rms, 3)} {UNITS.get(title, '')}".strip()
        measures.append(
            (title.replace("_", " "), EQUATION_ERROR, f"{residual}, {table.samples} samples")
        )
        if title == "corrected_thrust" and title in found.prior:
            pictures += _deck(name, found.prior[title], table.leaf)
    if constants:
        rows = tuple(
            (key.replace("_", " "), *estimate_cells(*pair)) for key, pair in constants.items()
        )
        grids.insert(
            0, SectionTable("Constants, SI", ("constant", "estimate", "standard error"), rows)
        )
    return Section(
        name, tuple(measures), tuple(grids), (*pictures, *_tables(name, tables)), tuple(remarks)
    )


def _noise(part: Any) -> str:
    """Return the residuals of the output-error searches of a part, by output."""
    searches = [
        search
        for search in (getattr(part, key, None) for key in ("core", "fan", "search", "speed"))
        if search is not None
    ]
    rows = [
        (str(n), float(v))
        for search in searches
        for n, v in zip(
            search.noise["output"].values,
            search.noise["stderr"].isel(manoeuvre=0).values,
            strict=True,
        )
    ]
    return "; ".join(f"{n.removeprefix('engine1.')} rms {format_number(v, 2)}" for n, v in rows)


def _responses(name: str, responses: Sequence[xr.Dataset]) -> list[Picture]:
    """Return speeds over time, recorded and simulated from the lever by the identified spools, of
    the largest power changes.
    """
    chosen = sorted(responses, key=lambda one: -float(np.ptp(one["n2"].values)))[:CHANGES]
    panels = []
    for one in chosen:
        time = one["time"].values - one["time"].values[0]
        speeds = [speed for speed in ("n2", "n1") if speed in one]
        curves = [SectionLine(time, one["throttle"].values, "run-1")]
        curves += [
            SectionLine(time, one[f"{speed}{what}"].values, css)
            for speed in speeds
            for what, css in (("", "run-0"), ("_model", "run-3"))
        ]
        title = f"{' and '.join(speeds)}, {one.attrs.get('record', '')}".rstrip(", ")
        panels.append(PanelOf(title, "time, s", tuple(curves)))
    key = [("run-0", "recorded"), ("run-3", "simulated"), ("run-1", "lever")]
    words = (
        f"Response of the spools to the lever, recorded and simulated, {len(chosen)} of "
        f"{len(responses)} power changes"
    )
    return [make_picture(f"response-{name}", panels, key, words)] if panels else []


def _deck(name: str, prior: xr.Dataset, leaf: xr.Dataset) -> list[Picture]:
    """Return net thrust over corrected speed, a line code for every Mach number, a priori and from
    flight.
    """
    axis = next(str(dim) for dim in leaf["value"].dims if str(dim).startswith("corrected_n"))
    machs = leaf["mach"].values if "mach" in leaf["value"].dims else np.zeros(1)
    chosen = machs[np.unique(np.linspace(0, len(machs) - 1, MACHS).round().astype(int))]
    panels = []
    for title, one in (("a priori", prior), ("from flight", leaf)):
        curves = tuple(
            SectionLine(one[axis].values, _at(one["value"], axis, mach) / 1e3, css)
            for mach, css in zip(chosen, CODES, strict=False)
        )
        panels.append(PanelOf(f"Corrected net thrust {title}, kN", axis.replace("_", " "), curves))
    key = [(css, f"M {mach:.2f}") for mach, css in zip(chosen, CODES, strict=False)]
    return [
        make_picture(
            f"deck-{name}",
            panels,
            key,
            "Corrected net thrust over corrected speed, a priori and from flight",
        )
    ]


def _at(table: xr.DataArray, axis: str, mach: float) -> np.ndarray:
    """Return a table over one axis at a Mach number; at the first node of the other axes."""
    table = table.sel(mach=mach, method="nearest") if "mach" in table.dims else table
    return table.isel({dim: 0 for dim in table.dims if dim != axis}).values


def _tables(name: str, tables: Mapping[str, Any]) -> list[Picture]:
    """Return the tables of the spools over their speed or lever; over a flight condition too, a
    line for every node of it.
    """
    panels: list[PanelOf] = []
    key: list[tuple[str, str]] = []
    for title, curve in tables.items():
        leaf = curve.leaf
        axis, *others = map(str, leaf["value"].dims)
        nodes = (
            [{}]
            if not others
            else [
                {other: k for other in others}
                for k in range(min(len(CODES), leaf.sizes[others[0]]))
            ]
        )
        lines = [
            leaf.isel({dim: min(k, leaf.sizes[dim] - 1) for dim, k in at.items()}) for at in nodes
        ]
        codes = ("run-3",) if not others else CODES
        curves = tuple(
            SectionLine(one[axis].values, one["value"].values, css, one["stderr"].values)
            for one, css in zip(lines, codes, strict=False)
        )
        panels.append(PanelOf(ENGINE_SHOWN.get(title, title.replace("_", " ")), axis, curves))
        if others and not key:
            key = [
                (css, f"{others[0]} {format_number(float(one[others[0]]), 3)}")
                for one, css in zip(lines, codes, strict=False)
            ]
    words = f"{', '.join(panel.title for panel in panels)}, with one standard error"
    return [make_picture(f"tables-{name}", panels, key, words)] if panels else []


SAMPLES = 600  # drawn of one wheel


def landing_gear(name: str, found: IdentifiedGear) -> Section:
    """Return the section of an identified landing gear."""
    techniques = [
        (
            "wheel loads, tyres, brakes",
            EQUATION_ERROR,
            f"rms {_scatter(found.loads.fit.noise)} [N, N m]",
        )
    ]
    if found.flown is not None:
        techniques.append(
            ("tyres and steering", OUTPUT_ERROR, f"rms {_scatter(found.flown.noise)} [SI]")
        )
    rows = tuple(
        (key, *estimate_cells(one.value, one.stderr), one.source)
        for key, one in found.constants.items()
    )
    grid = SectionTable(
        "Constants, SI; mirror images share theirs",
        ("constant", "estimate", "standard error", "source"),
        rows,
    )
    remarks = tuple(f"{key} not determined: {why}" for key, why in found.undetermined.items())
    return Section(name, tuple(techniques), (grid,), _loads(name, found), remarks)


def _scatter(noise: xr.Dataset) -> str:
    """Return the rms over all records, by output."""
    rms = np.sqrt(np.mean(noise["stderr"].values ** 2, axis=0))
    return ", ".join(
        f"{output} {format_number(float(v), 3)}"
        for output, v in zip(noise["output"].values, rms, strict=True)
    )


def _loads(name: str, found: IdentifiedGear) -> tuple[Picture, ...]:
    """Return the reconstructed load of every wheel over its compression."""
    panels = []
    for wheel in (wheel for group in found.groups for wheel in group.names):
        s = np.concatenate(
            [one["compression"].sel(wheel=wheel).values for one in found.loads.loads]
        )
        load = np.concatenate(
            [one["force"].sel(output=f"load.{wheel}").values for one in found.loads.loads]
        )
        good = np.flatnonzero(np.isfinite(s) & np.isfinite(load))
        some = good[:: max(1, len(good) // SAMPLES)]
        panels.append(
            PanelOf(
                f"{wheel}, load in kN",
                "compression, cm",
                (SectionLine(100.0 * s[some], load[some] / 1e3, "run-3", marks=True),),
            )
        )
    words = (
        f"Reconstructed load over compression of "
        f"{', '.join(panel.title.partition(',')[0] for panel in panels)}"
    )
    return (make_picture(name.replace(" ", "-"), panels, (), words),) if panels else ()


HEIGHTS = (1.0, 2.0, 5.0)  # in multiples of the lowest height flown
POINTS = 60  # of a curve over the height
SHOWN = 10.0  # of a curve: up to so many times the lowest height flown, beyond which K is small


def ground_effect_section(name: str, found: GroundEffect) -> Section:
    """Return the section of an identified ground effect."""
    held = "held at the database" if found.held else "estimated along"
    measures = tuple(
        (
            f"{coefficient}, {one.form}",
            EQUATION_ERROR,
            f"rms {format_number(one.evidence['rms'][one.form], 3)}",
        )
        for coefficient, one in found.coefficients.items()
    )
    remarks = tuple(
        f"{term}: k and s not identified: {why}" for term, why in found.not_identified.items()
    )
    return Section(
        name, measures, (_table_2(found, held), *_evidence(found)), _factors(name, found), remarks
    )


def _table_2(found: GroundEffect, held: str) -> SectionTable:
    rows = []
    for coefficient, one in found.coefficients.items():
        at = [one.heights[0] * m for m in HEIGHTS]
        for row in one.rows():
            K = one.factor(row.term, at)
            cells = [
                f"{format_number(k, 3)} ± {format_number(e, 1)} at {format_number(h, 2)} m"
                for h, k, e in zip(at, K["K"].values, K["stderr"].values, strict=True)
            ]
            y_inf = MISSING if np.isnan(row.y_inf) else format_number(row.y_inf, 4)
            rows.append(
                (
                    f"{coefficient}: {row.term}",
                    y_inf,
                    *estimate_cells(row.k, row.k_stderr),
                    *estimate_cells(row.s, row.s_stderr),
                    format_number(row.correlation, 2),
                    *cells,
                )
            )
    caption = (
        f"y = k y_inf h^s, and y = k h^s where there is no y_inf (LR-743 table 2); h in "
        f"metres; free-air terms {held}"
    )
    head = (
        "term",
        "y_inf",
        "k",
        "standard error",
        "s",
        "standard error",
        "correlation",
        *("K(h)",) * len(HEIGHTS),
    )
    return SectionTable(caption, head, tuple(rows))


def _evidence(found: GroundEffect) -> tuple[SectionTable, ...]:
    rows = tuple(
        (
            f"{coefficient}: {form}{', taken' if form == one.form else ''}",
            str(int(row["parameters"])),
            format_number(row["rms"], 4),
            format_number(row["BIC"], 3),
        )
        for coefficient, one in found.coefficients.items()
        for form, row in one.evidence.iterrows()
    )
    return (
        SectionTable(
            "Forms compared on the same samples: the simplest within 2 of the least "
            "criterion is taken",
            ("form", "parameters", "rms", "BIC"),
            rows,
        ),
    )


def _factors(name: str, found: GroundEffect):
    panels = []
    for coefficient, one in found.coefficients.items():
        for term in one.ground:
            h = np.geomspace(one.heights[0], SHOWN * one.heights[0], POINTS)
            K = one.factor(term, h)
            curves = [SectionLine(h, K["K"].values, "run-3", K["stderr"].values)]
            if one.form == "table" and one.table is not None and term in one.table.terms:
                nodes, value, stderr = one.tabled(term)
                curves.append(SectionLine(nodes, value, "run-2", stderr))
            panels.append(
                PanelOf(
                    f"K of {coefficient}: {term}",
                    "height of the moment reference point, m",
                    tuple(curves),
                )
            )
    words = (
        f"Factor K over the height of "
        f"{', '.join(panel.title.removeprefix('K of ') for panel in panels)}, with one standard "
        f"error"
    )
    return (
        (
            make_picture(
                name.replace(" ", "-"), panels, (("run-3", "k h^s"), ("run-2", "table")), words
            ),
        )
        if panels
        else ()
    )


def make_sections(
    submodels: Mapping[str, Any],
    free_motion: Mapping[str, Sequence[Any]],
    driven_motion: Mapping[str, Sequence[xr.Dataset]] | None = None,
) -> list[Section]:
    """Return the sections of results by the name of the submodel.

    Raises
    ------
    SchemaError
        A result of another kind, or motion of a control that is not there.
    """
    driven = driven_motion or {}
    unknown = [
        f"{place}: {name!r} is no submodel; there are: {', '.join(submodels) or 'none'}"
        for place, motion in (("free_motion", free_motion), ("driven_motion", driven))
        for name in motion
        if name not in submodels
    ]
    found = []
    for name, result in submodels.items():
        section = _section(name, result, free_motion.get(name, ()), driven.get(name, ()))
        if section is None:
            unknown.append(
                f"submodels.{name}: {type(result).__name__}; give an EngineFit, "
                f"IdentifiedLoading, GroundEffect or IdentifiedGear"
            )
        else:
            found.append(section)
    if unknown:
        raise SchemaError("report", unknown)
    return found


def _section(
    name: str, result: Any, free: Sequence[Any], driven: Sequence[xr.Dataset]
) -> Section | None:
    """Return the section of one result; None of another kind.  What identifies them takes a second
    to load: most reports have none.
    """

    if isinstance(result, EngineFit):
        return engine_section(name, result)
    if isinstance(result, IdentifiedLoading):
        return control_loading(name, result, free, driven)
    if isinstance(result, GroundEffect):
        return ground_effect_section(name, result)
    return landing_gear(name, result) if isinstance(result, IdentifiedGear) else None


def needed_submodels(
    diagnoses: Mapping[str, pd.DataFrame], databases: Mapping[str, xr.DataTree]
) -> SectionTable | None:
    """Return which submodels, and what of them, the corrected model takes; None without a
    diagnosis.
    """
    if not diagnoses:
        return None
    why = correction_reasons(diagnoses)
    taken = by_submodel(corrected_terms(diagnoses.values()), *databases.values())
    rows = tuple(
        (submodel if k == 0 else "", name, why[name])
        for submodel, names in taken.items()
        for k, name in enumerate(names)
    )
    return SectionTable(
        "What the corrected model takes from the final one, by submodel",
        ("submodel", "term or part", "why"),
        rows,
    )


def submodels_context(found: Sequence[Section]) -> list[dict[str, Any]]:
    """Return what the template ``submodels.html`` shows of every section."""
    return [
        {
            "key": one.name.replace(" ", "-"),
            "name": one.name,
            "techniques": one.techniques,
            "grids": one.grids,
            "figures": [make_svg_figure(p.height, p.body, p.words) for p in one.pictures],
            "remarks": one.remarks,
        }
        for one in found
    ]
