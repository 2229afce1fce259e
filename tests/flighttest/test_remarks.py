"""Text and notebook view of a result, from its lines and remarks."""

from dataclasses import dataclass, field

from flighttest.remarks import PrintedResult, Remark


@dataclass(frozen=True)
class Balance(PrintedResult):
    remarks: list[Remark] = field(default_factory=list)

    def report_lines(self):
        return ["forces", "Fx < 1 N", ""]


def test_the_text_ends_with_one_line_for_each_remark():
    remarks = [Remark("bound", "at its bound"), Remark("range", "negative", severity="error")]
    assert Balance(remarks).report() == "forces\nFx < 1 N\n\n! at its bound\n!! negative"


def test_the_text_without_remarks_has_no_empty_line_at_its_end():
    assert Balance().report() == "forces\nFx < 1 N"


def test_a_notebook_shows_the_text():
    assert Balance()._repr_html_() == "<pre>forces\nFx &lt; 1 N</pre>"
