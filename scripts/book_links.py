"""Corrects the pages of the book: links that leave it lead to the files of the repository.

    scripts/book_links.py BOOK DOCS

A page of the book lies in another folder than its source, and mdbook turns links to `.md` files into `.html` also where
the target is no page of the book. A link to `src/lib.rs` of a crate leads to its API documentation in BOOK/api.
"""

import os
import re
import sys
from pathlib import Path

LINK = re.compile(r'((?:href|src)=")([^"#:]+)((?:#[^"]*)?")')


def crate_page(file, book):
    """Page of a crate in the API documentation, of which `file` is `src/lib.rs`; else None."""
    if not file.endswith("/src/lib.rs"):
        return None
    page = book / "api" / Path(file).parts[-3].replace("-", "_") / "index.html"
    return page if page.exists() else None


def corrected(page, book, docs):
    """Text of a page with its links corrected, and how many were."""
    count = 0
    source = docs / page.relative_to(book).parent

    def correct(match):
        nonlocal count
        inside = os.path.normpath(page.parent / match[2])
        if os.path.commonpath([inside, book]) == str(book):
            # mdbook writes README.md as index.html.
            index = re.sub(r"README\.html$", "index.html", match[2])
            return match[1] + (match[2] if os.path.exists(inside) else index) + match[3]
        file = os.path.normpath(source / match[2])
        count += 1
        api = crate_page(file, book)
        if api:
            return match[1] + os.path.relpath(api, page.parent) + match[3]
        markdown = re.sub(r"\.html$", ".md", file)
        if not os.path.exists(file) and os.path.exists(markdown):
            file = markdown
        return match[1] + os.path.relpath(file, page.parent) + match[3]

    return LINK.sub(correct, page.read_text()), count


def main():
    book, docs = (Path(p).resolve() for p in sys.argv[1:3])
    total = 0
    pages = (p for p in book.rglob("*.html") if book / "api" not in p.parents)
    for page in sorted(pages):
        text, count = corrected(page, book, docs)
        total += count
        if count:
            page.write_text(text)
    print(f"book: {total} links lead to the API documentation or to files of the repository")


main()
