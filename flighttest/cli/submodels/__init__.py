"""Verbs of `aeromatch flight` that identify a submodel: actuator, controls, engine, gear, ground effect."""
