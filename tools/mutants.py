"""Mutation testing in one build: finds code changes in a crate that its tests do not notice.

`cargo mutants` builds the crate once for every mutant. This script takes its list of mutants, writes all of them into
one copy of the crate, each behind a switch controlled by an environment variable, and builds the tests once. For each
mutant it runs only the tests that reach it, the fastest first, until one fails.

Mutants that cannot be switched this way (deleted match arms and struct fields, operators in constants and macros,
conditions with `let`) are counted as `not placed`; run them with `cargo mutants -F`.

cargo install cargo-mutants --locked
pip install tree-sitter tree-sitter-rust
python tools/mutants.py metrics --work /tmp/mutants             the crate crates/metrics
python tools/mutants.py memory --work /tmp/mutants --file growth.rs --file removal.rs
"""

import argparse
import collections
import concurrent.futures
import dataclasses
import json
import os
import re
import subprocess
import threading
import time
from pathlib import Path

import tree_sitter
import tree_sitter_rust

COMPARISONS = {"<", "<=", ">", ">=", "==", "!="}
SHORT_CIRCUIT = {"&&", "||"}
CONSTANT = {"const_item", "static_item", "attribute_item", "macro_invocation", "macro_definition", "array_type"}
# Tests faster than this, seconds, share a process, because starting one for each takes longer.
QUICK = 0.2
SWITCH = """//! The switch of the mutants.
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
static ACTIVE: AtomicU32 = AtomicU32::new(u32::MAX);
const COVER: u32 = u32::MAX - 1;
static SEEN: [AtomicBool; 8192] = [const { AtomicBool::new(false) }; 8192];
#[cold]
fn init() -> u32 {
    let active = match std::env::var("MUTANT") {
        Ok(value) if value == "cover" => COVER,
        Ok(value) => value.parse().unwrap(),
        Err(_) => 0,
    };
    ACTIVE.store(active, Relaxed);
    active
}
#[cold]
fn cover(id: u32) {
    if !SEEN[id as usize].load(Relaxed) && !SEEN[id as usize].swap(true, Relaxed) {
        use std::io::Write;
        let path = std::env::var("MUTANT_COVER").unwrap();
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(path).unwrap();
        file.write_all(format!("{id}\\n").as_bytes()).unwrap();
    }
}
/// True if mutant `id` is active.
#[inline(always)]
pub fn on(id: u32) -> bool {
    let mut active = ACTIVE.load(Relaxed);
    if active == u32::MAX {
        active = init();
    }
    if active == COVER {
        cover(id);
        return false;
    }
    active == id
}
"""


class Rewriter:
    """Rewrites one file to contain its mutants."""

    def __init__(self, source: bytes, mutants: list[dict]):
        self.source = source
        self.placed: set[int] = set()
        self.operators, self.guards, self.bodies = (collections.defaultdict(list) for _ in range(3))
        by_genre = {
            "BinaryOperator": self.operators,
            "UnaryOperator": self.operators,
            "MatchArmGuard": self.guards,
            "FnValue": self.bodies,
        }
        lines = source.split(b"\n")
        starts = [0]
        for line in lines:
            starts.append(starts[-1] + len(line) + 1)
        for mutant in mutants:
            start = mutant["span"]["start"]
            before = lines[start["line"] - 1].decode()[: start["column"] - 1]
            if mutant["genre"] in by_genre:
                by_genre[mutant["genre"]][starts[start["line"] - 1] + len(before.encode())].append(mutant)

    def rewritten(self) -> str:
        parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_rust.language()))
        return self.emit(parser.parse(self.source).root_node)

    def text(self, node) -> str:
        return self.source[node.start_byte : node.end_byte].decode()

    def chosen(self, mutants: list[dict], changed, original: str) -> str:
        """An expression for the original, or for `changed` of a mutant's replacement if that mutant is active."""
        out = ""
        for mutant in mutants:
            mark = f"/*M{mutant['id']}*/"
            self.placed.add(mutant["id"])
            out += (
                f"if crate::mutation::on({mutant['id']}) {{ {mark}\n{changed(mutant['replacement'])} {mark}\n}} else "
            )
        return out + f"{{ {original} }}"

    def emit_children(self, node) -> str:
        out, position = "", node.start_byte
        for child in node.children:
            out += self.source[position : child.start_byte].decode() + self.emit(child)
            position = child.end_byte
        return out + self.source[position : node.end_byte].decode()

    def emit(self, node) -> str:
        kind = node.type
        is_repeat = kind == "array_expression" and any(child.type == ";" for child in node.children)
        is_pattern = kind.endswith("_pattern") and kind != "match_pattern"
        if kind in CONSTANT or is_repeat or is_pattern or not node.children:
            return self.text(node)
        emit = {
            "binary_expression": self.binary,
            "compound_assignment_expr": self.assignment,
            "unary_expression": self.unary,
            "match_pattern": self.guard,
            "function_item": self.function,
        }.get(kind)
        return (emit and emit(node)) or self.emit_children(node)

    def binary(self, node) -> str | None:
        operator = self.text(node.child_by_field_name("operator"))
        mutants = self.operators.get(node.child_by_field_name("operator").start_byte)
        if not mutants or (operator in SHORT_CIRCUIT and has_let(node)):
            return None
        left, right = (self.emit(node.child_by_field_name(side)) for side in ("left", "right"))
        if operator in SHORT_CIRCUIT:
            choice = self.chosen(mutants, lambda other: f"ml {other} ({right})", f"ml {operator} ({right})")
            return f"(match {left} {{ ml => {choice} }})"
        operands = f"(&({left}), &({right}))" if operator in COMPARISONS else f"({left}, {right})"
        return (
            f"(match {operands} {{ (ml, mr) => {self.chosen(mutants, lambda o: f'ml {o} mr', f'ml {operator} mr')} }})"
        )

    def assignment(self, node) -> str | None:
        operator = node.child_by_field_name("operator")
        mutants = self.operators.get(operator.start_byte)
        if not mutants:
            return None
        left, right = (self.emit(node.child_by_field_name(side)) for side in ("left", "right"))
        choice = self.chosen(mutants, lambda other: f"{left} {other} mr", f"{left} {self.text(operator)} mr")
        return f"(match {right} {{ mr => {choice} }})"

    def unary(self, node) -> str | None:
        mutants, operator = self.operators.get(node.start_byte), self.text(node.children[0])
        if not mutants or operator not in "!-":
            return None
        return (
            f"(match {self.emit(node.children[1])} {{ mx => {self.chosen(mutants, lambda _: 'mx', operator + 'mx')} }})"
        )

    def guard(self, node) -> str:
        condition = node.child_by_field_name("condition")
        if condition is None:
            return self.text(node)
        emitted, mutants = self.emit(condition), self.guards.get(condition.start_byte)
        if mutants and not has_let(condition):
            emitted = f"({self.chosen(mutants, lambda other: other, emitted)})"
        before, after = (
            self.source[node.start_byte : condition.start_byte],
            self.source[condition.end_byte : node.end_byte],
        )
        return before.decode() + emitted + after.decode()

    def function(self, node) -> str | None:
        if any(child.type == "function_modifiers" and "const" in self.text(child) for child in node.children):
            return self.text(node)
        body = node.child_by_field_name("body")
        statements = [child for child in body.named_children if "comment" not in child.type]
        mutants = self.bodies.get(statements[0].start_byte) if statements else None
        # A function that returns `impl Trait` has a single return type, and a mutant's differs.
        if not mutants or "impl " in self.text(node.child_by_field_name("return_type") or node.children[0]):
            return None
        returns = ""
        for mutant in mutants:
            mark = f"/*M{mutant['id']}*/"
            self.placed.add(mutant["id"])
            returns += f"if crate::mutation::on({mutant['id']}) {{ {mark}\nreturn {mutant['replacement']}; {mark}\n}}\n"
        return self.source[node.start_byte : body.start_byte].decode() + "{" + returns + self.emit_children(body)[1:]


def has_let(node) -> bool:
    return node.type in ("let_condition", "let_chain") or any(has_let(child) for child in node.children)


def write_mutants(copy: Path, crate: str, mutants: list[dict], unviable: set[int]) -> set[int]:
    """Writes the mutants into the copy; returns those that could be placed."""
    placed: set[int] = set()
    by_file = collections.defaultdict(list, {f"crates/{crate}/src/lib.rs": []})
    for mutant in mutants:
        by_file[mutant["file"]].append(mutant)
    for file, in_file in by_file.items():
        source = subprocess.check_output(["git", "-C", copy, "show", f"HEAD:{file}"])
        rewriter = Rewriter(source, [mutant for mutant in in_file if mutant["id"] not in unviable])
        (copy / file).write_text(rewriter.rewritten())
        placed |= rewriter.placed
    library = copy / "crates" / crate / "src/lib.rs"
    lines = library.read_text().splitlines()
    first = next(number for number, line in enumerate(lines) if not line.startswith("//!"))
    lines.insert(first, "#![allow(warnings, clippy::all)]")
    library.write_text("\n".join([*lines, "#[doc(hidden)]", "pub mod mutation;", ""]))
    (copy / "crates" / crate / "src/mutation.rs").write_text(SWITCH)
    return placed


def cargo(copy: Path, arguments: list[str]) -> tuple[bool, list[dict]]:
    done = subprocess.run(
        ["cargo", *arguments, "--message-format=json"], check=False, cwd=copy, capture_output=True, text=True
    )
    return done.returncode == 0, [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def build(copy: Path, crate: str, mutants: list[dict]) -> tuple[set[int], set[int], list[str]]:
    """Builds the tests, without the mutants that do not compile; returns those placed, those not, and the programs."""
    unviable: set[int] = set()
    while True:
        placed = write_mutants(copy, crate, mutants, unviable)
        worked, messages = cargo(copy, ["build", "--lib", "-p", f"splatseg-{crate}"])
        if worked:
            break
        found: set[int] = set()
        errors = [m["message"] for m in messages if m.get("reason") == "compiler-message"]
        for error in (error for error in errors if error["level"] == "error"):
            for span in (span for span in error["spans"] if span["is_primary"]):
                line = (copy / span["file_name"]).read_text().split("\n")[span["line_start"] - 1]
                found |= {int(number) for number in re.findall(r"/\*M(\d+)\*/", line)}
        if not found:
            raise SystemExit(f"does not build: {[error['rendered'] for error in errors][:3]}")
        unviable |= found
    worked, messages = cargo(copy, ["test", "--no-run", "-p", f"splatseg-{crate}"])
    if not worked:
        raise SystemExit("the tests do not build")
    tests = [message for message in messages if message.get("executable") and message.get("profile", {}).get("test")]
    programs = [test["executable"] for test in tests if f"/crates/{crate}/" in test["manifest_path"]]
    return placed, unviable, programs


@dataclasses.dataclass
class Test:
    """A test: its program and name, its time without a mutant, and the mutants that it reaches."""

    program: str
    name: str
    seconds: float
    reached: set[int]


def run(program: str, tests: list[str], folder: Path, variables: dict, limit: float) -> tuple[str, float]:
    """Runs tests of a program up to the first failure; returns the outcome and the time in seconds."""
    start = time.monotonic()
    # A mutant's files must not stay in the user's cache.
    environment = os.environ | {"PROPTEST_DISABLE_FAILURE_PERSISTENCE": "1", "SPLATSEG_CACHE": ""} | variables
    command = ["prlimit", "--as=8000000000", program, "--test-threads=1", "--exact", *tests]
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    timer = threading.Timer(limit, process.kill)
    timer.start()
    has_failed = any(line.endswith("... FAILED\n") for line in process.stdout)
    if has_failed:
        process.kill()
    code = process.wait()
    seconds = time.monotonic() - start
    timer.cancel()
    if has_failed:
        return "caught", seconds
    if seconds >= limit:
        return "timeout", seconds
    return "passed" if code == 0 else "caught", seconds


def measured(program: str, name: str, folder: Path, work: Path) -> Test:
    """Runs a test twice, the second time to find the mutants that it reaches."""
    outcome, seconds = run(program, [name], folder, {}, 900)
    if outcome != "passed":
        raise SystemExit(f"{program} {name}: {outcome} without any mutant")
    cover = (work / f"reached-{Path(program).name}-{name.replace('::', '.')}").resolve()
    cover.unlink(missing_ok=True)
    run(program, [name], folder, {"MUTANT": "cover", "MUTANT_COVER": str(cover)}, 1800)
    reached = {int(line) for line in cover.read_text().split()} if cover.exists() else set()
    cover.unlink(missing_ok=True)
    return Test(program, name, seconds, reached)


def in_turn(tests: list[Test]) -> list[tuple[str, list[Test]]]:
    """The order of the tests: each program's quick tests together, then the slow ones one by one."""
    quick = collections.defaultdict(list)
    slow = []
    for test in sorted(tests, key=lambda test: test.seconds):
        if test.seconds < QUICK:
            quick[test.program].append(test)
        else:
            slow.append((test.program, [test]))
    return [*sorted(quick.items(), key=lambda item: sum(test.seconds for test in item[1])), *slow]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("crate", help="the crate's folder in crates/")
    parser.add_argument("--work", type=Path, required=True, help="folder for the copy and the results")
    parser.add_argument("--file", action="append", default=[], help="only files with this in their path")
    parser.add_argument("--minutes", type=float, default=600.0, help="stop after this; the next run resumes and repeats missed and timed-out mutants")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="mutants that run at the same time")
    arguments = parser.parse_args()
    root = Path(__file__).resolve().parent.parent
    copy, folder = arguments.work / "copy", arguments.work / "copy/crates" / arguments.crate
    arguments.work.mkdir(parents=True, exist_ok=True)
    if not copy.exists():
        subprocess.run(["git", "clone", "--quiet", root, copy], check=True)
    # Tests look for shared data beside the checkout.
    shared = arguments.work / "shared"
    if (root.parent / "shared").exists() and not shared.exists():
        shared.symlink_to(root.parent / "shared")
    subprocess.run(["git", "-C", copy, "fetch", "--quiet", root, "HEAD"], check=True)
    subprocess.run(["git", "-C", copy, "reset", "--quiet", "--hard", "FETCH_HEAD"], check=True)
    listing = ["cargo", "mutants", "--list", "--json", "-p", f"splatseg-{arguments.crate}"]
    mutants = json.loads(subprocess.check_output(listing, cwd=root))
    for number, mutant in enumerate(mutants, 1):
        mutant["id"] = number
    names_of_all = {mutant["name"] for mutant in mutants}
    if arguments.file:
        mutants = [mutant for mutant in mutants if any(part in mutant["file"] for part in arguments.file)]
    placed, unviable, programs = build(copy, arguments.crate, mutants)
    names = []
    for program in programs:
        listed = subprocess.check_output([program, "--list", "--format", "terse"], cwd=folder, text=True)
        names += [(program, line.removesuffix(": test")) for line in listed.splitlines() if line.endswith(": test")]
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        tests = list(pool.map(lambda of: measured(*of, folder, arguments.work), names))
    results_file = arguments.work / f"{arguments.crate}.json"
    results = json.loads(results_file.read_text()) if results_file.exists() else {}
    # Names contain line numbers, so mutants of another state of the sources are dropped.
    results = {name: outcome for name, outcome in results.items() if name in names_of_all}
    chosen = [mutant for mutant in mutants if results.get(mutant["name"], "missed") in ("missed", "timeout")]
    end = time.monotonic() + 60 * arguments.minutes

    def outcome_of(mutant: dict) -> str | None:
        number = mutant["id"]
        if time.monotonic() > end:
            return None
        if number not in placed:
            return "unviable" if number in unviable else "not placed"
        for program, group in in_turn([test for test in tests if number in test.reached]):
            limit = max(10.0, 5 * sum(test.seconds for test in group))
            found, _ = run(program, [test.name for test in group], folder, {"MUTANT": str(number)}, limit)
            if found != "passed":
                return found
        return "missed"

    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for mutant, outcome in zip(chosen, pool.map(outcome_of, chosen), strict=True):
            if outcome:
                results[mutant["name"]] = outcome
                results_file.write_text(json.dumps(results, indent=1))
    for name, outcome in results.items():
        if outcome in ("missed", "not placed"):
            print(f"{outcome}: {name}")
    print(dict(collections.Counter(results.values())))


if __name__ == "__main__":
    main()
