"""Replay of a whole record in one step of an FMU of FMI 3.0, by FMPy: an elevator pulse of half a
second from a trim at 90 m/s. The file `model.fmu` is one of `aeromatch fmu write --fmi 3.0`.
"""

import ctypes

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave

folder = fmpy.extract("model.fmu")
model = fmpy.read_model_description(folder)
reference = {v.name: v.valueReference for v in model.modelVariables}
inputs = [v for v in model.modelVariables if v.causality == "input"]
outputs = [v for v in model.modelVariables if v.causality == "output" and v.name != "replay.y"]

time = np.linspace(0.0, 10.0, 501)
u = np.tile([float(v.start) for v in inputs], (len(time), 1))
u[50:75, [v.name for v in inputs].index("delta_e")] = -0.02

fmu = FMU3Slave(
    guid=model.guid,
    unzipDirectory=folder,
    modelIdentifier=model.coSimulation.modelIdentifier,
    instanceName="replay",
)
fmu.instantiate()
fmu.enterConfigurationMode()
fmu.setUInt64([reference["replay.n"]], [len(time)])
fmu.exitConfigurationMode()
fmu.setFloat64([reference["replay.t"]], time)
fmu.setFloat64([reference["replay.u"]], u.ravel())
fmu.enterInitializationMode()
fmu.setFloat64([reference["init.V"], reference["init.h"]], [90.0, 3000.0])
fmu.setInt64([reference["mode.trim"]], [1])
fmu.exitInitializationMode()
fmu.doStep(time[0], time[-1] - time[0])

y = np.empty((len(time), len(outputs)))
where = (ctypes.c_uint * 1)(reference["replay.y"])
fmu.fmi3GetFloat64(
    fmu.component, where, 1, y.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), y.size
)
pitch = y[:, [v.name for v in outputs].index("theta")]
fmu.terminate()
fmu.freeInstance()
