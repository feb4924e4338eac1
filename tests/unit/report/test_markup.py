"""How text becomes markup: what is escaped, what stays as it is, what stays together."""

from motord.findings import Finding
from motord.report.html import Markup, Page, escape


def test_only_markup_is_not_escaped():
    page = Page("x", style="p{color:red}")
    page.table(("a", "b"), [("<i>1</i>", Markup("<b>2</b>"))])
    html = page.html()
    assert "<td>&lt;i&gt;1&lt;/i&gt;</td><td><b>2</b></td>" in html
    assert "p{color:red}</style>" in html


def test_no_line_ends_within_an_interval():
    assert escape("0.80 +- 0.02") == "0.80\u00a0\u00b1\u00a00.02"
    assert escape("(+-1.2 %)") == "(\u00b11.2 %)"


def test_a_finding_spells_a_channel_as_it_is_spelled():
    page = Page("A motor")
    page.findings([Finding("not-steady", 2.1, 2.0, "%", "note", "magnet_C rises", "wait")])
    assert "<p>magnet_C rises.</p><p><em>Wait.</em>" in page.html()
