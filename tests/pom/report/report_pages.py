"""Helpers of the tests of the page: written, unpacked, with other verdicts."""

import re

import report_fixture as fixture

import pom
from pom.judging.modal import mode_table
from pom.report.page import html_files
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
    return pom.write_report(arguments.pop("results", None) or fixture.results(), folder, **arguments)


def parcels(html):
    """Return head and body of every packed page, by the id of its article."""
    without_script = r"<noscript>(?:(?!</noscript>).)*</noscript>"
    packed = rf'id="([^"]+)"[^>]*>\s*{without_script}\s*<div class="body"></div>\s*<script type="text/plain" class="parcel">([^<]+)'
    return {name: traces.opened(text) for name, text in re.findall(packed, html, re.S)}


def texts(html):
    """Return the page with every packed part unpacked in its place."""
    return html + "".join(f'<article id="{name}">{head["page"]}</article>' for name, (head, _) in parcels(html).items())


def page(results, fits=(), databases=None, support=None):
    """The page alone, as text with its packed parts unpacked."""
    modes = [mode_table(result) for result in results]
    html = html_files(results, "T-37", "A", {}, databases or {}, {}, support or {}, modes, fits)["report.html"]
    return texts(html)


def set_rows(table, column, value, **cells):
    """Set cells of the rows of a verdict table that have a value in a column."""
    for index in table.index[table[column] == value]:
        for name, cell in cells.items():
            table.at[index, name] = cell
