"""Coverage-guided fuzzing of the listing reader; see README.md."""

import random
import sys
from itertools import pairwise
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["datcom_io"]):
    # a name of the package is loaded late, past the instrumentation: the modules are imported here
    from datcom_io.arrays import frames  # noqa: F401
    from datcom_io.arrays import trees as dataset  # noqa: F401
    from datcom_io.reading import reader  # noqa: F401

import harm
import promises

LISTINGS = sorted((Path(__file__).parents[2] / "data" / "t37" / "datcom").glob("*.out"))
SEEDS = sorted((Path(__file__).parent / "seeds").glob("*.out"))


def lines_of(data: bytes) -> list[str]:
    return data.decode("latin-1").split("\n")


def as_bytes(lines: list[str]) -> bytes:
    return "\n".join(lines).encode("latin-1", "replace")


def pages_of(lines: list[str]) -> list[list[str]]:
    """Return short listings: the cards and one page, the end of the run."""
    starts = [k for k, line in enumerate(lines) if line.startswith("1")]
    head = next(k for k in starts if "LIST OF ALL INPUT" in lines[k])
    cards = lines[head : next(k for k in starts if k > head)]
    return [
        cards + lines[a:b] + lines[starts[-1] :]
        for a, b in pairwise(starts)
        if "AUTOMATED" in lines[a]
    ]


def write_corpus(folder: Path) -> None:
    """Fill a new folder with one short listing per kind of page of the shipped listings."""
    folder.mkdir()
    kinds: dict[tuple[str, ...], list[str]] = {}
    for path in LISTINGS:
        for lines in pages_of(lines_of(path.read_bytes())):
            kinds.setdefault(
                tuple(
                    line.split("  ")[0]
                    for line in lines
                    if line.startswith("0 ") and "=" not in line
                ),
                lines,
            )
    for number, lines in enumerate(
        [*kinds.values(), *(lines_of(path.read_bytes()) for path in SEEDS)]
    ):
        (folder / f"{number:03d}").write_bytes(as_bytes(lines))


OTHERS = [lines for path in LISTINGS for lines in pages_of(lines_of(path.read_bytes()))[::7]]


def mutate(data: bytes, largest: int, seed: int) -> bytes:
    """Harm the lines, or let libFuzzer change bytes."""
    choice = random.Random(seed)
    if choice.random() < 0.4:
        return atheris.Mutate(data, largest)
    return as_bytes(harm.harm(lines_of(data), OTHERS, choice.randrange, 1 + choice.randrange(3)))[
        :largest
    ]


def one_input(data: bytes) -> None:
    promises.read_in_every_way(lines_of(data))


if __name__ == "__main__":
    corpus = Path(sys.argv[1])
    if not corpus.exists():
        write_corpus(corpus)
    atheris.Setup(
        ["fuzz_listing", "-max_len=40000", "-timeout=20", *sys.argv[1:]],
        one_input,
        custom_mutator=mutate,
    )
    atheris.Fuzz()
