"""Tables in Markdown, and blocks of a document that are made from tables."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

from cislunar.errors import InputFileError

_BLOCK = re.compile(
    r"^<!-- begin generated: (?P<name>[\w-]+) -->\n(?P<body>.*?)^<!-- end generated -->$",
    flags=re.MULTILINE | re.DOTALL,
)
_BEGIN = "<!-- begin generated:"


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    rows : iterable of sequence
        Cells, as many as columns in every row.

    Returns
    -------
    str
        Ends with a newline. Bars within cells are escaped.
    """
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(map(_cell, line))} |\n" for line in lines)


def _cell(value: object) -> str:
    return str(value).replace("|", "\\|").replace("\n", " ")


def generated_blocks(text: str) -> list[str]:
    """Names of the generated blocks of a document, in order.

    Parameters
    ----------
    text : str
        The document.

    Returns
    -------
    list of str
    """
    return [match["name"] for match in _BLOCK.finditer(text)]


def fill_blocks(text: str, blocks: Mapping[str, Callable[[], str]], document: str) -> str:
    """Make the generated blocks of a document anew.

    A block stands between the lines ``<!-- begin generated: name -->`` and
    ``<!-- end generated -->``; what is between them is replaced.

    Parameters
    ----------
    text : str
        The document.
    blocks : mapping of str to callable
        What makes each block, by its name.
    document : str
        Name of the document, for messages.

    Returns
    -------
    str

    Raises
    ------
    InputFileError
        If a block has an unknown name or no end.
    """
    if text.count(_BEGIN) != len(generated_blocks(text)):
        raise InputFileError(
            f"{document}: a generated block lacks its line '<!-- end generated -->' or is ill named"
        )

    def filled(match: re.Match) -> str:
        name = match["name"]
        if name not in blocks:
            raise InputFileError(
                f"{document}: no such generated block: {name!r}; there are {', '.join(blocks)}"
            )
        body = blocks[name]().strip("\n")
        return f"{_BEGIN} {name} -->\n\n{body}\n\n<!-- end generated -->"

    return _BLOCK.sub(filled, text)
