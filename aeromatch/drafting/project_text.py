"""Text of a drafted project file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from aeromatch.drafting.flown import FitDraft
from aeromatch.drafting.geometry import Geometry, given_terms
from aeromatch.drafting.name_map.names import NamesDraft
from aeromatch.drafting.sources import Sources, quote
from aeromatch.project.schemas import schema_lines
from flightmech.quantities import time_text
from flightmech.support.toml_quantities import UNFILLED


def project_text(
    folder: Path,
    geometry: Geometry,
    sources: Sources,
    names: NamesDraft,
    fits: Sequence[FitDraft],
    has_cases: bool,
    name: str,
    has_table: bool,
    has_thrust: bool = True,
) -> str:
    """Return the text of a project file.

    Parameters
    ----------
    folder : Path
        Folder of the project; paths in the text are relative to it.
    geometry : Geometry
    sources : Sources
    names : NamesDraft
    fits : sequence of FitDraft
    has_cases : bool
        Whether the project has a case.
    name : str
        Name of the aircraft; empty if it is not stated.
    has_table : bool
        Whether the project has a table of manoeuvres.
    has_thrust : bool
        Whether every record gives the thrust, without which it is in no fit.
    """
    title = name or geometry.title or folder.resolve().name
    lines = [
        *schema_lines("project"),
        "# Project, drafted by `aeromatch init`: aeromatch match aeromatch.toml -o out.  "
        "Keys: `aeromatch schema`, page reference/project-keys of `./run docs`.",
        f"title = {quote(title)}",
        'aircraft = "aircraft.toml"',
        *_map_lines(folder, names),
        f"flights = {_flight_pattern(folder, sources.records)}   # a record is named by its file "
        f"without extension",
    ]
    if has_table:
        lines.append(
            'manoeuvres = "manoeuvres.csv"   # found in the movements of the controls: '
            "confirm kinds and times"
        )
    lines += [
        'cases = ["cases/*.toml"]' if has_cases else "cases = []",
        '# cutoff = "4 Hz"             # low-pass before coefficients are formed, 2 to 3 '
        "times the fastest mode of motion",
        "",
        *_listing_lines(folder, geometry),
    ]
    lines += _term_lines(geometry, fits)
    if not has_thrust:
        lines += [
            "",
            "# [[fit]]: records whose thrust is neither recorded nor that of a propeller of "
            "aircraft.toml are in no fit.",
        ]
    for fit in fits:
        lines += _fit_lines(fit)
    return "\n".join(lines) + "\n"


def _listing_lines(folder: Path, geometry: Geometry) -> list[str]:
    lines = ["[listings]   # by role; FILE:NUMBER is one case of a listing"]
    for role, places in geometry.places.items():
        # The clean pages have the power effects already.
        if role == "power" and geometry.powered:
            continue
        reasons = {item.reason for item in geometry.roles if role in item.roles}
        paths = [_relative(location, folder) for location in places]
        value = quote(paths[0]) if len(paths) == 1 else _quote_list(paths)
        lines.append(f"{role} = {value}   # {'; '.join(sorted(reasons))}")
    if geometry.powered:
        lines.append(
            "powered = true   # all clean pages hold power effects: the thrust is taken off, "
            "standard errors are wider"
        )
    if "clean" not in geometry.places:
        lines.append(
            f"clean = {quote(UNFILLED)}   # listing of the whole aeroplane: run the deck "
            f"(aeromatch datcom run), then name it here"
        )
    return lines


# Terms that a listing may lack, by their regressor and coefficient, with a standard error about
# zero. The errors are assumptions, about the size of the derivative itself. [1] or [1/rad]
_OPENED = {
    "delta_e": {"CL": 1.0, "CD": 0.1, "Cm": 2.0},
    "delta_a": {"Cl": 0.3, "Cn": 0.05},
    "delta_r": {"CY": 0.3, "Cl": 0.05, "Cn": 0.15},
    "qhat": {"CL": 8.0, "Cm": 20.0},
    "beta": {"CY": 1.0, "Cl": 0.2, "Cn": 0.2},
    "phat": {"CY": 0.3, "Cl": 0.6, "Cn": 0.15},
    "rhat": {"CY": 0.5, "Cl": 0.3, "Cn": 0.3},
    "1": {"CY": 0.01, "Cl": 0.002, "Cn": 0.002},
}
# Name of the term by its regressor, where it is another one.
_TERM_NAMES = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder", "1": "basic"}
# Terms that DATCOM never gives.
_NEVER = {"CY/rhat", *(f"{name}/basic" for name in ("CY", "Cl", "Cn"))}


def _term_lines(geometry: Geometry, fits: Sequence[FitDraft]) -> list[str]:
    """Return the terms of the fits that the listings do not give, zero with a standard error."""
    used: dict[str, None] = {}
    for fit in fits:
        used |= dict.fromkeys(fit.models)
    if not used:
        return []
    given = given_terms(geometry)
    lines = []
    for regressor, errors in _OPENED.items():
        name = _TERM_NAMES.get(regressor, regressor)
        for coefficient, stderr in errors.items():
            is_fitted = any(_has_term(model, coefficient, regressor) for model in used)
            if not is_fitted or _is_given(f"{coefficient}/{name}", given, geometry):
                continue
            keys = "" if regressor == "1" else f"regressors = [{quote(regressor)}], "
            lines.append(f"{quote(f'{coefficient}/{name}')} = {{ {keys}stderr = {stderr:g} }}")
    if not lines:
        return []
    head = (
        "[terms]   # what the listings do not give: zero before flight, with a standard error; "
        "CONFIRM"
    )
    return ["", head, *lines]


def _is_given(term: str, given: frozenset[str] | None, geometry: Geometry) -> bool:
    """Return whether the listings give a term; without a database, by their roles."""
    if given is not None:
        return term in given
    device = term.partition("/")[2]
    if device in ("elevator", "aileron", "rudder"):
        return device in geometry.places
    return term not in _NEVER


def _has_term(model: str, coefficient: str, regressor: str) -> bool:
    left, _, right = model.partition(" = ")
    return left == coefficient and regressor in right.split(" + ")


def _fit_lines(fit: FitDraft) -> list[str]:
    lines = ["", "[[fit]]", f"name = {quote(fit.name)}", f"records = {_quote_list(fit.records)}"]
    if fit.manoeuvres:
        lines.append(f"manoeuvres = {_quote_list(fit.manoeuvres)}")
    if fit.windows:
        spans = ", ".join(f"[{time_text(start)}, {time_text(end)}]" for start, end in fit.windows)
        lines.append(f"window = [{spans}]   # [s]; what a case replays is left out")
    models = [f"    {quote(model)}," for model in fit.models]
    return [*lines, "models = [", *models, "]"]


def map_file(folder: Path, names: NamesDraft) -> Path | None:
    """Return the name map of the project, or None if no map is needed.

    A map of the author is used in place of the drafted one.
    """
    if names.identity:
        return None
    if names.own is not None:
        return Path(names.file)
    return folder / "names.toml"


def _map_lines(folder: Path, names: NamesDraft) -> list[str]:
    """Return the line of a project file that names the map."""
    file = map_file(folder, names)
    if file is None:
        return []
    # A shipped map has a name without a suffix, and no path.
    if not file.suffix:
        return [f"names = {quote(str(file))}"]
    return [f"names = {quote(_relative(str(file), folder))}"]


def _flight_pattern(folder: Path, records: Sequence[Path]) -> str:
    """Return a pattern that matches exactly these records, or else their list."""
    if not records:
        return quote(UNFILLED)
    parents = {file.parent.resolve() for file in records}
    suffixes = {file.suffix for file in records}
    if len(parents) == 1 and len(suffixes) == 1:
        parent, suffix = parents.pop(), suffixes.pop()
        matches = {file.resolve() for file in parent.glob(f"*{suffix}")}
        # A pattern in the folder of the project would match its other files later.
        if matches == {file.resolve() for file in records} and parent != folder.resolve():
            return quote(f"{_relative(str(parent), folder)}/*{suffix}")
    return _quote_list([_relative(str(file), folder) for file in records])


def _relative(path: str, folder: Path) -> str:
    return Path(os.path.relpath(Path(path).resolve(), folder.resolve())).as_posix()


def _quote_list(items: Sequence[str]) -> str:
    return f"[{', '.join(map(quote, items))}]"
