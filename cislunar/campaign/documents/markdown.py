"""Tables in Markdown, and parts of a document that are made from tables."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

from cislunar.errors import InputFileError

_BEGIN, _END = "<!-- begin generated: {} -->\n", "<!-- end generated -->\n"
DASH = "\N{EN DASH}"
"""Where a table has nothing to say."""

_NAME = re.compile(r"^<!-- begin generated: ([\w-]+) -->$", flags=re.MULTILINE)


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
    """A block of a document that `fill_blocks` makes anew."""
    return _BEGIN.format(name) + _padded(body) + _END


def _padded(body: str) -> str:
    stripped = body.strip("\n")
    return f"\n{stripped}\n\n"


def generated_blocks(text: str) -> list[str]:
    """Names of the generated blocks of a document, in order."""
    return _NAME.findall(text)


def fill_blocks(text: str, blocks: Mapping[str, Callable[[], str]], document: str) -> str:
    """Make the generated blocks of a document anew.

    A block stands between the lines ``<!-- begin generated: name -->`` and
    ``<!-- end generated -->``. An `InputFileError` if one has an unknown name or no end.
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
        text = replace_between(text, _BEGIN.format(name), _END, _padded(blocks[name]()), document)
    return text
