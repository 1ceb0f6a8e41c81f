"""A preprocessor of mdBook: links to files outside docs/ lead to the repository's page of the file.

mdBook calls it as `repository_links.py supports html`, and then with the book as JSON on standard input.
"""

import json
import posixpath
import re
import sys

REPOSITORY = "https://github.com/splatseg/splatseg/blob/main/"
LINK = re.compile(r"\]\((?!\w+:|#)([^)\s]+)")


def with_repository_links(text: str, page: str) -> str:
    """The text of a page, whose path is relative to docs/, with its links changed."""

    def changed(link: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), link[1]))
        return link[0] if path.startswith("docs/") else f"]({REPOSITORY}{path}"

    return LINK.sub(changed, text)


def change_items(items: list) -> None:
    """Changes chapters and those below them."""
    for item in items:
        if isinstance(item, dict) and "Chapter" in item:
            chapter = item["Chapter"]
            if chapter["path"] is not None:
                chapter["content"] = with_repository_links(chapter["content"], chapter["path"])
            change_items(chapter["sub_items"])


def main() -> None:
    """Reads the book and writes the changed one."""
    if sys.argv[1:2] == ["supports"]:
        sys.exit(0 if sys.argv[2:] == ["html"] else 1)
    _, book = json.load(sys.stdin)
    # Named `sections` before mdBook 0.5.
    change_items(book["items"] if "items" in book else book["sections"])
    json.dump(book, sys.stdout)


if __name__ == "__main__":
    main()
