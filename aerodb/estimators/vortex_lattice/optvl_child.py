"""Program of a child process: runs of OptVL, which is AVL as a Python library.

OptVL is under the GPL and is imported here only; the product's process does not import it. The
child gets one line of JSON on standard input, ``{"files": {name: text}, "conditions": [{"mach",
"alpha", "beta"}]}`` with angles in degrees, and writes one line of JSON to standard output:
version, names of the controls and, for each condition, totals and derivatives under OptVL's names.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any


def run_conditions(request: dict[str, Any]) -> dict[str, Any]:
    """Return the results of OptVL for the files and conditions of a request."""
    from optvl import OVLSolver

    with tempfile.TemporaryDirectory() as folder:
        for name, text in request["files"].items():
            (Path(folder) / name).write_text(text, encoding="ascii", errors="replace")
        with contextlib.chdir(folder):
            solver = OVLSolver(geo_file=next(iter(request["files"])))
            results = [_run(solver, condition) for condition in request["conditions"]]
            controls = list(solver.get_control_names())
    version = importlib.metadata.version("optvl")
    return {"version": version, "controls": controls, "results": results}


def _run(solver: Any, condition: dict[str, float]) -> dict[str, dict[str, float]]:
    """Return totals and derivatives of one condition."""
    solver.set_parameter("Mach", condition["mach"])
    solver.set_variable("alpha", condition["alpha"])
    solver.set_variable("beta", condition["beta"])
    solver.execute_run()
    groups = {
        "totals": solver.get_total_forces(),
        "derivatives": solver.get_stab_derivs(),
        "controls": solver.get_control_stab_derivs(),
    }
    plain = {}
    for name, numbers in groups.items():
        plain[name] = {key: float(number) for key, number in numbers.items()}
    return plain


def main() -> None:
    """Answer one request."""
    # The library prints from Fortran: its text goes to standard error.
    answer = os.dup(1)
    os.dup2(2, 1)
    reply = run_conditions(json.loads(sys.stdin.readline()))
    with os.fdopen(answer, "w", encoding="ascii") as stream:
        stream.write(json.dumps(reply) + "\n")


if __name__ == "__main__":
    main()
