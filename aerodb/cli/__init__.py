"""The command group ``aeromatch db``."""
