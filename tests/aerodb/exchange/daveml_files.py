"""Small DAVE-ML files for the tests of the import, and the samples of NASA."""

from pathlib import Path

import numpy as np
import pytest

import aerodb
from aerodb.exchange.daveml.document.reading import read
from flightmech.units import DEGREE, FOOT

FLIGHT = Path(__file__).parents[3] / ".." / "shared" / "data" / "flight"
EXAMPLES = FLIGHT / "aero_databases" / "daveml_examples"
NESC = FLIGHT / "nesc_checkcases" / "models"
samples = pytest.mark.skipif(not NESC.exists(), reason="needs the DAVE-ML samples of ../shared")

S, CBAR, B = 20.0, 2.0, 8.0  # m2, m, m, of the model below
ROUNDING = 1e-13  # some hundred roundings of coefficients of size 1


def variable(name, inside="", varID="", **attributes):
    more = "".join(f' {key}="{text}"' for key, text in {"units": "nd", **attributes}.items())
    return f'<variableDef name="{name}" varID="{varID or name}"{more}>{inside}</variableDef>'


def apply(operator, *arguments):
    return f"<apply><{operator}/>{''.join(arguments)}</apply>"


def ci(name):
    return f"<ci>{name}</ci>"


def cn(value):
    return f"<cn>{value!r}</cn>"


def made(math, more="<isOutput/>"):
    return f"<calculation><math>{math}</math></calculation>{more}"


def table(output, values, **points):
    """Return a function; a value of `points` is the breakpoints, or those and attributes."""
    axes = ""
    for name, given in points.items():
        numbers, attributes = given if isinstance(given, tuple) else (given, "")
        axes += (
            f'<independentVarPts varID="{name}" '
            f"{attributes}>{' '.join(map(repr, numbers))}</independentVarPts>"
        )
    return (
        f'<function name="{output}">{axes}<dependentVarPts '
        f'varID="{output}">{" ".join(map(repr, values))}</dependentVarPts></function>'
    )


GEOMETRY = (
    variable("referenceWingArea", varID="SREF", units="m2", initialValue=f"{S}")
    + variable("referenceWingChord", varID="CBAR", units="m", initialValue=f"{CBAR}")
    + variable("referenceWingSpan", varID="BSPAN", units="m", initialValue=f"{B}")
)
ANGLES = (
    variable("angleOfAttack", "<isInput/>", "AL", units="deg")
    + variable("angleOfSideslip", "<isInput/>", "BE", units="deg")
    + variable("mach", "<isInput/>", "XMACH")
    + variable("rudderDeflection", "<isInput/>", "RUD", units="deg", sign="TEL")
    + variable("elevatorDeflection", "<isInput/>", "EL", units="deg", sign="TEU")
    + variable("trueAirspeed", "<isInput/>", "VT", units="ft_s", minValue="0.1")
    + variable("bodyAngularRate_Roll", "<isInput/>", "PB", units="deg_s")
    + variable("angleOfAttackRate", "<isInput/>", "ALDOT", units="rad_s")
    + variable("x_cg", "<isInput/>", "XCG", units="nd")
)


def document(tmp_path, body):
    head = (
        '<fileHeader name="lifting body"><author name="A" org="B"/><creationDate '
        'date="2020-01-01"/></fileHeader>'
    )
    variables, functions = body
    path = tmp_path / "model.dml"
    path.write_text(f"<DAVEfunc>{head}{GEOMETRY}{ANGLES}{variables}{functions}</DAVEfunc>")
    return path


def one(tmp_path, math, tables="", functions="", name="liftCoefficient"):
    """Return a file with one coefficient."""
    return document(tmp_path, (tables + variable(name, made(math), "OUT"), functions))


def states(count=2000, seed=7):
    """Return states in SI by canonical name, inside the tables and well beyond."""
    random = np.random.default_rng(seed)
    drawn = {
        "alpha": np.radians(random.uniform(-60, 60, count)),
        "beta": np.radians(random.uniform(-50, 50, count)),
        "mach": random.uniform(-0.5, 3.0, count),
        "delta_r": np.radians(random.uniform(-60, 60, count)),
        "delta_e": np.radians(random.uniform(-60, 60, count)), "V": random.uniform(20, 300, count),
        "p": random.uniform(-2, 2, count),
        "alpha_dot": random.uniform(-1, 1, count), "x_cg": random.uniform(0.1, 0.6, count),
    }  # fmt: skip
    return drawn | {
        "phat": drawn["p"] * B / (2.0 * drawn["V"]),
        "alphadothat": drawn["alpha_dot"] * CBAR / (2.0 * drawn["V"]),
    }


def in_file(state):
    return {
        "AL": state["alpha"] / DEGREE, "BE": state["beta"] / DEGREE, "XMACH": state["mach"],
        "RUD": state["delta_r"] / DEGREE,
        "EL": -state["delta_e"] / DEGREE, "VT": state["V"] / FOOT, "PB": state["p"] / DEGREE,
        "ALDOT": state["alpha_dot"],
        "XCG": state["x_cg"],
    }  # fmt: skip


def difference(path, coefficient="CL", output="OUT"):
    """Return the database of a file and its largest difference from the model, in terms of the sum
    of contributions.
    """
    db, state = aerodb.exchange.import_daveml(path), states()
    parts = aerodb.contributions(db, coefficient, state, outside="clamp")
    expected = read(path).evaluate(in_file(state))[output]
    size = np.maximum(sum(np.abs(part) for part in parts.values()), 1.0)
    return db, float(np.max(np.abs(sum(parts.values()) - expected) / size))


def values(*shape):
    return np.random.default_rng(sum(shape)).uniform(-1.0, 1.0, int(np.prod(shape))).tolist()


ALPHAS, MACHS, RUDDERS, BETAS = (
    [-10.0, 0.0, 10.0, 25.0],
    [0.3, 0.9, 2.0],
    [0.0, 15.0, 30.0],
    [0.0, 5.0, 20.0],
)
