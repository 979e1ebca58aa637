"""Plain words: phrases, first lines and lengths that docstrings, messages and pages must not have, and names.

`python -m tests.support.words PATH...` lists the violations below each path as `file:line: message`.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
PACKAGES = ("catalogs", "insitu", "native", "render", "surrogate")  # whose names are checked, too
WORDS, WIDTH = 30, 120  # of a sentence, of a line of Markdown
SCRIPTS = (".js", ".html", ".cpp", ".hpp", ".h", ".c", ".f90")
# "There is no file", "is no longer", "are no more than" and "is no larger than" are good English.
PHRASES = re.compile(
    r"(?<!\bthere )(?<!\bThere )\b(?:is|are) no (?!longer\b|more\b|less\b|fewer\b|better\b|worse\b|\w+er than\b)\w+"
    r"|\btold\b|\bthe like\b|\ban only\b|\bso many\b",
    re.IGNORECASE,
)
STARTS = re.compile(r"(?:What|Whether|Where|How)\b")
SENTENCE_END = re.compile(r"(?<=[.!?])[)\"'`*]*\s+(?=[\"'`(*\[]*[A-Z0-9`¹²³⁴])")
LITERALS = re.compile(r"//.*|/\*.*?\*/|\"[^\"\n]*\"|'[^'\n]*'|`[^`]*`|<!--.*?-->|>[^<>]+<", re.DOTALL)
ITEM = re.compile(r"[-*] |\d+\. |[\w`*., ]{1,60} : ")
SKIPPED = re.compile(r"```|\||#|>>>|\.\.\. |---|[$>] |!\[.*\)$")
# Alone, these say what was done to a thing instead of what it is; "known" before a noun (`known_names`) is fine.
PARTICIPLES = re.compile("_*(?:found|held|given|told|kept|known|asked|drawn|taken|made|shown|seen|stored)_*")
METHODS, FIELDS = {"drawn", "stored"}, {"asked", "kept", "made"}  # of protocols; keys of records on disk
LISTED = re.compile(r"(?:[\w.`*-]+, ){3,}[\w.`*-]+")  # single names between commas count as one word
Found = tuple[int, str]  # line, message


def phrases(text: str, line: int) -> Iterator[Found]:
    """The refused phrases of a text that begins at a line."""
    for match in PHRASES.finditer(re.sub(r"\s", " ", text)):
        yield line + text.count("\n", 0, match.start()), f"phrase `{match[0]}`"


def paragraphs(text: str, line: int) -> Iterator[Found]:
    """Prose by paragraphs and list items, each with its first line's number, without code, tables and headings."""
    gathered: list[str] = []
    first, indent, item, code, comment = line, 0, False, False, False
    for number, row in enumerate([*text.split("\n"), ""], start=line):
        bare, depth = row.strip(), len(row) - len(row.lstrip())
        comment = comment or bare.startswith(("<!--", "<sub>"))
        skipped = code or comment or not bare or SKIPPED.match(bare) is not None
        code ^= bare.startswith("```")
        comment = comment and not bare.endswith(("-->", "</sub>"))
        begins = ITEM.match(bare) is not None
        if gathered and (skipped or begins or (depth > indent and not item) or depth < indent):
            yield first, " ".join(gathered)
            gathered = []
        if not skipped and (gathered or begins or depth <= indent):
            first, item = (first, item) if gathered else (number, begins)
            indent = indent if gathered else depth
            gathered.append(bare)


def sentences(text: str, line: int) -> Iterator[Found]:
    """The sentences that are too long."""
    for first, paragraph in paragraphs(text, line):
        plain = LISTED.sub("names", re.sub(r"\]\([^)]*\)", "]", paragraph))
        for sentence in SENTENCE_END.split(plain):
            words = [word for word in sentence.split() if re.search(r"\w", word)]
            if len(words) > WORDS:
                yield first, f"sentence of {len(words)} words: {' '.join(words[:8])} ..."


@lru_cache(maxsize=1)
def nodes_of(source: str) -> tuple[ast.AST, ...]:
    """All nodes of a Python file."""
    return tuple(ast.walk(ast.parse(source)))


def statements(source: str) -> Iterator[ast.AST]:
    """A Python file's module and its statements, which are few among its nodes."""
    rest: list[ast.AST] = [ast.parse(source)]
    while rest:
        node = rest.pop()
        yield node
        rest += [part for part in ast.iter_child_nodes(node) if isinstance(part, ast.stmt | ast.excepthandler)]


def in_python(source: str, docstrings_only: bool) -> Iterator[Found]:
    """Violations in a Python file's docstrings and, unless these alone are asked for, its comments and messages."""
    holders = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {}
    for node in statements(source) if docstrings_only else nodes_of(source):
        if isinstance(node, holders) and (text := ast.get_docstring(node, clean=False)) is not None:
            line = node.body[0].lineno
            docstrings[line] = text
            if STARTS.match(text.lstrip()):
                yield line, f"first line begins with `{text.split()[0]}`"
            yield from phrases(text, line)
            yield from sentences(ast.get_docstring(node) or "", line)
    if docstrings_only:
        return
    constants = [(node.lineno, node.value) for node in nodes_of(source) if isinstance(node, ast.Constant)]
    for line, value in constants:
        if isinstance(value, str) and " " in value.strip() and docstrings.get(line) != value:
            yield from ((line, message) for _, message in phrases(value, 0))
    if not PHRASES.search(re.sub(r"\s", " ", source)):
        return
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield from phrases(token.string, token.start[0])


def participles(source: str) -> Iterator[Found]:
    """Variables, parameters, attributes and functions whose name is a participle alone."""
    bodies = [node.body for node in nodes_of(source) if isinstance(node, ast.ClassDef)]
    members = [part for body in bodies for part in body]
    allowed = {id(part) for part in members if isinstance(part, ast.FunctionDef) and part.name in METHODS}
    allowed |= {id(p.target) for p in members if isinstance(p, ast.AnnAssign) and getattr(p.target, "id", "") in FIELDS}
    for node in nodes_of(source):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            name = node.name
        elif isinstance(node, ast.arg):
            name = node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            name = node.attr
        else:
            continue
        if PARTICIPLES.fullmatch(name) and id(node) not in allowed:
            yield node.lineno, f"name `{name}`: say what the thing is"


def in_markdown(text: str) -> Iterator[Found]:
    """Violations in a page: phrases, long sentences and long lines; code, tables, comments and lone links are exempt."""
    for first, paragraph in paragraphs(text, 1):
        yield from ((first, message) for _, message in phrases(re.sub(r"`[^`]*`", "`code`", paragraph), first))
    yield from sentences(text, 1)
    code = False
    for number, row in enumerate(text.split("\n"), start=1):
        code ^= row.startswith("```")
        lone = re.fullmatch(r"\s*(?:[-*] )?!?\[[^\]]*\]\([^)]*\)[.,]?", row)
        if len(row) > WIDTH and not (code or lone or row.startswith(("|", "<!--", "<sub>", "#", "    "))):
            yield number, f"line of {len(row)} characters"


def violations(path: Path) -> list[Found]:
    """All violations of a file, by line."""
    text = path.read_text()
    if path.suffix == ".py":
        place = path.resolve()
        found = list(in_python(text, docstrings_only=place.is_relative_to(PROJECT / "tests")))
        if any(place.is_relative_to(PROJECT / package) for package in PACKAGES):
            found += participles(text)
    elif path.suffix == ".md":
        found = in_markdown(text)
    else:
        found = (
            each
            for match in LITERALS.finditer(text)
            for each in phrases(match[0], text.count("\n", 0, match.start()) + 1)
        )
    return sorted(set(found))


def checked(path: Path) -> Iterator[Path]:
    """The files below a path that are checked."""
    for file in [path] if path.is_file() else sorted(path.rglob("*")):
        if file.suffix in (".py", ".md", *SCRIPTS):
            yield file


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        for file in checked(Path(argument)):
            for line, message in violations(file):
                print(f"{file}:{line}: {message}")
