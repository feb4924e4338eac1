"""Cells of tables: text is escaped, markup is not."""

from motord.report.html import Markup, Page


def test_only_markup_is_not_escaped():
    page = Page("x", style="p{color:red}")
    page.table(("a", "b"), [("<i>1</i>", Markup("<b>2</b>"))])
    html = page.html()
    assert "<td>&lt;i&gt;1&lt;/i&gt;</td><td><b>2</b></td>" in html
    assert "p{color:red}</style>" in html
