"""Coverage of the standard errors of identified actuators over simulated campaigns, and the work of
one identification.

    python benchmarks/actuators.py [CAMPAIGNS]

Two logs each of a servo within its limits, of one at its limits, and of a motor and a servo on a
torque cell; share of estimates whose truth lies within two standard errors, and the mean of the
error over the standard error.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "flapping_vehicle"))
import actuator_bench as bench

from flighttest.submodels.actuators.identification import identify_actuator

CELL = bench.Campaign(speed=0.05, torque=1e-4)
KINDS = {
    "servo, position": (bench.SERVO, bench.Campaign()),
    "servo, position, at its limits": (bench.LIMITED, bench.Campaign()),
    "servo on a torque cell": (bench.SERVO, CELL),
    "motor on a torque cell": (
        bench.MOTOR,
        bench.Campaign(amplitude=0.3, position=None, speed=1.0, torque=1e-4),
    ),
    "motor, rate": (bench.MOTOR, bench.Campaign(amplitude=0.3, position=None, speed=1.0)),
}


def truth(actuator: bench.Actuator, names) -> dict[str, float]:
    """Return the true value of each parameter."""
    known = {
        name: getattr(actuator, name)
        for name in ("Ma", "Ca", "Ka", "B", "neutral", "delay", "rate_limit")
    }
    known |= {f"{name}/Ma": getattr(actuator, name) / actuator.Ma for name in ("Ca", "Ka", "B")}
    return {
        name: (known | dict(zip(("stop_low", "stop_high"), actuator.stops)))[name] for name in names
    }


def main(campaigns: int) -> None:
    """Print the share within two standard errors per parameter."""
    for kind, (actuator, campaign) in KINDS.items():
        apart: dict[str, list[float]] = {}
        begun, limits = time.process_time(), 0
        for k in range(campaigns):
            logs = [bench.log(actuator, campaign, 1000 + 2 * k + i) for i in (0, 1)]
            found = identify_actuator(logs, held=True, delay=actuator.delay > 0.0)
            limits += len(found.reached)
            true = truth(actuator, found.parameters)
            for name, value in found.parameters.items():
                apart.setdefault(name, []).append((value - true[name]) / found.stderr[name])
            for name, value in found.spectral.values.items():
                if name in found.spectral.stderr:
                    apart.setdefault(f"{name} (frequency)", []).append(
                        (value - true[name]) / found.spectral.stderr[name]
                    )
        print(
            f"{kind}: {campaigns} campaigns, limits found {limits}, "
            f"{(time.process_time() - begun) / campaigns:.1f} s CPU each"
        )
        for name, z in apart.items():
            print(
                f"  {name:22s} {np.mean(np.abs(z) < 2.0):6.1%} within two, mean "
                f"{np.mean(z):+5.2f}, scatter {np.std(z):4.2f}, of {len(z)}"
            )
        main_only = np.concatenate([z for name, z in apart.items() if "frequency" not in name])
        print(f"  all of the output error: {np.mean(np.abs(main_only) < 2.0):.1%}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
