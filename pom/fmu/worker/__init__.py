"""What runs in the child process of an FMU: ``python -m pom.fmu.worker MODEL.fmu FOLDER PARENT``
answers jobs until its input ends.

Of the rest of the package it imports the math pilot only, so that the child starts fast and a foreign library cannot reach the parent."""

from __future__ import annotations

from pom.fmu.worker.model import UnpackedFmu
from pom.fmu.worker.run import replay_job

__all__ = ["UnpackedFmu", "replay_job"]
