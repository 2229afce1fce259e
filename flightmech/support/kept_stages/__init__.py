"""Results of the stages of a job, kept by the hash of all that they depend on, so that nothing is
computed twice.
"""
