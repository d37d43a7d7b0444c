"""Files of messages in tests: written, spoiled, and refused in one line."""

import re

import pytest

from cislunar.errors import InputFileError


def file_of(folder, text, name="arc.oem"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def table(folder, *rows):
    return file_of(folder, "\n".join(rows) + "\n", "own.csv")


def spoil(text, old, new):
    assert re.search(old, text)
    return re.sub(old, new, text, count=1)


def refused(read, path, message):
    with pytest.raises(InputFileError, match=message) as caught:
        read(path)
    assert str(caught.value).startswith(str(path))
    assert len(str(caught.value).splitlines()) == 1
