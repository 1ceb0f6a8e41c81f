"""Writes the tables into the documents, between `<!-- table NAME -->` and `<!-- end of table -->`."""

import json
import re
import sys
import textwrap

from commands import COMMANDS
from tables import TABLES

DOCUMENTS = ["docs/RESULTS.md", "README.md"]
BLOCK = re.compile(r"<!-- table (?P<name>[a-z0-9-]+) -->\n.*?<!-- end of table -->", re.DOTALL)


def write(project, folder, commit):
    """Replaces every table of the documents; all of them, or none where one cannot be made."""
    texts = {project / name: (project / name).read_text() for name in DOCUMENTS}
    used = [match["name"] for text in texts.values() for match in BLOCK.finditer(text)]
    for name in used:
        if name not in TABLES:
            sys.exit(f"no table has the name {name}; there are {', '.join(TABLES)}")
    unused = set(TABLES) - set(used)
    if unused:
        sys.exit(f"no document shows the tables {', '.join(sorted(unused))}")
    tables = {name: table(name, folder, commit) for name in used}
    for path, text in texts.items():
        path.write_text(BLOCK.sub(lambda match: tables[match["name"]], text))
        print(f"wrote {path}")


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
