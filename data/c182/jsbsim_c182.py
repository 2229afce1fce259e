"""The aircraft ``c182`` of the pip package ``jsbsim`` 1.3.3, its propeller file corrected.

A rotor of angular momentum h acts on the airframe with the moment -omega x h (Euler's equation of
a body with a rotor).  JSBSim applies it with that sign for a propeller file with ``version="1.1"``,
and with the other one for a file without a version, as the package has for this propeller
(documentation of its class FGPropeller, 1.1.0 to 1.3.3).  So the correction is that attribute, in a
temporary copy; nothing of the package is kept.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import jsbsim

PACKAGE = Path(jsbsim.__file__).parent
PROPELLER = Path("engine", "prop_81in2v.xml")
FILES = (Path("aircraft", "c182", "c182.xml"), Path("engine", "engIO540AB1A5.xml"), PROPELLER)


def copy_model(folder: Path) -> None:
    """Copy the files of the aircraft into a folder, and correct that of the propeller."""
    for file in FILES:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(PACKAGE / file, folder / file)

    text = (folder / PROPELLER).read_text(encoding="utf-8")
    if text.count("<propeller name=") != 1:
        raise ValueError(f"{PROPELLER} has no <propeller name=...>; jsbsim 1.3.3 is needed")
    text = text.replace("<propeller name=", '<propeller version="1.1" name=')
    (folder / PROPELLER).write_text(text, encoding="utf-8")


def load_aircraft() -> jsbsim.FGFDMExec:
    """Return a simulation with the corrected aircraft loaded."""
    with tempfile.TemporaryDirectory() as folder:
        copy_model(Path(folder))
        fdm = jsbsim.FGFDMExec(folder)
        fdm.set_debug_level(0)
        fdm.load_model("c182")
    return fdm
