"""The report on paper: time and size of a PDF of a hundred pages, and of all that is written next
to it.

    python benchmarks/report_pdf.py      # 32 cases, about 100 pages
    python benchmarks/report_pdf.py --cases 100 --paper letter

Results are those of ``report_page.py``: 3 models, 7 channels, 30 s at 50 Hz.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from pathlib import Path

from report_page import MODELS, result

import pom
from flightmech.support.console import print_table
from pom.judging.measures.modal import mode_table
from pom.report.case.page import case_keys
from pom.report.chapters import Chapters
from pom.report.pdf.content import case_on_paper
from pom.report.pdf.document import DocumentContent, pdf_pages


def main() -> None:
    """Read the command line, make the document twice, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=32)
    parser.add_argument("--paper", choices=["a4", "letter"], default="a4")
    options = parser.parse_args()
    results = [result(number) for number in range(options.cases)]
    modes = [mode_table(one) for one in results]
    names, dated = case_keys(results), {"date": "2026-11-21"}
    times, made = [], set()
    for _ in range(2):
        begin, worked = time.perf_counter(), time.process_time()
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            cases = [
                case_on_paper(folder, i, name, one, dated, None, table, options.paper)
                for i, (name, one, table) in enumerate(zip(names, results, modes, strict=True), 1)
            ]
            document = pdf_pages(
                folder,
                results,
                names,
                cases,
                DocumentContent(
                    title="Report on paper",
                    revision="A",
                    provenance=dated,
                    paper=options.paper,
                    attached={},
                    chapters=Chapters({}),
                ),
            )
        times.append((time.perf_counter() - begin, time.process_time() - worked))
        made.add(document)
    found = re.search(rb"NPages>(\d+)<", document)
    pages = int(found.group(1)) if found else 0
    rows = [
        [
            "cases x models x samples",
            f"{len(results)} x {len(MODELS)} x {results[0].signals.sizes['time']}",
        ],
        ["pages", f"{pages}"],
        [
            "size",
            f"{len(document) / 1e6:.2f} MB, {len(document) / 1e3 / max(pages, 1):.0f} kB a page",
        ],
        ["made in", f"{times[0][0]:.1f} s, again {times[1][0]:.1f} s"],
        [
            "processor time",
            f"{times[1][1]:.1f} s, {1e3 * times[1][1] / max(pages, 1):.0f} ms a page",
        ],
        ["twice the same bytes", "yes" if len(made) == 1 else "NO"],
    ]
    with tempfile.TemporaryDirectory() as output:
        for paper in (None, options.paper):
            begin = time.perf_counter()
            pom.write_report(results, output, title="Report on paper", paper=paper)
            rows.append(
                [
                    f"whole report, {'PDF' if paper else 'no PDF'}",
                    f"{time.perf_counter() - begin:.1f} s",
                ]
            )
        rows += [
            [path.name, f"{path.stat().st_size / 1e6:.2f} MB"]
            for path in sorted(Path(output).iterdir())
            if path.is_file()
        ]
        size = sum(path.stat().st_size for path in Path(output, "csv").iterdir())
        rows.append(["csv", f"{size / 1e6:.2f} MB"])
        begin = time.perf_counter()
        findings = pom.verify(output)
        rows.append(
            [
                "verified in",
                f"{time.perf_counter() - begin:.1f} s, "
                f"{sum(x.state != 'same' for x in findings)} of {len(findings)} differ",
            ]
        )
    print_table(["", ""], rows)


if __name__ == "__main__":
    main()
