"""The command group ``aeromatch fmu``."""
