"""Writes docs/PYTHON_API.md from the docstrings and types of the Python package.

    python tools/make_python_reference.py

It reads the source, so the package need not be built. `python/tests/test_types.py` checks that the page is current.
"""

import ast
import itertools
import re
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "python/package/splatseg"
PAGE = ROOT / "docs/PYTHON_API.md"

SECTIONS = {
    "Run": ["run", "Run", "FastSamSplat", "Sam2Splat", "Pipeline"],
    "Results of a frame": ["StepResult", "Sightings", "ObjectSighting"],
    "Objects of a video": ["Objects", "Object", "Shape", "BestView", "FrameStamp", "FoundObject"],
    "Scenes": ["open_scene", "Scene", "Frame"],
    "Segmenters": ["Segmenter", "Affinity", "Graph", "FastSam"],
    "Predicted depth": ["depth", "Depth"],
    "Scene graph": ["load_scene_graph", "SceneGraph", "SceneObject", "SceneRoom", "LastSeen", "Relation"],
    "The map": ["Memory", "SavedMap", "Mesh", "merge", "read_state"],
    "Floor plan": ["FloorPlan", "PlanRoom", "Door", "Footprint", "ApproachPoint", "Route"],
    "Scores": ["evaluate", "Scores"],
    "SAM 2.1 alone": ["Sam2", "Tracks"],
    "Live": ["Live"],
    "Rerun": ["rerun.log", "rerun.log_map", "rerun.Logger"],
    "Colours": ["segment_color"],
}
"""The names of the package, in the order of the page. Names that are missing here come last."""

INTRODUCTION = """\
<!-- Written by tools/make_python_reference.py from the package's docstrings: change those. -->

# Python: reference

`import splatseg as ss`. [python/README.md](../python/README.md) has an introduction and examples.
"""

Definition = ast.ClassDef | ast.FunctionDef


def definitions() -> dict[str, Definition]:
    """The classes and functions of the package's modules by name; those of `rerun` with the module's."""
    found: dict[str, Definition] = {}
    for path in sorted(PACKAGE.glob("*.py*")):
        if path.suffix not in (".py", ".pyi"):
            continue
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, Definition):
                name = f"rerun.{node.name}" if path.stem == "rerun" else node.name
                # The compiled part has the same names, without documentation.
                if path.suffix == ".py" or name not in found:
                    found[name] = node
    return found


def public_names() -> list[str]:
    """What the package exports."""
    for node in ast.parse((PACKAGE / "__init__.py").read_text()).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return ast.literal_eval(node.value)
    raise ValueError("the package has no __all__")


def markdown(docstring: str) -> str:
    """A docstring as Markdown: roles and literals as code, indented blocks after `::` and doctests as code blocks."""
    # A role may have a title before its target: :func:`title <target>`.
    text = re.sub(r":(?:meth|func|class|attr):`([^`<]+?)(?:\s*<[^`>]+>)?`", r"`\1`", docstring).replace("``", "`")
    lines: list[str] = []
    for block in re.split(r"\n\n+", text):
        if not block:
            continue
        indented = all(line.startswith("    ") for line in block.splitlines())
        if indented or block.startswith(">>>"):
            # A block of several paragraphs is one block of code.
            if lines and lines[-1].endswith("\n```"):
                lines[-1] = lines[-1].removesuffix("\n```") + "\n\n" + textwrap.dedent(block) + "\n```"
            else:
                lines.append(f"```python\n{textwrap.dedent(block)}\n```")
        else:
            text = re.sub(r"::$", ":", " ".join(block.split()))
            lines.append(textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False))
    return "\n\n".join(line for line in lines if line != ":")


def signature(function: ast.FunctionDef, name: str) -> str:
    """The first line of a function as it is called."""
    arguments = ast.unparse(function.args)
    is_method = bool(function.args.args) and function.args.args[0].arg in ("self", "cls")
    arguments = re.sub(r"^(self|cls)(, )?", "", arguments) if is_method else arguments
    parts = [re.sub(r"^(\w+: [^=]+)=", r"\1 = ", part) for part in split_arguments(arguments)]
    returned = ast.unparse(function.returns) if function.returns is not None else "None"
    arrow = "" if name == "__init__" or returned == "None" else f" -> {returned}"
    one_line = f"({', '.join(parts)}){arrow}"
    if len(one_line) + len(name) <= 100:
        return one_line
    # One line for each argument.
    return "(\n    " + ",\n    ".join(parts) + f",\n){arrow}"


def split_arguments(arguments: str) -> list[str]:
    """Splits at commas that are in no bracket."""
    parts, depth = [""], 0
    for character in arguments:
        depth += (character in "([{") - (character in ")]}")
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]


def decorators(function: ast.FunctionDef) -> set[str]:
    """The names of a function's decorators."""
    return {ast.unparse(decorator) for decorator in function.decorator_list}


def attributes(owner: ast.ClassDef) -> list[tuple[str, str, str]]:
    """Fields and properties with a docstring: name, type, text."""
    found = []
    constructor = next((node for node in owner.body if getattr(node, "name", "") == "__init__"), None)
    for body in (owner.body, constructor.body if isinstance(constructor, ast.FunctionDef) else []):
        for node, after in itertools.pairwise(body):
            text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else None
            if isinstance(node, ast.AnnAssign) and isinstance(text, str):
                found.append((ast.unparse(node.target).removeprefix("self."), ast.unparse(node.annotation), text))
            elif isinstance(node, ast.Assign) and isinstance(text, str):
                found.append((ast.unparse(node.targets[0]).removeprefix("self."), "", text))
    for node in owner.body:
        if isinstance(node, ast.FunctionDef) and "property" in decorators(node) and not node.name.startswith("_"):
            returned = ast.unparse(node.returns) if node.returns is not None else ""
            found.append((node.name, returned, ast.get_docstring(node) or ""))
    return found


def methods(owner: ast.ClassDef, known: dict[str, Definition]) -> list[ast.FunctionDef]:
    """Public methods, and those of base classes that are not public."""
    own = [
        node
        for node in owner.body
        if isinstance(node, ast.FunctionDef)
        and (not node.name.startswith("_") or node.name in ("__call__", "__getitem__", "__len__"))
        and "property" not in decorators(node)
        and ast.get_docstring(node)
    ]
    for base in owner.bases:
        name = ast.unparse(base).partition("[")[0]
        if name.startswith("_") and isinstance(known.get(name), ast.ClassDef):
            own += methods(known[name], known)
    return own


def class_text(name: str, owner: ast.ClassDef, known: dict[str, Definition]) -> str:
    """A class with its constructor, attributes and methods."""
    bases = [ast.unparse(base) for base in owner.bases]
    shown = [base for base in bases if not base.startswith("_")]
    text = [f"### `ss.{name}`" + (f" ({', '.join(f'a `{base}`' for base in shown)})" if shown else "")]
    constructor = next((node for node in owner.body if getattr(node, "name", "") == "__init__"), None)
    # Results are not made by users: only what has a documented constructor, or takes settings, is shown with one.
    if isinstance(constructor, ast.FunctionDef) and name not in ("Memory",):
        text.append(f"```python\nss.{name}{signature(constructor, '__init__')}\n```")
    text.append(markdown(ast.get_docstring(owner) or ""))
    rows = [
        f"| `{attribute}` | `{kind.replace('|', chr(92) + '|')}` | {markdown(about).replace(chr(10), ' ')} |"
        for attribute, kind, about in attributes(owner)
    ]
    if rows:
        rows = [row.replace("| `` |", "| |") for row in rows]
        text.append("\n".join(["| attribute | type | |", "| --- | --- | --- |", *rows]))
    for method in methods(owner, known):
        text.append(f"**`{method.name}`**")
        prefix = f"{name}.{method.name}" if "classmethod" in decorators(method) else method.name
        text.append(f"```python\n{prefix}{signature(method, method.name)}\n```")
        text.append(markdown(ast.get_docstring(method) or ""))
    return "\n\n".join(part for part in text if part)


def function_text(name: str, function: ast.FunctionDef) -> str:
    """A function with its documentation."""
    text = [f"### `ss.{name}`", f"```python\nss.{name}{signature(function, name)}\n```"]
    return "\n\n".join([*text, markdown(ast.get_docstring(function) or "")]).rstrip()


def reference() -> str:
    """The whole page."""
    known, public = definitions(), set(public_names())
    listed = {name for names in SECTIONS.values() for name in names}
    rest = sorted(name for name in public if name in known and name not in listed)
    sections = {**SECTIONS, "More": rest} if rest else SECTIONS
    text = [INTRODUCTION.rstrip()]
    for section, names in sections.items():
        text.append(f"## {section}")
        for name in names:
            node = known[name]
            is_class = isinstance(node, ast.ClassDef)
            text.append(class_text(name, node, known) if is_class else function_text(name, node))
    return "\n\n".join(text) + "\n"


if __name__ == "__main__":
    PAGE.write_text(reference())
