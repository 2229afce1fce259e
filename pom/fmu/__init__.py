"""FMUs: what they offer, their variables, and their simulation in a child process."""
