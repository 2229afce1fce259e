"""The command group ``aeromatch datcom``."""
