"""Functions that perform the commands; each module is loaded when one of its commands is called."""
