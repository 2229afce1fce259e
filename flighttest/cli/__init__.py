"""The command group ``aeromatch flight``."""
