"""Write what the commands of the tutorial print into the page, and the manoeuvres of its project
into ``data/c182``: ``python docs/scripts/make_tutorial.py``.

The page is its own source: blocks of language ``console`` hold commands, blocks with a title the
files that the reader writes (`tests/test_docs.py` runs the same page and compares).  Output without
a line ``...`` is replaced; of output with such lines each line shown is replaced by the printed one
that differs from it in numbers only.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tutorials" / "light-aircraft.md"
EXAMPLE = ROOT / "data" / "c182"
PROJECT = ("manoeuvres.csv",)  # the other files, cases too, are written by hand
FENCE = re.compile(
    r"^```(?P<language>\S*)(?: title=\"(?P<title>[^\"]+)\")?\n(?P<text>.*?)^```$", re.M | re.S
)


def without_numbers(line: str) -> list[str]:
    """Return the words of a line with its numbers left out."""
    return [re.sub(r"[+-]?\d+(\.\d+)?", "0", word) for word in line.split()]


def renewed(printed: list[str], output: list[str]) -> list[str]:
    """Return the lines of the page with the numbers of the output."""
    if "..." not in printed:
        return output
    found, at = [], 0
    for line in printed:
        wanted = without_numbers(line)
        hit = next(
            (i for i in range(at, len(output)) if without_numbers(output[i]) == wanted), None
        )
        if line == "..." or hit is None:
            if line != "...":
                print(f"not printed: {line}", file=sys.stderr)
            found.append(line)
        else:
            found.append(output[hit])
            at = hit + 1
    return found


def answered(text: str, folder: Path, environment: dict[str, str]) -> str:
    """Return a block of commands with what they print."""
    parts = re.split(r"^\$ ", text, flags=re.M)[1:]
    made = []
    for part in parts:
        lines = part.splitlines()
        end = next(i for i, line in enumerate(lines) if not line.endswith("\\")) + 1
        command = "\n".join(lines[:end])
        print(f"$ {command}", file=sys.stderr)
        done = subprocess.run(
            command, shell=True, cwd=folder, env=environment, capture_output=True, text=True
        )
        if done.returncode:
            print(f"exit code {done.returncode}\n{done.stderr}", file=sys.stderr)
        output = [line.rstrip() for line in done.stdout.splitlines()]
        made += [f"$ {command}", *renewed("\n".join(lines[end:]).rstrip().splitlines(), output)]
    return "\n".join(made) + "\n"


def main() -> None:
    """Follow the page in a new folder and write it again."""
    page = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as scratch:
        folder, tools = Path(scratch) / "c182", Path(scratch) / "bin"
        folder.mkdir(), tools.mkdir()
        (tools / "aeromatch").write_text(
            f"#!{sys.executable}\nfrom aeromatch.cli import main\nmain()\n"
        )
        (tools / "aeromatch").chmod(0o755)
        environment = {
            **os.environ,
            "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
        }

        def follow(match: re.Match[str]) -> str:
            if match["title"]:
                (folder / match["title"]).write_text(match["text"], encoding="utf-8")
            if match["language"] != "console":
                return match[0]
            return f"```console\n{answered(match['text'], folder, environment)}```"

        PAGE.write_text(FENCE.sub(follow, page), encoding="utf-8")
        for file in PROJECT:
            shutil.copy(folder / file, EXAMPLE / file)


if __name__ == "__main__":
    main()
