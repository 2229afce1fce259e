"""The F-16 of the NASA/NESC check cases on our kernel: aircraft, control law, scenarios, published
records.
"""
