"""Coverage-guided fuzzing of the deck reader; see README.md."""

import random
import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["datcom_io"]):
    from datcom_io.decks import check  # noqa: F401  a name of the package is loaded late
    from datcom_io.runs import splitting  # noqa: F401  a name of the package is loaded late

import harm
import promises

DECKS = [
    path.read_text("latin-1").split("\n")
    for path in sorted((Path(__file__).parents[2] / "data" / "t37" / "datcom").glob("*.inp"))
]


def mutate(data: bytes, largest: int, seed: int) -> bytes:
    """Harm the lines, or let libFuzzer change bytes."""
    choice = random.Random(seed)
    if choice.random() < 0.5:
        return atheris.Mutate(data, largest)
    lines = harm.harm(
        data.decode("latin-1").split("\n"), DECKS, choice.randrange, 1 + choice.randrange(3)
    )
    return "\n".join(lines).encode("latin-1", "replace")[:largest]


def one_input(data: bytes) -> None:
    promises.read_and_write_deck(data.decode("latin-1").split("\n"))


if __name__ == "__main__":
    corpus = Path(sys.argv[1])
    if not corpus.exists():
        corpus.mkdir()
        for number, lines in enumerate(DECKS):
            (corpus / f"{number:03d}").write_bytes("\n".join(lines).encode("latin-1"))
    atheris.Setup(
        ["fuzz_deck", "-max_len=8000", "-timeout=20", *sys.argv[1:]],
        one_input,
        custom_mutator=mutate,
    )
    atheris.Fuzz()
