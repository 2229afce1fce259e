"""One RK4 step of aircraft with propellers against that of a jet, in the same run.

    python benchmarks/propeller_step.py

Four aircraft of the size of a Citation's (`kernel_step`), each with two engines: jets with decks of
two spools, governed propellers on piston engines with a model of air and fuel, turboprops with gas
generators, and electric motors.  Prints processor times and their ratios to the jet.  Jets with a
table of static thrust are the last row.
"""

from __future__ import annotations

import numpy as np
from kernel_step import citation_like, flight

import flightmech
from flightmech.aircraft import ElectricMotor, Engine, EngineDeck, PistonEngine, Propeller
from flightmech.terms import make_term

REPEATS = 9
PLACES = ((0.0, -2.0, 0.0), (0.0, 2.0, 0.0))
RATIOS, ANGLES = np.linspace(0.0, 3.0, 16), np.radians([5.0, 15.0, 25.0, 35.0, 45.0, 60.0])
GRID = {"J": RATIOS, "blade_angle": ANGLES}
CT = make_term(0.05 + 0.15 * ANGLES[None, :] - 0.12 * RATIOS[:, None], GRID)
CP = make_term(0.02 + 0.3 * ANGLES[None, :] - 0.06 * RATIOS[:, None], GRID)
N1 = np.linspace(0.3, 1.05, 10)


def blades(power: float, **changes) -> Propeller:
    """A governed propeller; `power` only scales its diameter."""
    fields = {
        "tables": {"CT_prop": CT, "CP_prop": CP},
        "diameter": 2.0 * (power / 150e3) ** 0.25,
        "inertia": 5.0,
        "rpm_high": 220.0,
        "rpm_low": 170.0,
        "low_pitch": ANGLES[0],
        "high_pitch": ANGLES[-1],
    }
    return Propeller(**(fields | changes))


def jet_deck(thrust: bool) -> EngineDeck:
    """Two spools with corrected tables; without thrust a gas generator alone."""
    tables = {
        "n2_command": make_term([0.6, 1.0], {"throttle": [0.0, 1.0]}),
        "n2_up_time": make_term(0.5),
        "n1_command": make_term([0.3, 1.0], {"n2": [0.6, 1.0]}),
        "n1_up_time": make_term(0.5),
        "corrected_thrust": make_term(
            np.outer(N1, [4000.0, 3500.0]), {"corrected_n1": N1, "mach": [0.0, 0.6]}
        ),
        "corrected_air_flow": make_term(20.0 * N1, {"corrected_n1": N1}),
        "corrected_fuel_flow": make_term(0.1 * N1, {"corrected_n1": N1}),
        "corrected_itt": make_term(900.0 * N1, {"corrected_n1": N1}),
    }
    if thrust:
        return EngineDeck(tables)
    names = ("n2_command", "n2_up_time", "corrected_air_flow", "corrected_thrust")
    kept = {name: leaf for name, leaf in tables.items() if name not in names}
    kept["n1_command"] = make_term([0.6, 1.0], {"throttle": [0.0, 1.0]})
    return EngineDeck(kept | {"thrust": make_term(100.0)})


def piston() -> PistonEngine:
    """Air, fuel and friction."""
    ratios = np.linspace(0.05, 0.125, 8)
    return PistonEngine(
        {
            "fuel_work": make_term(1.2e7 * np.ones(8), {"fuel_air_ratio": ratios}),
            "friction_pressure": make_term([5e4, 1.5e5], {"engine_rpm": [0.0, 300.0]}),
        },
        displacement=8e-3,
        intake_impedance=2e-4,
        throttle_impedance=0.02,
        pumping=0.85,
        enrichment=1.0,
    )


def make_models() -> dict[str, flightmech.SimModel]:
    """The aircraft by name, the jet with decks first."""
    turbine = {
        "CT_prop": CT,
        "CP_prop": CP,
        "shaft_power": make_term(
            np.outer(N1, [300e3, 450e3]), {"n1": N1, "engine_rpm": [150.0, 220.0]}
        ),
        "shaft_bsfc": make_term(1e-7 / N1, {"n1": N1}),
    }
    motor = ElectricMotor(
        {"open_voltage": make_term([350.0, 400.0], {"charge": [0.0, 1.0]})},
        speed_constant=0.7,
        motor_resistance=0.02,
        capacity=3.6e5,
    )
    kinds = {
        "jet with decks": {"deck": jet_deck(True)},
        "piston engines": {"propeller": blades(150e3), "piston": piston()},
        "turboprops": {"propeller": blades(450e3, tables=turbine), "deck": jet_deck(False)},
        "electric motors": {"propeller": blades(150e3), "motor": motor},
    }
    models = {}
    for name, parts in kinds.items():
        engines = tuple(Engine(place, **parts) for place in PLACES)
        models[name] = citation_like(engines=engines)
    return models | {"jet with thrust tables": citation_like()}


def main() -> None:
    """Print the processor time of a step of each aircraft, and its ratio to the jet."""
    models = make_models()
    # one after the other in each round, so that all see the same load of the machine
    rounds = np.array([[flight(sim, 20.0) for sim in models.values()] for _ in range(REPEATS)])
    ratios = np.median(rounds / rounds[:, :1], axis=0)
    for name, seconds, ratio in zip(models, rounds.min(axis=0), ratios, strict=True):
        print(f"{name:24s} {1e6 * seconds:6.2f} us   {ratio:5.2f}")


if __name__ == "__main__":
    main()
