"""The project file of a match: its sections, its reader, and how single keys of it are set."""

from aeromatch.project.project import Project as Project
from aeromatch.project.project import read_project as read_project
