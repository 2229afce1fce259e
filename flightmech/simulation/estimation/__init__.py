"""Numerics of identification in the kernel, ``kernel/src/estimation``."""
