"""Child process: functions of the standard at random on instances of both kinds;
``fmu_calls_child.py FOLDER SEED``.
"""

from __future__ import annotations

import ctypes
import random
import sys

import fmpy
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions
from fmpy.fmi3 import FMU3Model, FMU3Slave

CALLS = 3000
NUMBERS = [0.0, 1.0, -1.0, 0.02, 1e300, -1e-300, float("nan"), float("inf")]
BOTH = (
    "EnterInitializationMode ExitInitializationMode Terminate Reset DoStep EnterEventMode "
    "EnterContinuousTimeMode SetTime "
    "SetContinuousStates GetContinuousStates CompletedIntegratorStep"
)
OWN = {
    "2.0": "SetupExperiment GetReal SetReal GetDerivatives NewDiscreteStates",
    "3.0": "GetFloat64 SetFloat64 SetUInt64 GetContinuousStateDerivatives UpdateDiscreteStates "
    "EnterConfigurationMode ExitConfigurationMode",
}
KINDS = {"2.0": (FMU2Slave, FMU2Model), "3.0": (FMU3Slave, FMU3Model)}


class Caller:
    """Makes random calls of one instance; buffers are large enough for whatever the arguments
    require.
    """

    def __init__(self, fmu, model, rng: random.Random):
        self.fmu, self.rng, self.second = fmu, rng, model.fmiVersion == "2.0"
        self.references = [v.valueReference for v in model.modelVariables] + [
            1,
            49_999,
            70_000,
            70_003,
            4_294_967_295,
        ]
        self.doubles = (ctypes.c_double * 20_000)()
        self.flags = [ctypes.byref(ctypes.c_int()) for _ in range(5)]

    def number(self) -> ctypes.c_double:
        return ctypes.c_double(self.rng.choice(NUMBERS))

    def values(self) -> tuple:
        """Return references, their number, values and, in FMI 3.0, how many."""
        n = self.rng.choice([0, 1, 1, 2, 5])
        self.doubles[:20] = self.rng.choices(NUMBERS, k=20)
        counts = () if self.second else (ctypes.c_size_t(self.rng.choice([n, n, n, 0, 20_000])),)
        return (
            (ctypes.c_uint * 5)(*self.rng.choices(self.references, k=5)),
            ctypes.c_size_t(n),
            self.doubles,
            *counts,
        )

    def arguments(self, name: str) -> tuple:
        """Return arguments of the right types for a function."""
        if name in ("GetReal", "SetReal", "GetFloat64", "SetFloat64"):
            return self.values()
        if name in (
            "SetContinuousStates",
            "GetContinuousStates",
            "GetDerivatives",
            "GetContinuousStateDerivatives",
        ):
            return self.doubles, ctypes.c_size_t(self.rng.choice([0, 13, 14, 15]))
        if name == "SetUInt64":
            count = (ctypes.c_uint64 * 1)(self.rng.choice([0, 1, 7, 2**64 - 1]))
            return (
                (ctypes.c_uint * 1)(self.rng.choice([70_000, 5])),
                ctypes.c_size_t(1),
                count,
                ctypes.c_size_t(1),
            )
        end = ctypes.byref(self.doubles)
        return {
            "DoStep": (
                self.number(),
                self.number(),
                *((1,) if self.second else (True, *self.flags[:3], end)),
            ),
            "SetTime": (self.number(),),
            "SetupExperiment": (0, self.number(), self.number(), 0, self.number()),
            "EnterInitializationMode": ()
            if self.second
            else (False, self.number(), self.number(), False, self.number()),
            "CompletedIntegratorStep": (1, *self.flags[:2]),
            "NewDiscreteStates": ((ctypes.c_double * 8)(),),
            "UpdateDiscreteStates": (*self.flags, end),
        }.get(name, ())

    def call(self, name: str) -> int:
        """Call a function without FMPy's own checks."""
        function = getattr(self.fmu.dll, ("fmi2" if self.second else "fmi3") + name)
        function.argtypes = None
        return function(ctypes.c_void_p(self.fmu.component), *self.arguments(name))


def main(folder: str, seed: str) -> None:
    """Drive a co-simulation and a model-exchange instance."""
    model, rng = fmpy.read_model_description(folder), random.Random(int(seed))
    names = f"{BOTH} {OWN[model.fmiVersion]}".split()
    seen: set[int] = set()
    for kind in KINDS[model.fmiVersion]:
        fmu = kind(
            guid=model.guid,
            unzipDirectory=folder,
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName="x",
        )
        silent = (
            {"callbacks": fmi2CallbackFunctions()}
            if model.fmiVersion == "2.0"
            else {"logMessage": lambda *message: None}
        )
        fmu.instantiate(**silent)
        caller = Caller(fmu, model, rng)
        seen |= {caller.call(rng.choice(names)) for _ in range(CALLS)}
        fmu.freeInstance()
    print(*sorted(seen))


if __name__ == "__main__":
    main(*sys.argv[1:])
