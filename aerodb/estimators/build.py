"""A-priori database of an aeroplane from the outputs of a program such as AVL or XFLR5."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference
from aerodb.estimators.column_map import ColumnMap
from aerodb.estimators.conventions import CONTROLS, forces_to_stability, name_controls
from aerodb.estimators.effects import EstimateTables
from aerodb.estimators.reading import read_estimates
from aerodb.prior.effect_to_terms import terms_of_effect
from aerodb.prior.prior_errors import PriorErrors, errors_with
from aerodb.prior.reference_quantities import (
    FAR,
    NEAR,
    Point,
    describe_other_quantities,
    find_basic_ranges,
)
from aerodb.prior.sources import warn_user
from aerodb.store.effects import (
    Effect,
    change_reference_quantities,
    rate_shift,
    rates_to_body,
    rotate_rolling_to_body,
    transfer_moments,
    with_added,
    without_partial_sums,
)
from aerodb.store.overview import ORIGIN
from aerodb.store.schema import make_prior_database
from aerodb.update.cautions.notices import note_plausibility
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError

_USUAL_DEFLECTION = 0.3  # [rad]
_USUAL_CD0 = (0.004, 0.1)
_NO_FRICTION = 0.03  # standard error of a drag coefficient without friction
_LARGEST_MACH = 30.0
_CONTROLS = ("aileron", "rudder")  # with rolling and yawing moments


def from_estimate(
    aircraft: Aircraft,
    files: Sequence[str | Path],
    *,
    length_unit: float | None = None,
    controls: Mapping[str, str] | None = None,
    columns: ColumnMap | None = None,
    reference: EstimateReference | None = None,
    mach: float | None = None,
    CD0: float | None = None,
    move_reference: bool = False,
    stderr: Mapping[str, tuple[float, float] | float] | None = None,
) -> xr.DataTree:
    """Return the a-priori database of outputs of one program.

    Parameters
    ----------
    aircraft : Aircraft
        Name, reference quantities and moment reference point of the coefficients.  Without a
        reference point that of the files is used.
    files : sequence of str or Path
        Outputs of one program for one geometry, as `read_estimates` takes them, or text tables with
        `columns`.
    length_unit : float, optional
        Unit of length of the files, required if they do not state it. [m]
    controls : mapping of str to str, optional
        Control of the files to the product's control with its sign, ``{"elevator": "+delta_e",
        "rudder": "-delta_r"}``; ``""`` leaves a control out.  Required for every control, because
        no file states its sign.
    columns : ColumnMap, optional
        The files are text tables with these columns, of a wind tunnel, CFD or another program.
    reference : EstimateReference, optional
        Reference quantities of files that state none. [m, m2]
    mach : float, optional
        Mach number of files that state none.
    CD0 : float, optional
        Drag coefficient that is added to that of an inviscid program.
    move_reference : bool
        Permit a moment reference point of the aircraft more than 0.1 chord from the moment centre
        of the files.
    stderr : mapping, optional
        As in `aerodb.from_datcom`.

    Returns
    -------
    DataTree
        The database: forces in stability axes, moments and rates in body axes about the aircraft's
        reference point.  The source of its nodes is ``estimate``.

    Raises
    ------
    ParseError
        A file is damaged or not of a known program.
    SchemaError
        A unit, a control, a sign or a reference quantity is missing, numbers contradict each other,
        or the moment centres are far from each other.

    Warns
    -----
    AeromatchWarning
        Reference quantities differ by more than 1 %, the drag has no friction, the model is not
        symmetric, the printed lift slope is not that of the totals, or a value is implausible.
    """
    given = read_estimates(files, columns)
    one = name_controls(_in_metres(given, length_unit, reference), controls or {})
    return build_database(
        aircraft,
        one,
        mach=mach,
        CD0=CD0,
        move_reference=move_reference,
        errors=errors_with(stderr),
    )


def build_database(
    aircraft: Any,
    one: CoefficientSet,
    *,
    errors: PriorErrors,
    mach: float | None = None,
    CD0: float | None = None,
    move_reference: bool = False,
) -> xr.DataTree:
    """Return the a-priori database of a set of coefficients in metres with the product's controls.

    Parameters
    ----------
    aircraft : Aircraft
        Its name, reference quantities and moment reference point are used.
    one : CoefficientSet
    errors : PriorErrors
        Rules of the standard errors.
    mach, CD0, move_reference
        As for `from_estimate`, which states the result, the errors and the warnings.
    """
    if mach is not None and not 0.0 <= mach < _LARGEST_MACH:
        text = f"mach: found {mach:g}; give the Mach number of the files, from 0 to {_LARGEST_MACH}"
        raise SchemaError("estimate", [text])
    one = forces_to_stability(one)
    tables = EstimateTables(one, mach)
    effects = tables.effects()
    for remark in (*one.cautions, *tables.remarks):
        warn_user(f"{one.program}: {remark}")
    prior = _per_radian(errors, effects)
    point = _reference_point(aircraft, one, move_reference)
    effects, prior = _complete_drag(one, effects, prior, CD0)
    by_name = _refer_to_aircraft(effects, one, aircraft, point)
    ranges = find_basic_ranges(by_name["basic"].tables["CL"])
    leaves: dict[str, xr.Dataset] = {}
    for effect in by_name.values():
        leaves |= terms_of_effect(effect, prior, ranges, source="estimate")
    tree = _make_tree(aircraft, one, leaves, point)
    tree, findings = note_plausibility(tree, aircraft)
    for finding in findings:
        if finding.kind in ("implausible", "unused"):
            warn_user(str(finding))
    return tree


def _in_metres(
    given: CoefficientSet, length_unit: float | None, reference: EstimateReference | None
) -> CoefficientSet:
    """Return a set whose reference quantities are known and in metres."""
    name = ", ".join(given.files[:3])
    if given.reference is None:
        if reference is None:
            raise SchemaError(
                "estimate",
                [
                    f"{name} states no reference quantities; give S, cbar, b and the moment "
                    f"centre x of the coefficients"
                ],
            )
        return replace(given, reference=reference, unit_stated=True)
    if reference is not None:
        raise SchemaError(
            "estimate", [f"{name} states its reference quantities; leave out S, cbar, b, x"]
        )
    if not given.unit_stated and length_unit is None:
        S, cbar = given.reference.S, given.reference.cbar
        raise SchemaError(
            "estimate",
            [
                f"length_unit: {name} does not state the unit of S {S:g} and cbar {cbar:g}; give "
                f"it, such as ft"
            ],
        )
    return given.with_units(length_unit or 1.0)


def _per_radian(prior: PriorErrors, effects: Sequence[Effect]) -> PriorErrors:
    """Return the rules with absolute errors per radian for derivatives of controls.

    The absolute error of a control's term is that of an increment at a usual deflection.
    """
    terms = dict(prior.terms)
    for effect in effects:
        if effect.regressor not in CONTROLS:
            continue
        for coefficient in effect.tables:
            name = f"{coefficient}/{effect.name}"
            relative, absolute = terms[name]
            terms[name] = relative, absolute / _USUAL_DEFLECTION
    return replace(prior, terms=terms)


def _complete_drag(
    one: CoefficientSet, effects: list[Effect], prior: PriorErrors, CD0: float | None
) -> tuple[list[Effect], PriorErrors]:
    """Return the effects with the friction drag added; without it the standard error is wide."""
    if CD0 is not None and not one.inviscid:
        raise SchemaError(
            "estimate", [f"CD0: the drag of {', '.join(one.files[:3])} has friction; leave CD0 out"]
        )
    if CD0 is not None and not 0.0 <= CD0 < 1.0:
        raise SchemaError(
            "estimate", [f"CD0: found {CD0:g}; give the friction drag coefficient, from 0 to 1"]
        )
    if CD0 is not None and not _USUAL_CD0[0] <= CD0 <= _USUAL_CD0[1]:
        warn_user(
            f"CD0 = {CD0:g} is unusual: the friction drag coefficient of an aeroplane is "
            f"{_USUAL_CD0[0]:g} to {_USUAL_CD0[1]:g}, of most 0.02 to 0.04; correct it"
        )
    if CD0 is None:
        if not one.inviscid:
            return effects, prior
        warn_user(
            f"{one.program}: the drag has no friction; give CD0, or identify CD/basic from flight: "
            f"its standard error is {_NO_FRICTION:g}"
        )
        return effects, prior.widened({"CD/basic": _NO_FRICTION})
    completed = []
    for effect in effects:
        if effect.name == "basic":
            tables = dict(effect.tables) | {"CD": effect.tables["CD"] + CD0}
            effect = effect.with_tables(tables, f"CD0 {CD0:g} added")
        completed.append(effect)
    return completed, prior


def _reference_point(aircraft: Aircraft, one: CoefficientSet, move_reference: bool) -> Point:
    """Return the moment reference point of the aircraft, by default that of the files. [m]"""
    centre = _require_reference(one)
    # Drawing: x aft, z up. Aircraft: x forward, z down. 0.0 - z avoids -0.
    own = (-centre.x, 0.0, 0.0 - centre.z)
    if aircraft.reference is None:
        warn_user(
            f"the aircraft file gives no reference; the moment reference point is that of "
            f"{one.files[0]}, {centre.x:.4g} m aft: cg and all positions of the aircraft file "
            f"count from there"
        )
        return own
    x, y, z = map(float, aircraft.reference)
    distance = float(np.hypot(own[0] - x, own[2] - z)) / aircraft.cbar
    problems = []
    if abs(y - centre.y) > NEAR * aircraft.cbar:
        problems.append(
            f"the moment centres are {y - centre.y:.4f} m from each other along y; both must lie "
            f"in the plane of symmetry"
        )
    if distance > FAR and not move_reference:
        problems.append(
            f"reference [{x:.4g}, 0, {z:.4g}] m lies {distance:.2g} chords from the moment centre "
            f"of {one.files[0]} (reference = [{own[0]:.4g}, 0, {own[2]:.4g}]): the files may have "
            f"another unit or another origin of the drawing; correct that, or state "
            f"move_reference to have the moments transferred"
        )
    if problems:
        raise SchemaError("aircraft", problems)
    return x, 0.0, z


def _require_reference(one: CoefficientSet) -> EstimateReference:
    assert one.reference is not None  # `_in_metres` raises without
    return one.reference


def _refer_to_aircraft(
    effects: Sequence[Effect], one: CoefficientSet, aircraft: Aircraft, point: Point
) -> dict[str, Effect]:
    """Return the effects by name for the aircraft's quantities, body axes and reference point."""
    centre = _require_reference(one)
    old = {"S": centre.S, "cbar": centre.cbar, "b": centre.b}
    new = {"S": aircraft.S, "cbar": aircraft.cbar, "b": aircraft.b}
    if text := describe_other_quantities(old, new):
        warn_user(f"{one.program}: {text}")
    by_name = {one.name: change_reference_quantities(one, old, new) for one in effects}
    alpha = by_name["basic"].tables["CL"]["alpha"]
    for name in _CONTROLS:
        # A derivative has the axes of the controls, a difference of totals those of the totals.
        if name not in by_name:
            continue
        axes = one.moment_axes
        if by_name[name].regressor:
            axes = one.control_axes
        if axes == "stability":
            by_name[name] = rotate_rolling_to_body(by_name[name], alpha)
    if one.moment_axes == "stability":
        if "beta" in by_name:
            by_name["beta"] = rotate_rolling_to_body(by_name["beta"], alpha)
        # A rate without derivatives counts as zero in those of the other one.
        rates = [by_name.get(name, Effect(name, {}, name)) for name in ("phat", "rhat")]
        for effect in rates_to_body(*rates):
            if effect.tables:
                by_name[effect.name] = effect
    d = (-centre.x - point[0], 0.0, -centre.z - point[2])
    if np.hypot(d[0], d[2]) <= NEAR * aircraft.cbar:
        return by_name
    lengths = {"cbar": aircraft.cbar, "b": aircraft.b}
    given = {name: set(effect.tables) for name, effect in by_name.items()}
    for name, effect in by_name.items():
        by_name[name] = transfer_moments(effect, d, **lengths, alpha=alpha)
    # Flow angles at the new point change with the rates.
    if "beta" in by_name:
        changes = rate_shift(by_name["basic"], by_name["beta"], d, **lengths)
        for name, tables in changes.items():
            if name in by_name:
                by_name[name] = with_added(by_name[name], tables)
    return {name: without_partial_sums(effect, given[name]) for name, effect in by_name.items()}


def _make_tree(
    aircraft: Aircraft, one: CoefficientSet, leaves: Mapping[str, xr.Dataset], point: Point
) -> xr.DataTree:
    """Return the database of the terms, in the order of the scheme."""
    return make_prior_database(
        aircraft,
        {name: leaf.assign_attrs({ORIGIN: one.program}) for name, leaf in leaves.items()},
        point,
        source=one.program,
        history=f"from_estimate: {one.program} from {', '.join(one.files)}",
        comment="; ".join(one.remarks),
    )
