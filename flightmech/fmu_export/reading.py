"""What an FMU of any vendor states about itself."""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Iterable
from typing import Any

from ..errors import ParseError
from ..support.file_kinds import file_kind

_PART = r"[A-Za-z_]\w*(?:\[\d+(?:,\d+)*\])?"  # of a structured name (FMI 2.0.2, section 2.2.9), without quotes
_PLAIN_NAME = re.compile(rf"{_PART}(?:\.{_PART})*|der\({_PART}(?:\.{_PART})*(?:,\d+)?\)", re.ASCII)


def read_fmu(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what an FMU of any vendor states about itself.

    Returns
    -------
    dict
        ``model``, ``fmi``, ``token``, ``platforms`` (those that it has a library for), ``platform`` of this machine, ``runs_here``,
        ``variables`` (list of dict: ``name causality variability type unit display_unit start description``) and ``findings``,
        the problems that FMPy's validation sees.

    Raises
    ------
    ParseError
        The file is no FMU.
    """
    import fmpy

    try:
        model = fmpy.read_model_description(str(path), validate=False)
        platforms = sorted(fmpy.supported_platforms(str(path)))
    except Exception as error:  # FMPy raises plain exceptions
        kind = file_kind(path)
        found = f"a damaged FMU ({error})" if kind.startswith("a zip") else kind
        raise ParseError(str(path), 0, found, "an FMU: a zip archive with a modelDescription.xml of FMI 1.0, 2.0 or 3.0") from error
    return {
        "model": model.modelName,
        "fmi": model.fmiVersion,
        "token": model.guid,
        "platforms": platforms,
        "platform": fmpy.platform,
        "runs_here": fmpy.platform in platforms,
        "variables": [_row(v) for v in model.modelVariables],
        "findings": _findings(str(path), [v.name for v in model.modelVariables]),
    }


def _findings(path: str, names: Iterable[str]) -> list[str]:
    """Return what FMPy's validation finds; it parses every name by a grammar, for 2 ms each, which plain names are known to follow."""
    from fmpy import read_model_description
    from fmpy.model_description import ValidationError
    from fmpy.validation import validate_fmu

    if _has_backslashes(path) or not all(map(_PLAIN_NAME.fullmatch, names)):
        return validate_fmu(path)
    try:
        read_model_description(path, validate=True, validate_variable_names=False, validate_model_structure=True)
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


def _row(v: Any) -> dict[str, Any]:
    return {
        "name": v.name,
        "causality": v.causality,
        "variability": v.variability,
        "type": v.type,
        "unit": v.unit,
        "display_unit": v.displayUnit,
        "start": v.start,
        "description": v.description,
    }
