"""Form of a case file: its tables and keys, each with a description that editors show."""

from __future__ import annotations

import re
from typing import Any, Literal

from pydantic import ConfigDict, Field, StrictBool, field_validator

from flightmech.aircraft.controls import DEVICE
from flightmech.aircraft.facts import FactsTable
from flightmech.names import VOCABULARY, lookup
from flightmech.quantities import time_text
from flightmech.support.toml_models import Strict, file_schema, part_schema
from flightmech.support.toml_quantities import quantity_schema
from pom.cases.signatures import Role, Signature
from pom.tolerances import rows
from pom.tolerances.overrides import ToleranceOverride

# Canonical names that a case file may state, by kind.
INITIAL = ("V", "alpha", "beta", "gamma", "phi", "theta", "psi", "p", "q", "r", "h", "lat", "lon")
MASS = ("mass", "x_cg_b", "y_cg_b", "z_cg_b", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
SURFACES = (
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_t",
    "delta_ta",
    "delta_tr",
    "delta_f",
    "delta_s",
    "delta_d",
)
BRAKES = ("brake_left", "brake_right")
INPUTS = (*SURFACES, "gear", "speedbrake", "delta_nw", *BRAKES)
TRAVEL = ("column", "wheel", "pedal")
FORCES = ("F_column", "F_wheel", "F_pedal")
WIND = ("wind_n", "wind_e", "wind_d")
# Levers and switches of an engine besides its power lever, without the number of the engine.
LEVERS = ("prop_command", "feather", "mixture", "cutoff", "starter", "ignition", "flameout")
ENGINE_LEVER = re.compile(rf"^engine[1-8]\.(?:{'|'.join(LEVERS)})$")
# Valves and pumps of the fuel system.
FUEL_SWITCH = re.compile(r"^(?:crossfeed|tank\.\w+\.cutoff|transfer\.\w+\.\w+\.pump)$")
CONDITIONS = (
    *INPUTS,
    *TRAVEL,
    *FORCES,
    *WIND,
    *INITIAL,
    *MASS,
    "delta_T",
    "runway_elevation",
    "wheel_radius",
)
SHOWN = ("V_cas", "h", "alpha", "beta", "phi", "theta", "psi", "p", "q", "r", "nz")

_SHORTEST_WINDOW = 0.2  # [s]
_NAME = re.compile(r"\w[\w.-]{0,99}")  # part of file names and links
Quantity = float | str  # a number in SI, or a text with its unit
Texts = dict[str, str]


def _free_table(text: str, **example: Any) -> Any:
    """Return the field of a table with free keys, empty by default."""
    examples = [example] if example else None
    return Field(default_factory=dict, description=text, examples=examples)


class CaseTable(Strict):
    """What is tested, on which record, over which window."""

    # nan and inf are answered with the name of the quantity when the file is resolved
    model_config = ConfigDict(allow_inf_nan=True)

    id: str = Field(description="Test of the tolerance table, such as 2.c.10.")
    standard: str = Field(default=rows.STANDARD, description="Standard of the tolerance table.")
    edition: str = Field(default=rows.EDITION, description="Edition of the standard.")
    tolerances: str = Field(
        default="",
        examples=["company.csv"],
        description="Tolerance table of the user that holds standard and edition. Relative to this "
        "file.",
    )
    name: str = Field(description="Short name of the case, for files and links.")
    # a trial adds words to the title of its case
    title: str = Field(max_length=500, description="Title for people.")
    description: str = Field(default="", description="What was flown.")
    record: str = Field(
        description="Flight record: a raw one, or one of `aeromatch flight reconstruct`. Relative "
        "to this file."
    )
    names: str = Field(default="", description="Name map of the record. Relative to this file.")
    aircraft: str = Field(
        default="",
        description="Aircraft file; a raw record needs it to be reconstructed. Relative to this "
        "file.",
    )
    window: tuple[float, float] = Field(
        description="Start and end of the replay on the clock of the record [s]."
    )
    features: tuple[str, ...] = Field(
        default=(), description="Conditions of table rows that hold, such as reversible_controls."
    )
    absent: tuple[str, ...] = Field(
        default=(),
        examples=[["spoiler", "epr"]],
        description="Parameters of rows whose equipment the aeroplane does not have.",
    )
    additional: str = Field(
        default="",
        examples=["flaps full and gear down: tables of both at their ends"],
        description="Why the configuration is not that of the row: an additional case, not a test.",
    )
    shortened: str = Field(
        default="",
        description="Why a window is shorter than the rows ask; without it that is an error.",
    )
    show: tuple[str, ...] = Field(
        default=SHOWN, description="Channels to show in addition to the judged ones."
    )
    mode_channel: str = Field(
        default="", examples=["r"], description="Channel on which period and damping are measured."
    )
    engine_parameter: str = Field(
        default="",
        examples=["engine1.n1"],
        description="Critical engine parameter of Ti and Tt, such as engine1.n1.",
    )
    reference: Literal["flight", "engineering", "footprint"] = Field(
        default="flight",
        description="flight; engineering: a simulator; footprint: no reference, no verdict.",
    )
    fraction: float | None = Field(
        default=None,
        gt=0.0,
        le=1.0,
        examples=[0.2],
        description="Share of the tolerance. Default 1; engineering 0.2 before 2016, then 0.4.",
    )
    objective: str = Field(
        default="", examples=["Phugoid without pilot"], description="What the test shows."
    )
    procedure: str = Field(
        default="",
        examples=["The recorded elevator drives the model"],
        description="How it runs automatically.",
    )
    manual: str = Field(
        default="", examples=["Trim, pull, release"], description="How a pilot flies it by hand."
    )
    evaluation: str = Field(
        default="", examples=["Period and damping of the speed"], description="How it is evaluated."
    )
    notes: str = Field(
        default="",
        examples=["light turbulence"],
        description="Remarks for the reader of the report.",
    )

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if not _NAME.fullmatch(name):
            raise ValueError(
                f"{name!r} names files and links: letters, digits, '-', '_' and '.', a "
                f"letter or digit first, at most 100"
            )
        return name

    @field_validator("window")
    @classmethod
    def _check_window(cls, window: tuple[float, float]) -> tuple[float, float]:
        if not window[0] < window[1]:
            raise ValueError(
                f"the window must start before it ends, not {time_text(window[0])} ... "
                f"{time_text(window[1])} s"
            )
        if window[1] - window[0] < _SHORTEST_WINDOW:
            raise ValueError(
                f"the window {time_text(window[0])} ... {time_text(window[1])} s holds "
                f"{window[1] - window[0]:.3g} s; it counts in seconds on the clock of the record, "
                f"and a case has {_SHORTEST_WINDOW:g} s or more"
            )
        return window


class LoopTable(Strict):
    """A loop of the math pilot: correction = gain e + integral * Int e dt with e = recorded -
    model, no larger than limit.
    """

    # nan and inf are answered with the name of the quantity when the file is resolved
    model_config = ConfigDict(allow_inf_nan=True)

    control: str = Field(
        description="Control that the loop moves: delta_a, wheel, F_column, throttle ..."
    )
    channel: str = Field(
        description="Channel that is held to the recorded one; never one that is judged."
    )
    gain: Quantity = Field(
        description="Control per error: SI, or with units such as '0.3 deg/deg' or '2 cm/deg'."
    )
    integral: Quantity = Field(
        default=0.0,
        description="Control per error and second: SI, or with units such as '0.05 deg/deg s'.",
    )
    limit: Quantity = Field(description="Largest correction of the loop, such as '5 deg'.")


class DriveTable(Strict):
    """What drives the model."""

    # nan and inf are answered with the name of the quantity when the file is resolved
    model_config = ConfigDict(allow_inf_nan=True)

    surfaces: Literal["recorded", "cockpit", "force", "pilot"] = Field(
        default="recorded",
        description="recorded: surface positions; cockpit: travel of column, wheel, pedals; "
        "force: pilot forces; "
        "pilot: what is recorded of the level of its loops, plus their corrections.",
    )
    engine: Literal["thrust", "n1", "throttle", "lever", "torque", "rpm", "map", "none"] = Field(
        default="thrust",
        description="thrust: recorded thrust drives; n1: the fan speed, throttle or lever: the "
        "lever drives the engine model; torque: that of the propeller shaft; map: the manifold "
        "pressure; rpm: the speed of the propeller, with a governor at the power of the lever; "
        "none: the aircraft has no engines.",
    )
    propeller: Literal["lever", "rpm"] = Field(
        default="lever",
        description="What the governor holds when torque or map drives. lever: the speed of the "
        "recorded propeller lever, the highest without one; rpm: the recorded speed.",
    )
    trim: StrictBool | Literal["ground"] = Field(
        default=True,
        description="Trim the model to the flight condition at the start; ground: it stands or "
        "rolls on its wheels.",
    )
    wind: Literal["record", "measured", "none"] = Field(
        default="record",
        description="record: wind of the reconstructed path; measured: wind channels of the raw "
        "record; none: calm air.",
    )
    limits: dict[str, Quantity] = _free_table(
        "Largest bias of the trim, such as { delta_e = '1 deg', thrust = '50 lbf' }; beyond "
        "one written here the run is invalid."
    )
    held_by: Literal["force", "friction"] = Field(
        default="force",
        description="At the start of a run driven by forces: force: what the recorded force lacks "
        "to hold the controls is added as a bias; "
        "friction: dry friction holds them as far as it can, only the rest is added.",
    )
    trim_surfaces: tuple[Literal["delta_t", "delta_ta", "delta_tr"], ...] = Field(
        default=(),
        description="Trim surfaces that the trim solves for, so that the recorded forces hold the "
        "controls at the start; "
        'a snapshot judges them. With surfaces = "force".',
        examples=[["delta_t"]],
    )
    runway: Literal["", "dry", "wet", "icy"] = Field(
        default="",
        description="State of the runway, parameter runway.condition of the model; empty: that of "
        "the aircraft file.",
    )
    pilot: tuple[LoopTable, ...] = Field(default=(), description="Loops of the math pilot.")


# Controls of the model that a control law may move.
_MovedControl = Literal[
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_t",
    "delta_ta",
    "delta_tr",
    "delta_f",
    "delta_s",
    "delta_d",
    "speedbrake",
]


class ControlLawTable(Strict):
    """A control law of the airplane, such as a yaw damper or a flight-control computer: an FMU that
    moves controls of the model.
    """

    # nan and inf are answered with the name of the quantity when the file is resolved
    model_config = ConfigDict(allow_inf_nan=True)

    fmu: str = Field(
        description="FMU of the control law, FMI 1.0 to 3.0. Relative to this file.",
        examples=["yaw_damper.fmu"],
    )
    names: str = Field(
        default="",
        examples=["yaw_damper.toml"],
        description="Table of its names, when names, units or signs are not the canonical ones. "
        "Relative to this file.",
    )
    moves: tuple[_MovedControl, ...] = Field(
        min_length=1,
        examples=[["delta_r"]],
        description="Outputs of the FMU that drive the model, in place of the record: whole "
        "deflections, not parts to be added.",
    )


class CaseFile(Strict):
    """A case of `aeromatch pom`: one row of the tolerance table, one window of one flight record,
    and how the model is driven.
    """

    # nan and inf are answered with the name of the quantity when the file is resolved
    model_config = ConfigDict(allow_inf_nan=True)

    case: CaseTable
    drive: DriveTable = DriveTable()
    facts: FactsTable = FactsTable()
    control_law: ControlLawTable | None = Field(
        default=None, description="Control law between the recorded pilot and the model."
    )
    conditions: dict[str, Quantity] = _free_table(
        "Values against the record: inputs held constant, parts of the initial state, mass, air."
    )
    events: dict[str, float] = _free_table(
        "Instants that bound the windows of rows, on the clock of the record [s]."
    )
    models: Texts = _free_table(
        "By model: its table of names, when names, units or signs are not the canonical "
        "ones. Relative to this file.",
        final="final_names.toml",
    )
    tolerance: dict[str, Any] = _free_table(
        "Bands that replace those of the row or add to them, by criterion or channel."
    )
    ranges: dict[str, Quantity] = _free_table(
        "Largest value in service by channel, the base of lone percentages (rule R3).",
        V_cas="250 kt",
    )
    certified: dict[str, Quantity] = _free_table(
        "Certified value by parameter, below which a floor criterion fails.", nz=2.5
    )
    ticks: Texts = _free_table(
        "By advisory criterion: name, date and words of the engineer who ticked it.",
        **{"stick shaker": "J. Smith, 2024-05-17, seen"},
    )
    rationale: Texts = _free_table(
        "By criterion or channel: why it is as it is. trim.<quantity>: name, date and reason "
        "for a bias beyond the usual limit, at most three times.",
        theta="gust at 40 s",
    )
    source: Texts = _free_table(
        "Where the flight data come from: document, revision, date, pages, flight, run, engine and "
        "avionics standard ...",
        document="flight-test report",
        pages="12 to 15",
    )
    compliance: Texts = _free_table(
        "Statements of compliance by subject.",
        control_loading="forces are measured at the column, report 12",
    )
    signatures: dict[Role, Signature] = Field(
        default={}, description="Who signs the pages of the case, by role."
    )


def case_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a case file.

    It has every key with its description, the allowed names of the tolerance table (tests,
    editions, events, conditions of rows) and the SI unit of every condition.  `read_case` checks
    the rules that involve several keys.
    """
    schema = file_schema(CaseFile, " ".join((CaseFile.__doc__ or "").split()))
    parts = schema["$defs"]
    parts["ToleranceOverride"] = {
        **part_schema(ToleranceOverride),
        "description": "Half width, percentage, base, rule, group and window.",
    }
    # Names of the tolerance table are values of the schema, so that an editor completes them.
    case = parts["CaseTable"]["properties"]
    for key, column in {"id": "test_id", "standard": "standard", "edition": "edition"}.items():
        case[key]["enum"] = sorted({row[column] for row in rows.tolerance_rows()})
    case["features"]["items"]["enum"] = sorted(rows.claimable_features())
    case["show"]["items"]["examples"] = sorted(VOCABULARY)
    top = schema["properties"]
    _restrict_keys(top["conditions"], {name: _condition_schema(name) for name in CONDITIONS})
    # Further controls of the tables, such as device.ice.setting.
    top["conditions"]["patternProperties"] = {
        rf"^{re.escape(DEVICE)}\w+\.{kind}$": _condition_schema(kind)
        for kind in ("deflection", "setting")
    }
    for lever in LEVERS:
        pattern = rf"^engine[1-8]\.{lever}$"
        top["conditions"]["patternProperties"][pattern] = _condition_schema(lever)
    event = {"type": "number", "description": "[s] on the clock of the record", "examples": [12.5]}
    _restrict_keys(top["events"], {name: dict(event) for name in sorted(rows.window_events())})
    top["tolerance"]["additionalProperties"] = {
        "anyOf": [{"type": "number"}, {"type": "string"}, {"$ref": "#/$defs/ToleranceOverride"}]
    }
    return schema


def _condition_schema(name: str) -> dict[str, Any]:
    row = lookup(name)
    example: float | str = f"1 {row.display_units}"
    # a ratio is written without a unit
    if row.units == "1":
        example = 1.0
    return {
        **quantity_schema(row.units),
        "description": f"{row.long_name} [{row.units}], or a text with its unit",
        "examples": [example],
    }


def _restrict_keys(table: dict[str, Any], properties: dict[str, Any]) -> None:
    table["properties"] = properties
    table["additionalProperties"] = False
