"""Output error on the control circuit: free motion simulated, driven stretches, and their joint
likelihood.
"""
