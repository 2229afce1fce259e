"""Shared by all packages: configuration files, console, atomic writing, lazy loading."""
