"""Run JSBSim apart from the tests, because it ends the whole process when it does not like a file.

Reads from standard input a JSON object: ``file``, ``shipped`` (an aircraft of the package),
``make`` (properties that another program would have made), ``states`` (a list of {property: value}
set before the start), ``commands`` (a list of the same length, set after it), ``settle``
(evaluations at the state reached, without a step), ``follow`` (properties that then take a multiple
of others, as [target, source, factor]) and ``read``.  Writes the list of readings after one step of
each.
"""

import json
import math
import sys
from pathlib import Path

import jsbsim


def main() -> None:
    """Fly the job of standard input."""
    job = json.load(sys.stdin)
    path = Path(job["file"])
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    folders = [str(path.parent)] * 3
    if not (
        fdm.load_model(path.stem)
        if job["shipped"]
        else fdm.load_model_with_paths(path.stem, *folders, False)
    ):
        sys.exit(f"JSBSim does not load {path}")
    properties = fdm.get_property_manager()
    for name in job["make"]:
        properties.get_node(name, True)
    found = []
    for state, commands in zip(job["states"], job["commands"]):
        for name, value in state.items():
            fdm[name] = value
        fdm.run_ic()
        for name, value in commands.items():
            fdm[name] = value
        fdm.run()
        if job["settle"]:
            rest(fdm, job["settle"], job["follow"])
        found.append([reading(fdm, name) for name in job["read"]])
    print("\n" + json.dumps(found))


def rest(fdm: jsbsim.FGFDMExec, count: int, follow: list) -> None:
    """Evaluate the same state again and again, until the controls are at rest and the lift of the
    step before is that of the step.
    """
    fdm.suspend_integration()
    for _ in range(count):
        fdm.run()
    for target, source, factor in follow:
        fdm[target] = fdm[source] * factor
    for _ in range(3):
        fdm.run()
    fdm.resume_integration()


def reading(fdm: jsbsim.FGFDMExec, name: str) -> float:
    """Return a property, NaN for one that the aircraft does not have."""
    try:
        return fdm[name]
    except KeyError:
        return math.nan


if __name__ == "__main__":
    main()
