"""The fuzzers are programs of their own, not tests; those of the readers need atheris."""

collect_ignore_glob = ["fuzz_*.py"]
