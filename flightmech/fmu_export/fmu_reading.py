"""Reader of the description of any FMU, with the findings of the validation of the standard."""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Iterable
from typing import Any

import fmpy
from fmpy.model_description import ValidationError
from fmpy.validation import validate_fmu

from flightmech.errors import ParseError
from flightmech.support.file_kinds import file_kind

# Part of a structured name without quotes (FMI 2.0.2, section 2.2.9).
_PART = r"[A-Za-z_]\w*(?:\[\d+(?:,\d+)*\])?"
_PLAIN_NAME = re.compile(rf"{_PART}(?:\.{_PART})*|der\({_PART}(?:\.{_PART})*(?:,\d+)?\)", re.ASCII)


def read_fmu(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the contents of the model description of an FMU of any vendor.

    Returns
    -------
    dict
        ``model``, ``fmi``, ``token``, ``platforms`` (with a library in the FMU), ``platform`` of
        this machine, ``runs_here``, ``variables`` (list of dict: ``name causality variability type
        unit display_unit start description``) and ``findings``, the problems from FMPy's
        validation.

    Raises
    ------
    ParseError
        The file is not an FMU.
    """
    try:
        model = fmpy.read_model_description(str(path), validate=False)
        platforms = sorted(fmpy.supported_platforms(str(path)))
    except Exception as error:  # FMPy raises plain exceptions
        kind = file_kind(path)
        if kind.startswith("a zip"):
            kind = f"a damaged FMU ({error})"
        allowed = "an FMU: a zip archive with a modelDescription.xml of FMI 1.0, 2.0 or 3.0"
        raise ParseError(str(path), 0, kind, allowed) from error
    names = [variable.name for variable in model.modelVariables]
    return {
        "model": model.modelName,
        "fmi": model.fmiVersion,
        "token": model.guid,
        "platforms": platforms,
        "platform": fmpy.platform,
        "runs_here": fmpy.platform in platforms,
        "variables": [_variable_row(variable) for variable in model.modelVariables],
        "findings": _validate(str(path), names),
    }


def _validate(path: str, names: Iterable[str]) -> list[str]:
    """Return the problems of FMPy's validation, without its slow check of plain names."""
    # FMPy parses every name by a grammar. A plain name follows this grammar.
    if _has_backslashes(path) or not all(map(_PLAIN_NAME.fullmatch, names)):
        return validate_fmu(path)
    try:
        fmpy.read_model_description(
            path, validate=True, validate_variable_names=False, validate_model_structure=True
        )
    except ValidationError as error:
        return error.problems
    except Exception as error:  # as `validate_fmu` does
        return [str(error)]
    return []


def _has_backslashes(path: str) -> bool:
    """Return whether names of files in an archive have the separator of Windows."""
    if not os.path.isfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        return any("\\" in file.orig_filename for file in archive.filelist)


def _variable_row(variable: Any) -> dict[str, Any]:
    return {
        "name": variable.name,
        "causality": variable.causality,
        "variability": variable.variability,
        "type": variable.type,
        "unit": variable.unit,
        "display_unit": variable.displayUnit,
        "start": variable.start,
        "description": variable.description,
    }
