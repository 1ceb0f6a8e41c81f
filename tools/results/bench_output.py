"""Reads the output of `splatseg bench` and `splatseg run`."""

import json
import re


def sections(folder):
    """The tables of a benchmark's tables.md: for each title, the rows as lists of cells, the header first."""
    text = (folder / "out/tables.md").read_text()
    found = {}
    for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title, _, body = part.partition("\n")
        lines = [line for line in body.splitlines() if line.startswith("| ")]
        found[title] = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    return found


def scores(folder, where, protocol="paper"):
    """The measured rows over all scenes (`where` is None) or of one scene: the cells of each row by column."""
    for title, rows in sections(folder).items():
        is_total = re.match(r"(All \d+ scenes|1 scene), ", title)
        if title.endswith(f"protocol {protocol}") and (is_total if where is None else title.startswith(where + ", ")):
            head = rows[0]
            measured = [row for row in rows[1:] if not row[0].startswith("*")]
            return {row[0]: dict(zip(head[1:], row[1:])) for row in measured}
    raise SystemExit(f"{folder}: no table of {where or 'all scenes'}, protocol {protocol}")


def sizes(folder, protocol="paper"):
    """The rows by object size: for each method and size, the cells by column."""
    rows = sections(folder)[f"By size of the object, protocol {protocol}"]
    return {(row[0], row[1]): dict(zip(rows[0][2:], row[2:])) for row in rows[1:]}


def single_frames(folder):
    """The single-frame rows: for each method, the cells by column."""
    rows = sections(folder)["Single frames"]
    return {row[0]: dict(zip(rows[0][1:], row[1:])) for row in rows[1:]}


def mean(cell):
    """Parses `43.74 ± 0.21` to 43.74; None for an empty cell."""
    number = re.match(r"-?[0-9.]+", cell)
    return float(number.group()) if number else None


def summary(folder):
    return json.loads((folder / "out/summary.json").read_text())
