"""Writes the tables: between `<!-- table NAME -->` and `<!-- end of table -->` in documents, and the appendix as a whole."""

import json
import re
import sys
import textwrap

from appendix import INTRODUCTION, SECTIONS
from commands import COMMANDS
from tables import TABLES

DOCUMENTS = ["README.md", "docs/RESULTS.md", "docs/dev/ABLATIONS.md"]
APPENDIX = "docs/RESULTS_TABLES.md"
BLOCK = re.compile(r"<!-- table (?P<name>[a-z0-9-]+) -->\n.*?<!-- end of table -->", re.DOTALL)


def write(project, folder, commit):
    """Replaces the tables of the documents: all of them or, if one cannot be made, none."""
    texts = {project / name: (project / name).read_text() for name in DOCUMENTS}
    used = [match["name"] for text in texts.values() for match in BLOCK.finditer(text)]
    used += [name for _, _, names in SECTIONS for name in names]
    for name in used:
        if name not in TABLES:
            sys.exit(f"there is no table {name}; expected one of {', '.join(TABLES)}")
    unused = set(TABLES) - set(used)
    if unused:
        sys.exit(f"no document shows the tables {', '.join(sorted(unused))}")
    tables = {name: table(name, folder, commit) for name in used}
    for path, text in texts.items():
        path.write_text(BLOCK.sub(lambda match: tables[match["name"]], text))
        print(f"wrote {path}")
    parts = [INTRODUCTION]
    for heading, note, names in SECTIONS:
        parts += [
            f"## {heading}\n",
            f"{wrapped_note(note)}\n" if note else "",
            *(tables[name] + "\n" for name in names),
        ]
    (project / APPENDIX).write_text("\n".join(part for part in parts if part))
    print(f"wrote {project / APPENDIX}")


def wrapped_note(note):
    return textwrap.fill(note, 120, break_long_words=False, break_on_hyphens=False)


def table(name, folder, commit):
    """A table with its stamp: the version of the program, date, machine and commands."""
    definition = TABLES[name]
    done = {command: json.loads((folder / command / "done.json").read_text()) for command in definition.commands}
    stale = [command for command, record in done.items() if record["command"] != COMMANDS[command].text()]
    if stale:
        sys.exit(f"commands have changed since they were run; remove their folders in {folder}: {', '.join(stale)}")
    machines = sorted({record["machine"] for record in done.values()})
    if len(machines) > 1:
        sys.exit(f"table {name} mixes machines: {'; '.join(machines)}")
    if {record["commit"] for record in done.values()} != {commit}:
        sys.exit(f"table {name} mixes versions of the program")
    dates = sorted({record["date"] for record in done.values()})
    body = definition.render({command: folder / command for command in definition.commands})
    stamp = f"Commit {commit}, {' and '.join(dates)}, {machines[0]}:"
    lines = "\n".join(wrapped(COMMANDS[command].text()) for command in definition.commands)
    shown = f"{stamp}\n\n```sh\n{lines}\n```" if definition.shows_commands else f"{stamp[:-1]}; {definition.source}."
    return f"<!-- table {name} -->\n{body.strip()}\n\n{shown}\n<!-- end of table -->"


def wrapped(command):
    lines = textwrap.wrap(command, 112, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    return " \\\n".join(lines)
