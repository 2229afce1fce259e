"""Helpers of the tests of the page: written, unpacked, with other verdicts."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import report_fixture as fixture

import pom
from pom.judging.measures.modal import mode_table
from pom.report.case.page import CommonHeading, case_keys, packed_page
from pom.report.chapters import Chapters, draw_chapters
from pom.report.page import html_files
from pom.report.pdf.content import case_on_paper
from pom.report.pdf.document import DocumentContent, document_date, pdf_pages
from pom.report.presentation import traces


def write(folder, **change):
    arguments = {
        "title": "T-37 flight model",
        "provenance": fixture.PROVENANCE,
        "databases": fixture.databases(),
        "diagnoses": {"short_period_full_flaps": fixture.diagnosis()},
        "revision": "A",
        "paper": None,
        **change,
    }
    return pom.write_report(
        arguments.pop("results", None) or fixture.results(), folder, **arguments
    )


def parcels(html):
    """Return head and body of every packed page, by the id of its article."""
    without_script = r"<noscript>(?:(?!</noscript>).)*</noscript>"
    packed = (
        rf'id="([^"]+)"[^>]*>\s*{without_script}\s*<div class="body"></div>\s*<script '
        rf'type="text/plain" class="parcel">([^<]+)'
    )
    return {name: traces.unpack_page(text) for name, text in re.findall(packed, html, re.S)}


def texts(html):
    """Return the page with every packed part unpacked in its place."""
    return html + "".join(
        f'<article id="{name}">{head["page"]}</article>'
        for name, (head, _) in parcels(html).items()
    )


def page(results, fits=(), databases=None, support=None):
    """The page alone, as text with its packed parts unpacked."""
    return texts(html(results, fits, databases, support)["report.html"])


def html(results, fits=(), databases=None, support=None):
    """The page and what it loads."""
    heading = CommonHeading(len(results), {}, bool(databases))
    named = zip(case_keys(results), results, strict=True)
    cases = [
        packed_page(i, key, result, heading, None, mode_table(result))
        for i, (key, result) in enumerate(named, 1)
    ]
    return html_files(
        results,
        cases,
        "T-37",
        "A",
        {},
        draw_chapters(databases or {}, support or {}, fits, {}, (), {}, ()),
    )


def paper(results, form="a4", **more):
    """The document for paper; further arguments are those of `DocumentContent`."""
    common = {
        "title": "T-37",
        "revision": "A",
        "provenance": {},
        "attached": {},
        "chapters": Chapters({}),
        **more,
    }
    names, diagnoses = case_keys(results), common.pop("diagnoses", {})
    with TemporaryDirectory() as folder:
        cases = [
            case_on_paper(
                Path(folder),
                i,
                name,
                result,
                common["provenance"],
                diagnoses.get(result.case.name),
                mode_table(result),
                form,
            )
            for i, (name, result) in enumerate(zip(names, results, strict=True), 1)
        ]
        content = DocumentContent(
            paper=form, **{"created": document_date(common["provenance"]), **common}
        )
        return pdf_pages(Path(folder), results, names, cases, content)


def set_rows(table, column, value, **cells):
    """Set cells of the rows of a verdict table that have a value in a column."""
    for index in table.index[table[column] == value]:
        for name, cell in cells.items():
            table.at[index, name] = cell
