"""Checks that every local link of a site leads to a file and, if it names one, a heading: check_site.py FOLDER"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The links and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes what a tag links to, and its name."""
        values = dict(attrs)
        self.anchors |= {values[key] for key in ("id", "name") if values.get(key)}
        self.links += [values[key] for key in ("href", "src") if values.get(key)]


def main(folder: Path) -> int:
    """Prints the links that lead nowhere; returns the exit code."""
    pages = {path: Page(path.read_text()) for path in folder.rglob("*.html")}
    wrong, count = [], 0
    for path, page in pages.items():
        # The page for missing files, and the one for printing, repeat the others from another place.
        if path.name in ("404.html", "print.html", "toc.html"):
            continue
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            count += 1
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
            known = {other.resolve(): other for other in pages} if parts.fragment else {}
            if not target.exists():
                wrong.append(f"{path}: {link}")
            elif target in known and unquote(parts.fragment) not in pages[known[target]].anchors:
                wrong.append(f"{path}: {link}: no such heading")
    print(*wrong, f"{len(pages)} pages, {count} links, {len(wrong)} of them wrong", sep="\n")
    return 1 if wrong or not pages else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
