"""The command group ``aeromatch pom``."""
