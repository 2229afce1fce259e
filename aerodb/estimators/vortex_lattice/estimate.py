"""A-priori database of an aeroplane by the second estimator, from its DATCOM decks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from aerodb.estimators.build import build_database
from aerodb.estimators.conventions import name_controls
from aerodb.estimators.vortex_lattice.geometry import ThinSurfaceModel, model_of_decks
from aerodb.estimators.vortex_lattice.lattice import PROGRAM, compute_coefficients
from aerodb.prior.prior_errors import choose_errors
from datcom_io.decks.deck_file import read_deck
from flightmech.errors import SchemaError


@dataclass(frozen=True)
class _DeckAircraft:
    """Name, reference quantities and reference point of an aeroplane that only has a deck."""

    name: str
    S: float
    cbar: float
    b: float
    reference: tuple[float, float, float]


def from_decks(
    decks: Sequence[str | Path],
    aircraft: Any = None,
    *,
    rudder: tuple[float, float, float] | None = None,
    with_body: bool = False,
    CD0: float | None = None,
    move_reference: bool = False,
    stderr: Mapping[str, tuple[float, float] | float] | None = None,
    errors: str = "calibrated",
) -> xr.DataTree:
    """Return the a-priori database that a vortex lattice gives for the geometry of decks.

    Parameters
    ----------
    decks : sequence of path
        Input decks of DATCOM: wing, tails, body, reference quantities and moment centre, Mach
        numbers and angles of attack.  SYMFLP on the tail is the elevator, on the wing the flap,
        ASYFLP with STYPE 4 the aileron.  Several decks of one aeroplane may give one control each.
    aircraft : Aircraft, optional
        Name, reference quantities and moment reference point; by default those of the deck.
    rudder : tuple of float, optional
        Share of the chord of the fin behind the hinge, and start and end of the rudder as shares of
        the span of the fin.
    with_body : bool
        Whether the body is modelled by slender-body theory.  Without it the calibrated errors are
        smaller.
    CD0 : float, optional
        Friction drag that is added.
    move_reference, stderr
        As in `aerodb.from_estimate`.
    errors : {"calibrated", "guide"}
        Standard errors and ratios of the calibration on aircraft with published derivatives, or
        the errors of the identification guide without a ratio.

    Returns
    -------
    DataTree
        As of `aerodb.from_estimate`.  Absent are the derivatives with respect to the rate of alpha
        and all that the model lacks, which its comment states.

    Raises
    ------
    AeromatchError
        The package optvl is not installed.
    SchemaError
        The decks are not of one aeroplane, lack a wing, or the rudder is not on the fin.
    UnknownName
        `stderr` or `errors` has an unknown name.
    SimulationError
        The program failed on the geometry.

    Warns
    -----
    AeromatchWarning
        As `aerodb.from_estimate`, and if the panels are too coarse.
    """
    if not decks:
        raise SchemaError("deck", ["no deck; give an input deck of DATCOM (.inp)"])
    if rudder is not None:
        _check_rudder(rudder)
    program = f"{PROGRAM} with body" if with_body else PROGRAM
    rules = choose_errors(errors, program, stderr)
    model = model_of_decks([read_deck(path) for path in decks], rudder)
    one = compute_coefficients(model, with_body=with_body)
    one = name_controls(one, {name: f"+{name}" for name in one.controls})
    return build_database(
        aircraft or _aircraft_of(model),
        one,
        errors=rules,
        CD0=CD0,
        move_reference=move_reference,
    )


def _aircraft_of(model: ThinSurfaceModel) -> _DeckAircraft:
    """Return the aircraft that the cards of a deck describe."""
    r = model.reference
    return _DeckAircraft(model.title, r.S, r.cbar, r.b, (-r.x, 0.0, -r.z))


def _check_rudder(rudder: tuple[float, float, float]) -> None:
    """Raise for a rudder that is not on the fin."""
    share, start, end = rudder
    if not (0.0 < share <= 1.0 and 0.0 <= start < end <= 1.0):
        raise SchemaError(
            "rudder",
            [
                f"{share:g}, {start:g}, {end:g}; give the share of the chord behind the hinge, "
                f"above 0 and up to 1, and start and end as shares of the span of the fin, such as "
                f"0.35,0,1"
            ],
        )
