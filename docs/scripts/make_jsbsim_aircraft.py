"""Write docs/evidence/jsbsim-aircraft.md, the aircraft of JSBSim that `import_jsbsim` reads:
``python docs/scripts/make_jsbsim_aircraft.py``.
"""

from __future__ import annotations

import re
import sys
import textwrap
import warnings
from pathlib import Path
from types import SimpleNamespace

import jsbsim
import numpy as np
import xarray as xr

import aerodb
import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchWarning, ParseError, SchemaError
from flightmech.units import DEGREE, FOOT, POUND, POUND_FORCE, SLUG

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "aerodb" / "exchange"))
import jsbsim_flight as flight  # noqa: E402  (the flights of the tests)

PAGE = ROOT / "docs" / "evidence" / "jsbsim-aircraft.md"
AIRCRAFT = Path(jsbsim.get_default_root_dir()) / "aircraft"
_PUSHBACK = "/sim/model/pushback/"
FROM_ELSEWHERE = (
    *(_PUSHBACK + name for name in ("position-norm", "ki", "kp", "kd")),
    "/gear/gear/wow",
    "fcs/flaps-pos-deg",
    "systems/radar/range",
    "/controls/flight/wing-fold",
)  # of FlightGear
AT_REST = 3000  # evaluations: 25 s of the control system
AT_ONCE = ("paraglider",)  # JSBSim's own motion diverges within the evaluations of AT_REST
STATES = 40
LATE = 1e-8  # above it the control system had not come to rest
MORE = ("propulsion/engine/thrust-lbs", "fcs/throttle-cmd-norm", "aero/cl-squared")
INPUT = re.compile(r"([^ ,:]+) is (device\.\w+\.\w+)")
HEAD = """# Aircraft of JSBSim

Of the {count} aircraft files of the pip package `jsbsim` {version}, {whole} become a database and
an aircraft by `import_jsbsim` and `import_jsbsim_aircraft` as they stand, without options.
`docs/scripts/make_jsbsim_aircraft.py` writes this page. In brackets: the number of properties
outside the vocabulary that became inputs, `device.*`.

"""
FIGURES = """
Largest difference between the database and JSBSim, over the length of the vector, at {states}
random states far beyond ordinary flight (alpha to 35 deg, beta to 20 deg, rates to 1 rad/s): forces
{forces}, moments {moments}, F450 excepted. Mass and moments of inertia: {mass}, F450 excepted.

- JSBSim takes `aero/cl-squared` of the **step before**, and the comparison uses its CL. With the
  lift of the same instant, and JSBSim after {rest} evaluations of the same state, they are below
  1e-8 but for {late}: {worst} at most. Their control system does not come to rest.
- paraglider: only states at which the first step of JSBSim does not diverge.
- The file of the F450 is in metres, and JSBSim takes 3.2808399 ft for one: 3e-9 of an area; its
  unit of inertia is rounded to 9e-5. ball and ballx have no forces.

| aircraft | not read |
| --- | --- |
"""


def main() -> None:
    """Read all aircraft, fly those that are read, and write the page."""
    rows = [
        row(folder.name)
        for folder in sorted(AIRCRAFT.iterdir(), key=lambda path: path.name.lower())
        if folder.is_dir()
    ]
    read = [cells for cells in rows if cells[1] == "read"]
    listed = [f"`{name}` ({count})" if count else f"`{name}`" for name, _, count, *_ in read]
    plain = [cells for cells in read if cells[0] != "F450"]
    late = [cells for cells in plain if not float(cells[5]) < LATE]
    head = HEAD.format(count=len(rows), version=jsbsim.__version__, whole=len(read))
    figures = FIGURES.format(
        states=STATES,
        rest=AT_REST,
        forces=largest(plain, 3),
        moments=largest(plain, 4),
        mass=largest(plain, 7),
        late=", ".join(cells[0] for cells in late),
        worst=largest(late, 5),
    )
    names = textwrap.fill("Read: " + ", ".join(listed) + ".", 100) + "\n"
    refused = "".join(f"| {cells[0]} | {cells[1]} |\n" for cells in rows if cells[1] != "read")
    PAGE.write_text(head + names + figures + refused)


def largest(rows: list[tuple[str, ...]], column: int) -> str:
    """Return the largest figure of a column."""
    return f"{max(float(cells[column]) for cells in rows):.0e}"


def row(name: str) -> tuple[str, ...]:
    """Return the cells of an aircraft."""
    path = AIRCRAFT / name / f"{name}.xml"
    empty = ("",) * 6
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AeromatchWarning)
            db = aerodb.exchange.import_jsbsim(path)
        craft = aerodb.exchange.import_jsbsim_aircraft(path)
        flightmech.compile(craft, db)
    except ParseError as error:
        return name, f"refused: `{error.found}`", *empty
    except SchemaError as error:
        count = len(error.problems)
        return name, f"{count} function{'s' if count > 1 else ''} refused", *empty
    inputs = INPUT.findall(db.attrs["comment"])
    figures = [*differences(path, db, inputs), mass_difference(name, craft)]
    return name, "read", str(len(inputs) or ""), *(f"{value:.0e}" for value in figures)


def differences(path: Path, db: xr.DataTree, inputs: list[tuple[str, str]]) -> list[float]:
    """Return the largest relative differences of forces and moments, with JSBSim's CL and with ours
    at rest.
    """
    states, commands = flight.states(STATES, seed=2)
    text = path.read_text(errors="replace")
    both = all(
        f"<property>fcs/{side}-aileron-pos" in text.replace(" ", "") for side in ("left", "right")
    )
    craft = SimpleNamespace(**{key: db.attrs[key] for key in ("S", "cbar", "b")}, x_ref_mac=0.25)
    more = (*MORE, *(name for name, _ in inputs))
    rest = 0 if path.stem in AT_ONCE else AT_REST
    found, F, M = flight.fly(path, states, commands, more, True, rest, (), FROM_ELSEWHERE)
    at = flight.conditions(found, craft)
    at |= {"engine1.thrust": found[MORE[0]] * POUND_FORCE, "engine1.throttle": found[MORE[1]]}
    for name, variable in inputs:
        at[variable] = found[name] * (DEGREE if name.endswith("deg") else 1.0)
    if not both:
        at["delta_a"] = -found["left"]
    own: list[float] = []
    for conditions in (at | {"CL": np.sqrt(found[MORE[2]])}, at):
        force, moment = flight.loads(db, conditions, craft)
        own += [apart(force, F), apart(moment, M)]
    return own


def mass_difference(name: str, craft: Aircraft) -> float:
    """Return the largest relative difference of mass and moments of inertia from JSBSim's."""
    program = jsbsim.FGFDMExec(None)
    program.set_debug_level(0)
    program.load_model(name)
    for made in FROM_ELSEWHERE:
        program.get_property_manager().get_node(made, True)
    program.run_ic()
    pairs = [(craft.mass, program["inertia/weight-lbs"] * POUND)]
    for axis in ("Ixx", "Iyy", "Izz"):
        value = program[f"inertia/{axis.lower()}-slugs_ft2"] * SLUG * FOOT**2
        pairs.append((getattr(craft, axis), value))
    return max(abs(ours - theirs) / max(abs(theirs), 1e-300) for ours, theirs in pairs)


def apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the largest difference of components over the length of their vector; equal ones
    differ by zero.

    States at which JSBSim diverged are left out.
    """
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(theirs, axis=1)
    is_finite = np.isfinite(lengths)
    if not is_finite.any():
        raise ValueError("JSBSim diverged at all states")
    gap = np.abs(ours - theirs)[is_finite]
    # The comparison is negated so that a NaN of ours counts as a difference.
    share = np.divide(gap, lengths[is_finite][:, None], out=np.zeros_like(gap), where=~(gap == 0.0))
    return float(share.max())


if __name__ == "__main__":
    main()
