"""Run JSBSim apart from the tests, because it ends the whole process when it does not like a file.

Reads from standard input a JSON object: ``file``, ``states`` (a list of {property: value} set before the start), ``commands``
(a list of the same length, set after it), ``read`` (properties) and ``shipped`` (an aircraft of
the package).  Writes the list of readings after one step of each.
"""

import json
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
    if not (fdm.load_model(path.stem) if job["shipped"] else fdm.load_model_with_paths(path.stem, *folders, False)):
        sys.exit(f"JSBSim does not load {path}")
    found = []
    for state, commands in zip(job["states"], job["commands"]):
        for name, value in state.items():
            fdm[name] = value
        fdm.run_ic()
        for name, value in commands.items():
            fdm[name] = value
        fdm.run()
        found.append([fdm[name] for name in job["read"]])
    print("\n" + json.dumps(found))


if __name__ == "__main__":
    main()
