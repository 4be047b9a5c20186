# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

"""Check the language: openings of docstrings, unclear phrases, vague names, long sentences.

``python3 tests/plain_english.py PATH ...`` prints the faults of Python files and pages. With
``--pages`` it prints, for each page, the number of words and of words per sentence: mean, longest.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

LONGEST_SENTENCE = 35  # words
FSTRING_PART = getattr(tokenize, "FSTRING_MIDDLE", -1)  # since Python 3.12

# A function's docstring begins with a verb, and not with one of these words.
OPENINGS = (
    "What Whether Those That Which Who How Of Its Their The A An All Any As At By For From If In "
    "No None Not On One Only Other Same Such This These To Two Under When Where With Without "
    "True False Each Every Both Another Again Also Then There It"
)
VAGUE_NAMES = "found each known here what told asked rest more right left taken caused"
# Phrases that readers had to read twice, and the plain words for them.
PHRASES = {
    r"\b(?:are|is|be|were|was|been) (?:told|asked|said|heard)\b": "given, reported, evaluated",
    r"\b(?:tells|told|heard)\b": "gives, reports, states",
    r"\b(?:said|say) (?:of|so)\b": "reported, stated",
    r"\bwhat is (?:said|told|asked|done|left|given|known|taken)\b": "name it",
    r"\basked for\b": "requested, given",
    r"\b(?:solver|point|file|loop|law|rank|step|joint)s? (?:know|tell|ask|say)s?\b": "has",
    r"\bas is\b": "unchanged",
    r"\bso it is with\b": "likewise",
    r"\bin vain\b": "without success",
    r"\bgiv(?:es|e|en|ing) up\b": "stops, fails",
    r"\bgave up\b": "stopped, failed",
    r"\blet(?:s|ting)? through\b": "accepts, passes",
    r"\btak(?:e|es|en|ing) (?:off|back)\b": "subtracts, removes",
    r"\btaken for\b": "treated as, used as",
    r"\bdrown(?:s|ed)?\b": "exceeds",
    r"\bdear(?:er|est)?\b": "expensive",
    r"\bloose (?:block|bodie|body)s?\b": "unsupported block",
    r"\bfew shapes\b": "reduced basis",
    r"\balike\b": "in the same way, identical",
    r"\bof (?:one's|your|its|their) own\b": "separate, user-defined",
    r"\bways? out\b": "export, remedy",
    r"\bno trace\b": "not affect the result",
    r"\bno such\b": "no joint, no file",
    r"\bstands? (?:there|beside|in the way|on|for itself|in for)\b": "is next to, is in",
    r"\bgo(?:es)? (?:on|by|with)\b": "continues, uses, moves with",
    r"\bbesides?\b": "next to, in addition to, compared with",
    r"\bnought\b": "zero",
    r"\b(?:there|that|which) (?:is|are) none\b": "no joint, no file",
    r"\bnothing but\b": "only",
    r"\bnone but\b": "only",
    r"\bbut for\b": "except for",
    r"\bthe like\b": "and similar",
    r"\blikes of\b": "such as",
    r"\bwherefore|whence|thereof|therein|hitherto|heretofore|thereby\b": "plain words",
    r"\bas a rule\b": "usually",
    r"\bat (?:its|their) own\b": "separate",
    r"\b(?:by|for) (?:itself|themselves)\b": "separately, alone",
    r"\bheld\b(?!:)": "constrained, kept, stored",
    r"\bnothing holds\b": "unsupported",
    r"\b(?:hold|holds) (?:it|that|these|those)\b": "constrains, contains",
}
PATTERN = re.compile("|".join(f"(?P<p{i}>{p})" for i, p in enumerate(PHRASES)), re.IGNORECASE)
PLAIN = list(PHRASES.values())

Fault = tuple[int, str]


def phrases(text: str, line: int) -> Iterator[Fault]:
    """Yield the unclear phrases of a text that begins at ``line``, with the plain words."""
    for match in PATTERN.finditer(re.sub(r"`[^`\n]*`", lambda m: "x" * len(m[0]), text)):
        plain = PLAIN[int(match.lastgroup[1:])]
        yield line + text.count("\n", 0, match.start()), f"phrase {match[0]!r}: {plain}"


def _functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def _is_property(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any("property" in ast.unparse(decorator) for decorator in node.decorator_list)


def openings(tree: ast.AST) -> Iterator[Fault]:
    """Yield the functions whose docstring begins with one of ``OPENINGS``."""
    for node in _functions(tree):
        text = ast.get_docstring(node)
        if text and not _is_property(node) and text.split()[0].strip(",.:;") in OPENINGS.split():
            yield node.lineno, f"docstring of {node.name} begins with {text.split()[0]!r}"


def vague_names(tree: ast.AST) -> Iterator[Fault]:
    """Yield the vague names in public functions and in functions of more than 20 lines."""
    for node in _functions(tree):
        if node.name.startswith("_") and node.end_lineno - node.lineno < 20:
            continue
        names = {
            child.arg if isinstance(child, ast.arg) else child.id: child.lineno
            for child in ast.walk(node)
            if isinstance(child, ast.arg)
            or (isinstance(child, ast.Name) and isinstance(child.ctx, ast.Store))
        }
        for name in sorted(set(VAGUE_NAMES.split()) & names.keys()):
            yield names[name], f"name {name!r} in {node.name}"


def _texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield the first line and the text of each string and of each block of comment lines."""
    comment: list[str] = []
    start = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            if comment and token.start[0] == start + len(comment):
                comment.append(token.string)
                continue
            if comment:
                yield start, "\n".join(comment)
            comment, start = [token.string], token.start[0]
        # A string without a space is a value, not a text.
        elif " " in token.string and token.type in (tokenize.STRING, FSTRING_PART):
            yield token.start[0], token.string
    if comment:
        yield start, "\n".join(comment)


def paragraphs(page: str) -> Iterator[tuple[int, str]]:
    """Yield the first line and the text of each paragraph and list item of a Markdown page.

    Code, tables and headings are left out.
    """
    page = re.sub(r"\A---\n.*?\n---\n", lambda m: "\n" * m[0].count("\n"), page, flags=re.DOTALL)
    blanked = re.sub(
        r"^ *(```|~~~).*?^ *\1 *$|\$\$.*?\$\$|<!--.*?-->",
        lambda m: "\n" * m[0].count("\n") + " " * ("$$" in m[0]),
        page,
        flags=re.DOTALL | re.MULTILINE,
    )
    lines: list[str] = []
    start = 1
    for number, line in enumerate([*blanked.split("\n"), ""], 1):
        item = re.match(r"\s*(?:[-*+]|\d+\.)\s+", line)
        code = line.startswith("    ") and not lines and not item
        skipped = code or not line.strip() or line.lstrip().startswith(("|", "#", "<", ":::", "!["))
        if (item or skipped) and lines:
            yield start, "\n".join(lines)
            lines = []
        if not skipped:
            start = start if lines else number
            lines.append(line[item.end() :] if item else line)


def sentences(text: str) -> list[str]:
    """Return the sentences of a paragraph; code and formulas become one word."""
    text = re.sub(r"`+[^`]*`+|\$[^$]*\$", "Code", text)
    text = re.sub(r"!?\[([^\]]*)\](?:\([^)]*\)|\[[^\]]*\])?", r"\1", text)
    text = re.sub(r"\b(e\.g|i\.e|cf|eq|eqs|Fig|No|vs|approx)\.", r"\1", text)
    return [part for part in re.split(r"(?<=[.!?])[\"')*_]*\s+(?=[\"'(*_]*[A-Z0-9])", text) if part]


def words(sentence: str) -> int:
    """Return the number of words of a sentence."""
    return len(re.findall(r"[^\W\d_][\w'’-]*", sentence))


def faults(path: Path) -> list[Fault]:
    """Return the faults of a Python file or of a page, sorted by line."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        tree = ast.parse(source)
        result = [*openings(tree), *vague_names(tree)]
        for line, text in _texts(source):
            result += phrases(text, line)
    else:
        result = []
        for line, text in paragraphs(source):
            result += phrases(text, line)
            for sentence in sentences(text):
                if words(sentence) > LONGEST_SENTENCE:
                    result.append((line, f"{words(sentence)} words: {sentence[:60]!r} ..."))
    return sorted(result)


def files(roots: list[Path]) -> list[Path]:
    """Return the Python files and pages below the given paths."""
    return sorted(
        path
        for root in roots
        for path in ([root] if root.is_file() else root.rglob("*"))
        if path.suffix in (".py", ".md")
    )


def main() -> None:
    """Print the faults of the given files, or the lengths of the sentences of pages."""
    arguments = [argument for argument in sys.argv[1:] if argument != "--pages"]
    paths = files([Path(argument) for argument in arguments])
    if "--pages" in sys.argv:
        for path in paths:
            text = path.read_text(encoding="utf-8")
            counts = [words(s) for _, p in paragraphs(text) for s in sentences(p)]
            mean = sum(counts) / max(len(counts), 1)
            print(f"{path}: {sum(counts)} words, mean {mean:.1f}, longest {max(counts, default=0)}")
        return
    for path in paths:
        for line, fault in faults(path):
            print(f"{path}:{line}: {fault}")


if __name__ == "__main__":
    main()
