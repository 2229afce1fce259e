"""Flight test: records, state reconstruction, and identification of aerodynamic terms."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

_NAMES = {
    "read": "record",
    "manoeuvres": "record",
    "overview": "record",
    "faults": "record",
    "read_names": "names_map",
    "NameMap": "names_map",
    "cut": "conditioning",
    "channel": "conditioning",
    "lowpass": "conditioning",
    "resample": "conditioning",
    "reconstruct": "reconstruction",
    "Path": "reconstruction",
    "reconstruct_programme": "programme",
    "combine_biases": "programme",
    "save_path": "files",
    "open_biases": "files",
    "fit_thrust": "thrust",
    "force_at_cg": "calibrate",
    "velocity_at": "calibrate",
    "vane_angles": "calibrate",
    "vane_at_cg": "calibrate",
    "derivative": "differentiate",
    "coefficients": "coefficients",
    "between": "coefficients",
    "open_states": "coefficients",
    "Model": "model",
    "regress": "regress",
    "Fit": "fit",
    "save_fit": "fit",
    "open_fit": "fit",
    "mixed": "mixed",
    "pool": "pool",
    "pool_fits": "pool",
    "decide": "deletion",
}
__all__ = list(_NAMES)


class _Package(ModuleType):
    """Keeps the function ``flighttest.regress`` visible after someone imported the module of the same name."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _NAMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str):
    if name not in _NAMES:
        raise AttributeError(f"module 'flighttest' has no attribute {name!r}")
    return getattr(importlib.import_module(f"flighttest.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
