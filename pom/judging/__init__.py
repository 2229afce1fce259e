"""Flight and model compared: signals, events, applicability of rows, verdicts."""
