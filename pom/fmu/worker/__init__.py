"""Program of the child process of an FMU.

``python -m pom.fmu.worker MODEL.fmu FOLDER PARENT ...`` answers jobs until its input ends. From the
other rooms it imports only the math pilot, so that the child starts fast. A foreign library cannot
access the memory of the parent process.
"""

from __future__ import annotations

from pom.fmu.worker.model import UnpackedFmu
from pom.fmu.worker.run import replay_job

__all__ = ["UnpackedFmu", "replay_job"]
