"""Write docs/evidence/jsbsim-aircraft.md, the aircraft of JSBSim that `import_jsbsim` reads: ``python
docs/scripts/make_jsbsim_aircraft.py``.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import jsbsim
import numpy as np
import xarray as xr

import aerodb
from aerodb.exchange.jsbsim.properties import NORMALISED
from flightmech.errors import ParseError, SchemaError
from flightmech.units import POUND_FORCE

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "aerodb" / "exchange"))
import jsbsim_flight as flight  # noqa: E402  (the flights of the tests)

PAGE = ROOT / "docs" / "evidence" / "jsbsim-aircraft.md"
AIRCRAFT = Path(jsbsim.get_default_root_dir()) / "aircraft"
TRAVEL = dict.fromkeys(
    ("delta_e", "delta_a", "delta_r", "delta_f"), 0.5
)  # rad at a fraction of 1, where a file does not state it
_PUSHBACK = "/sim/model/pushback/"
FROM_ELSEWHERE = (
    *(_PUSHBACK + name for name in ("position-norm", "ki", "kp", "kd")),
    "/gear/gear/wow",
    "fcs/flaps-pos-deg",
)  # FlightGear's
AT_REST = 3000  # evaluations: 25 s of the control system
STATES = 40
FLAP = "fcs/flap-pos-norm"
MORE = ("propulsion/engine/thrust-lbs", "fcs/throttle-cmd-norm", "aero/cl-squared", FLAP)
HEAD = """# Aircraft of JSBSim

The {count} aircraft files of the pip package `jsbsim` {version}: {alone} are read completely by `import_jsbsim` as they stand, {whole} with
`travel` where a file states a position as a fraction and not of which angle (10 and 13 before a coefficient could depend on another).
`docs/scripts/make_jsbsim_aircraft.py` writes this page.

*Forces*, *moments*: largest difference between the database and JSBSim's own forces and moments, over the length of the vector, at
{states} random states far beyond ordinary flight (alpha to 35 deg, beta to 20 deg, rates to 1 rad/s, random controls; two vectors of zero
agree). JSBSim computes `aero/cl-squared` at the beginning of a step: the lift of the **step before** over the **present** dynamic pressure.
*Its CL* takes this CL as a given condition, so that the same step is compared; *same instant* takes the sum of our lift terms, and JSBSim's
forces after {rest} evaluations of the same state without a step, when the control system is at rest and both lifts are one.
"""
NOTES = """
- *travel*: controls for which 0.5 rad was given. In these files the control system moves only the fraction, or only the angle, of such a
  control (that of the L-17 neither: it scales `fcs/flaps-pos-deg`, which nothing sets); for the comparison the other one follows.
- {late}: the control system does not come to rest, so that JSBSim's step before is another state.
- The file of the F450 is in metres, and JSBSim takes 3.2808399 ft for one: 3e-9 of an area. ball and ballx have no forces.
"""


def main() -> None:
    """Read all aircraft, fly those that are read, and write the page."""
    rows = [
        row(folder.name)
        for folder in sorted(AIRCRAFT.iterdir(), key=lambda path: path.name.lower())
        if folder.is_dir()
    ]
    read = [cells for cells in rows if cells[1] == "read"]
    table = [
        "| aircraft | | travel | forces, its CL | moments | forces, same instant | moments |",
        "| --- | --- | --- | ---: | ---: | ---: | ---: |",
    ]
    alone = sum(not cells[2] for cells in read)
    late = [cells[0] for cells in read if float(cells[5]) > 1e-8]
    head = HEAD.format(
        count=len(rows),
        version=jsbsim.__version__,
        alone=alone,
        whole=len(read),
        states=STATES,
        rest=AT_REST,
    )
    lines = [head, *table, *("| " + " | ".join(cells) + " |" for cells in rows)]
    PAGE.write_text("\n".join(lines) + "\n" + NOTES.format(late=", ".join(late)))


def row(name: str) -> tuple[str, ...]:
    """Return the cells of an aircraft."""
    path = AIRCRAFT / name / f"{name}.xml"
    given: list[str] = []
    while True:
        try:
            db = aerodb.exchange.import_jsbsim(
                path, travel={variable: TRAVEL[variable] for variable in given}
            )
        except ParseError as error:
            return name, f"refused: `{error.found}`", "", "", "", "", ""
        except SchemaError as error:
            more = [
                variable
                for variable in TRAVEL
                if variable not in given and f"{{'{variable}':" in str(error)
            ]
            if not more:
                count = len(error.problems)
                return (
                    name,
                    f"{count} function{'s' if count > 1 else ''} refused",
                    "",
                    "",
                    "",
                    "",
                    "",
                )
            given += more
        else:
            return (
                name,
                "read",
                " ".join(given),
                *(f"{value:.0e}" for value in differences(path, db, given)),
            )


def differences(path: Path, db: xr.DataTree, given: list[str]) -> tuple[float, ...]:
    """Return the largest relative differences of forces and moments, with JSBSim's CL and with ours
    at rest.
    """
    states, commands = flight.states(STATES, seed=2)
    follow, text = following(path, given), path.read_text(errors="replace")
    both = all(
        f"<property>fcs/{side}-aileron-pos" in text.replace(" ", "") for side in ("left", "right")
    )
    craft = SimpleNamespace(**{key: db.attrs[key] for key in ("S", "cbar", "b")}, x_ref_mac=0.25)
    found, F, M = flight.fly(path, states, commands, MORE, True, AT_REST, follow, FROM_ELSEWHERE)
    at = flight.conditions(found, craft)
    at |= {"engine1.thrust": found[MORE[0]] * POUND_FORCE, "engine1.throttle": found[MORE[1]]}
    if FLAP in [source for _, source, _ in follow]:  # the angle may have a scaling of its own
        at["delta_f"] = found[FLAP] * TRAVEL["delta_f"]
    if not both:
        at["delta_a"] = -found["left"]
    own: list[float] = []
    for conditions in (at | {"CL": np.sqrt(found[MORE[2]])}, at):
        force, moment = flight.loads(db, conditions, craft)
        own += [apart(force, F), apart(moment, M)]
    return tuple(own)


def following(path: Path, given: list[str]) -> list[tuple[str, str, float]]:
    """Return which of angle and fraction follows the other, for controls whose travel the file does
    not state.
    """
    text, found = path.read_text(errors="replace").replace(" ", ""), []
    for fraction, (variable, _) in NORMALISED.items():
        angle = fraction.replace("-norm", "-rad")
        if variable in given and f"<output>{fraction}</output>" in text:
            found.append((angle, fraction, TRAVEL[variable]))
        elif variable in given:
            found.append((fraction, angle, 1.0 / TRAVEL[variable]))
    return found


def apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the largest difference of components over the length of their vector; equal ones
    differ by zero.
    """
    lengths = np.linalg.norm(theirs, axis=1, keepdims=True)
    gap = np.abs(ours - theirs)
    return float(np.divide(gap, lengths, out=np.zeros_like(gap), where=gap > 0.0).max())


if __name__ == "__main__":
    main()
