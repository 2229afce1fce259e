"""The targets of the fuzzer are programs of their own, not tests; those of the readers need
atheris.
"""

collect_ignore = ["fuzz_deck.py", "fuzz_fmu.py", "fuzz_listing.py"]
