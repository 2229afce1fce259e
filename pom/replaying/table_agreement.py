"""Whether the answer of an FMU is that of the tables it holds.

An FMU of this program holds its tables next to its program.  Evidence, lift and shared windows are
judged from these tables.  Another program in the same file would be judged by tables that it does
not use, so the tables are flown by the kernel and both answers are compared.  An FMU whose files
are those of this installation, byte by byte, needs no such flight.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from flightmech.errors import AeromatchError
from flightmech.fmu_export.fmu_file import is_unaltered
from flightmech.names import value_text
from flightmech.simulation.compiler import SimModel
from flightmech.support.arrays import rms
from flightmech.support.input_files import file_sha256
from pom.cases.job import ReplayJob
from pom.fmu.models import FmuModel
from pom.probing.input_probe import SIZES
from pom.replaying.kernel_replay import fly_once
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark, unwrapped_difference
from pom.tolerances.channels import quantity_words

OWN_TABLES = 0.02
"""Largest rms difference of the answers of FMU and tables, in units of `SIZES`.

The FMUs of the T-37 and the C182 agree to rounding, 1e-13.
"""

Traces = Mapping[str, np.ndarray]

_PROBE = "the answer against that of the tables in the FMU"
_DIFFERS = "the answer differs from that of the tables in the FMU by "
_UNALTERED = "program and description of the FMU are those of this installation, byte by byte"


def compare_model_tables(
    model: FmuModel, tables: SimModel, job: ReplayJob, outputs: Traces
) -> tuple[RowRemark, ...]:
    """Return the remark of `compare_tables`, without a flight where the files prove the answer.

    A table of names can exchange or scale what an unaltered FMU answers, so it is compared.
    """
    if not model.links.table and _is_unaltered_once(model.fmu.path, model.fmu.sha256):
        return (RowRemark("probe", _UNALTERED),)
    return compare_tables(tables, job, outputs)


def shows_own_tables(remarks: Iterable[RowRemark]) -> bool:
    """Return whether a remark shows that the answer of a model is that of its tables."""
    for remark in remarks:
        is_shown = remark.text == _UNALTERED or remark.text.startswith(_DIFFERS)
        if remark.kind == "probe" and is_shown:
            return True
    return False


@cache
def _is_unaltered_once(path: Path, sha256: str) -> bool:
    """Return `is_unaltered` of a file with this content."""
    try:
        return is_unaltered(path) and file_sha256(path) == sha256
    except (AeromatchError, OSError, zipfile.BadZipFile):
        return False


def compare_tables(model: SimModel, job: ReplayJob, outputs: Traces) -> tuple[RowRemark, ...]:
    """Return the remark on an FMU and its tables, of kind ``not_driven`` or ``probe``.

    Parameters
    ----------
    model : SimModel
        Inside the FMU.
    job : ReplayJob
    outputs : mapping of str to array (time,)
        Of the FMU in this job. [SI]
    """
    if job.law is not None:
        return (unprobed_remark(_PROBE, "a control law drives the model"),)
    own, failure = fly_once(model, job, [name for name in SIZES if name in outputs])
    if failure:
        text = f"answer not compared with the tables of the FMU: their flight failed: {failure}"
        return (RowRemark("departure", f"departure: {text}"),)
    sizes = {}
    for name, values in own.items():
        difference = unwrapped_difference(name, values, outputs[name])
        if np.isfinite(difference).all():
            sizes[name] = rms(difference) / SIZES[name]
    if not sizes:
        return (unprobed_remark(_PROBE, "no motion without gaps among the outputs of the model"),)
    worst = max(sizes, key=lambda name: sizes[name])
    size = value_text(worst, sizes[worst] * SIZES[worst], ".2g")
    text = f"{_DIFFERS}{size} rms ({quantity_words(worst)})"
    if sizes[worst] < OWN_TABLES:
        return (RowRemark("probe", text, values=sizes, unit="1"),)
    reason = (
        f"not driven by its tables: {text}; the program in the FMU is not the one that was written "
        f"with them, and evidence, lift and shared windows are those of the tables"
    )
    return (RowRemark("not_driven", reason, values=sizes, unit="1"),)
