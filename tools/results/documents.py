"""Writes the tables: between `<!-- table NAME -->` and `<!-- end of table -->` in documents, and the appendix as a whole."""

import json
import re
import sys
import textwrap

from appendix import INTRODUCTION, SECTIONS
from commands import COMMANDS
from tables import TABLES

DOCUMENTS = ["docs/RESULTS.md", "docs/dev/ABLATIONS.md"]
APPENDIX = "docs/RESULTS_TABLES.md"
BLOCK = re.compile(r"<!-- table (?P<name>[a-z0-9-]+) -->\n.*?<!-- end of table -->", re.DOTALL)


def write(project, folder, commit):
    """Replaces the tables whose commands have been run on this version, in the documents and in the appendix. The others
    stay as they are: each table names its own version."""
    appendix = project / APPENDIX
    texts = {project / name: (project / name).read_text() for name in DOCUMENTS}
    before = {match["name"]: match[0] for match in BLOCK.finditer(appendix.read_text())}
    before |= {match["name"]: match[0] for text in texts.values() for match in BLOCK.finditer(text)}
    shown = {name for _, _, names in SECTIONS for name in names}
    for name in shown - set(before):
        before[name] = f"<!-- table {name} -->\n<!-- end of table -->"
    if unknown := set(before) - set(TABLES):
        sys.exit(f"there is no table {', '.join(sorted(unknown))}; expected {', '.join(TABLES)}")
    if unused := set(TABLES) - set(before):
        sys.exit(f"no document shows the tables {', '.join(sorted(unused))}")
    is_done = {command: (folder / command / "done.json").is_file() for command in COMMANDS}
    new = [name for name in TABLES if all(is_done[command] for command in TABLES[name].commands)]
    tables = before | {name: table(name, folder, commit) for name in new}
    for path, text in texts.items():
        path.write_text(BLOCK.sub(lambda match: tables[match["name"]], text))
    parts = [INTRODUCTION]
    for heading, note, names in SECTIONS:
        parts += [
            f"## {heading}\n",
            f"{wrapped_note(note)}\n" if note else "",
            *(tables[name] + "\n" for name in names),
        ]
    appendix.write_text("\n".join(part for part in parts if part))
    print(f"wrote {len(new)} tables; of another version: {', '.join(sorted(set(tables) - set(new))) or 'none'}")


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
