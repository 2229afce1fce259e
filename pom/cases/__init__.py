"""Cases: the file, its parts, and the job that a model is given."""
