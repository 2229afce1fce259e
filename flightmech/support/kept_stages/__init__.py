"""Store for results of the stages of a job, by the hash of all their inputs."""
