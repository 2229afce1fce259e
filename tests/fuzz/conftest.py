"""The targets of the fuzzer are programs of their own, not tests; they need atheris."""

collect_ignore = ["fuzz_deck.py", "fuzz_listing.py"]
