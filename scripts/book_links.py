"""Corrects the pages of the book: links that leave it lead to the files of the repository.

    scripts/book_links.py BOOK DOCS

A page of the book lies in another folder than its source, and mdbook turns links to `.md` files into `.html` also where
the target is no page of the book.
"""

import os
import re
import sys
from pathlib import Path

LINK = re.compile(r'((?:href|src)=")([^"#:]+)((?:#[^"]*)?")')


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
        markdown = re.sub(r"\.html$", ".md", file)
        if not os.path.exists(file) and os.path.exists(markdown):
            file = markdown
        count += 1
        return match[1] + os.path.relpath(file, page.parent) + match[3]

    return LINK.sub(correct, page.read_text()), count


def main():
    book, docs = (Path(p).resolve() for p in sys.argv[1:3])
    total = 0
    for page in sorted(book.rglob("*.html")):
        text, count = corrected(page, book, docs)
        total += count
        if count:
            page.write_text(text)
    print(f"book: {total} links lead to files of the repository")


main()
