"""Replay of cases: reference states, trim, pilot, drift; many cases as a batch."""
