"""The project of the demo with five cases and without control loading, ground effect and gear."""

import re
import shutil
from pathlib import Path

ROOT = Path(__file__).parents[1]
CASES = ("short_period", "power_chop_lever", "phugoid", "dutch_roll", "flap_change")
SUBMODELS = "# Control loading:"  # the first line of the submodels, which end the project file


def make_short_project(folder: Path) -> Path:
    """Write the short project into a new folder, and return its file.

    It takes less than half the processor time of the demo. ``.ci/nightly`` performs the demo.
    """
    shutil.copytree(ROOT / "data" / "t37", folder)
    for file in (folder / "cases").glob("*.toml"):
        if file.stem.partition("_")[2] not in CASES:
            file.unlink()
    project = folder / "aeromatch.toml"
    text, mark, _ = project.read_text(encoding="utf-8").partition(SUBMODELS)
    assert mark
    project.write_text(text, encoding="utf-8")
    left = re.findall(r"^\[+(controls|ground_effect|gear)", text, re.M)
    assert left == []
    return project
