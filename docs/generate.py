"""Writes what pages take from the code; `make golden` runs it.

That is the pages about errors, see error_pages.py, the tables of other pages, see tables.py, and the grammar for
editors, see textmate.py.
"""

from __future__ import annotations

if __name__ == "__main__":
    import error_pages
    import textmate
    from tables import filled, pages

    textmate.FILE.write_text(textmate.format_grammar(), encoding="utf-8")

    for path, text in error_pages.pages():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    for page in pages():
        page.write_text(filled(page.read_text("utf-8")), encoding="utf-8")
