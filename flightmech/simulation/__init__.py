"""The compiled simulation: kernel, model block, runs."""
