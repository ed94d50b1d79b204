"""Find what docs/style.md rejects, in the texts of this tree: `python tools/check_words.py`."""

from __future__ import annotations

import ast
import inspect
import io
import re
import sys
import tokenize
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
LONGEST = 25  # words in a sentence

REJECTED = re.compile(
    r"\b(?:whoever|whomever|nobody|none such|that which|whence"
    r"|(?:is|are|was) no(?! longer| more| less| later| earlier)\b)",
    re.IGNORECASE,
)
# Test names have subjects that are things, and verbs of what software does.
REJECTED_IN_NAMES = re.compile(
    r"\b(?:who|whose|whoever|what|whatever|nobody|somebody|everybody|is no"
    r"|tells?|told|says?|said|knows?)\b"
)
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "docs/*.md", "docs/howto/*.md")
PYTHON = ("src/**/*.py",)
TESTS = ("tests/**/*.py",)
CPP = ("core/**/*.?pp", "bindings/**/*.?pp")
SHORT = re.compile(r"README\.md|docs/howto/.*")  # the documents whose sentences are counted

SENTENCE_END = re.compile(r"(?<=[.!?])\*{0,2}\s+")
CODE_BLOCK = re.compile(r"^```.*?^```$|^<!--.*?-->$|^(?: {4}|\t).*?$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"(`+).+?\1", re.DOTALL)
NAMES = re.compile(r"CODE(?:[\[\],;: ]+(?:and |or )?CODE)+")  # a list of names counts as one word
LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
CPP_TEXT = re.compile(
    r'(?P<comment>(?:^[^\S\n]*//[^\n]*\n)+|//[^\n]*)|"(?P<string>(?:[^"\\\n]|\\.)*)"', re.MULTILINE
)


@dataclass(frozen=True)
class Text:
    """A piece of prose and its place."""

    place: str
    text: str
    short: bool = False  # its sentences are counted
    rejected: re.Pattern[str] = REJECTED


def findings(text: Text) -> Iterator[str]:
    """Describe each rejected word and each long sentence."""
    prose = " ".join(CODE.sub("CODE", text.text).split())
    for found in text.rejected.finditer(prose):
        around = prose[max(0, found.start() - 40) : found.end() + 40]
        yield f"{text.place}: {found[0]!r} in {around!r}"
    for sentence in SENTENCE_END.split(NAMES.sub("CODE", prose)) if text.short else ():
        if len(sentence.split()) > LONGEST:
            yield f"{text.place}: {len(sentence.split())} words in {sentence!r}"


def of_markdown(path: str, markdown: str) -> Iterator[Text]:
    """Yield paragraphs, list items and table cells; code is left out."""
    prose = CODE_BLOCK.sub(lambda block: "\n" * block[0].count("\n"), markdown)
    prose = LINK.sub(r"\1", prose)
    begin = 1
    for part in re.split(r"(\n(?:\s*\n)+|\n(?=\s*(?:[-*|#]|\d+\.)))", prose):
        for cell in part.strip("|\n").split(" | ") if part.lstrip().startswith("|") else [part]:
            if cell.strip():
                yield Text(f"{path}:{begin}", cell, short=bool(SHORT.fullmatch(path)))
        begin += part.count("\n")


def of_tests(path: str, source: str) -> Iterator[Text]:
    """Yield docstrings, comments and the names of tests; other strings are data."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name[:5] == "test_":
            words = node.name.replace("_", " ")
            yield Text(f"{path}:{node.lineno}", words, rejected=REJECTED_IN_NAMES)
    yield from of_python(path, source, strings=False)


def of_python(path: str, source: str, *, strings: bool = True) -> Iterator[Text]:
    """Yield docstrings, comments and other strings; the first lines of docstrings are short."""
    docstrings = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstring = ast.get_docstring(node)
            if docstring is not None:
                first, _, rest = docstring.partition("\n\n")
                line = node.body[0].lineno
                docstrings.add(line)
                yield Text(f"{path}:{line}", first, short=True)
                yield Text(f"{path}:{line}", rest)
        elif (
            strings
            and isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and node.lineno not in docstrings
        ):
            yield Text(f"{path}:{node.lineno}", node.value)
    comment, begin, end = "", 0, 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            if token.start[0] != end + 1:
                if comment:
                    yield Text(f"{path}:{begin}", comment)
                comment, begin = "", token.start[0]
            comment, end = f"{comment} {token.string.lstrip('# ')}", token.start[0]
    if comment:
        yield Text(f"{path}:{begin}", comment)


def of_cpp(path: str, source: str) -> Iterator[Text]:
    """Yield comments and strings; adjacent strings are one."""
    joined = re.sub(r'"\s*\n\s*"', "", source)
    for found in CPP_TEXT.finditer(joined):
        text = found["string"] if found["comment"] is None else found["comment"].replace("//", " ")
        yield Text(f"{path}:{joined.count(chr(10), 0, found.start()) + 1}", text)


def of_help() -> Iterator[Text]:
    """Yield the help of each command and option of `tfdb`."""
    from tfdb.cli.app import COMMANDS, cli  # noqa: PLC0415 - other texts are checked without it

    def walk(name: str, command: click.Command) -> Iterator[Text]:
        for paragraph in inspect.cleandoc(command.help or "").split("\n\n"):
            # click keeps the lines of a paragraph that begins with this character.
            for piece in paragraph.split("\n") if paragraph[:1] == "\b" else [paragraph]:
                yield Text(f"{name} --help", piece, short=True)
        for param in command.params:
            if isinstance(param, click.Option) and param.help:
                yield Text(f"{name} {param.opts[-1]}", param.help, short=True)
        if isinstance(command, click.Group):
            for part in command.list_commands(context):
                below = command.get_command(context, part)
                if below is not None:
                    yield from walk(f"{name} {part}", below)

    context = click.Context(cli)
    for name, line in COMMANDS.items():
        yield Text(f"tfdb {name}", line, short=True)
    yield from walk("tfdb", cli)


def texts(root: Path) -> Iterator[Text]:
    """Yield all that is checked."""
    kinds = (DOCUMENTS, of_markdown), (PYTHON, of_python), (TESTS, of_tests), (CPP, of_cpp)
    for patterns, read in kinds:
        for path in sorted({path for each in patterns for path in root.glob(each)}):
            yield from read(str(path.relative_to(root)), path.read_text(encoding="utf-8"))
    yield from of_help()


def main() -> int:
    """Print what is rejected; 1 if there was anything."""
    found = [line for text in texts(ROOT) for line in findings(text)]
    print(*found, sep="\n", end="\n" if found else "")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
