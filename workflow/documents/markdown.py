"""Tables in Markdown, texts from templates, and parts of a document that are generated."""

import posixpath
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from cislunar.errors import InputFileError

_BEGIN, _END = "<!-- begin generated: {} -->\n", "<!-- end generated -->\n"
DASH = "\N{EN DASH}"
"""What a cell of a table without a value holds."""

_NAME = re.compile(r"^<!-- begin generated: ([\w-]+) -->$", flags=re.MULTILINE)
_BLOCK = re.compile(rf"{_NAME.pattern}\n.*?^{_END}", flags=re.MULTILINE | re.DOTALL)
_FROM_ROOT = re.compile(r"\]\(/([^)\s]+)\)")

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def render(template: str, **values: object) -> str:
    """The text of ``templates/TEMPLATE`` with its values; a missing value is an error."""
    return _TEMPLATES.get_template(template).render(values)


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown; bars within cells are escaped."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(map(_cell, line))} |\n" for line in lines)


def _cell(value: object) -> str:
    return str(value).replace("|", "\\|").replace("\n", " ")


def replace_between(text: str, begin: str, end: str, body: str, document: str) -> str:
    """Put a text between two marks, whole lines; an `InputFileError` if `document` lacks one."""
    before, opened, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not (opened and closed):
        raise InputFileError(f"{document} lacks the line {(end if opened else begin).strip()!r}")
    return before + begin + body + end + after


def generated_block(name: str, body: str) -> str:
    """A block of a document that `fill_blocks` generates."""
    stripped = body.strip("\n")
    return f"{_BEGIN.format(name)}\n{stripped}\n\n{_END}"


def generated_blocks(text: str) -> list[str]:
    """Names of the generated blocks of a document, in order."""
    return _NAME.findall(text)


def fill_blocks(text: str, blocks: Mapping[str, Callable[[], str | None]], document: str) -> str:
    """Generate the blocks of a document again, except for those whose text is None.

    A block stands between the lines ``<!-- begin generated: name -->`` and
    ``<!-- end generated -->``, in any document and any number of times. Links of a block that begin
    with ``/``, the folder of the repository, become relative to `document`, the path of the
    document from there. An `InputFileError` if a block has an unknown name or no end.
    """
    names = generated_blocks(text)
    if not text.count(_BEGIN.partition("{")[0]) == len(names) == text.count(_END):
        raise InputFileError(
            f"{document}: a generated block lacks its line {_END.strip()!r} or is ill named"
        )
    for name in names:
        if name not in blocks:
            raise InputFileError(
                f"{document}: no such generated block: {name!r}; there are {', '.join(blocks)}"
            )
    folder = posixpath.dirname(document) or "."

    def filled(block: re.Match[str]) -> str:
        body = blocks[block[1]]()
        if body is None:
            return block[0]
        return generated_block(
            block[1], _FROM_ROOT.sub(lambda link: f"]({posixpath.relpath(link[1], folder)})", body)
        )

    return _BLOCK.sub(filled, text)
