"""Reference of every public function, class and constant, from the docstrings, as HTML.

::

    python -m cislunar.campaign.documents.reference

writes it to ``docs/api``; ``--output FOLDER`` writes it elsewhere. Open ``index.html`` there; the
pages can be searched and need no network.
"""

import argparse
import inspect
import re
import shutil
import sys
import warnings
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, ForwardRef

from numpy.typing import ArrayLike

PACKAGE = "cislunar"

_NDARRAY = re.compile(
    r"numpy\.ndarray\[tuple\[typing\.Any, \.\.\.\], numpy\.dtype\[(?:numpy\.)?(~?\w+)\]\]"
)


class _Named:
    """An annotation that is shown as the text given."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return self._text


def short_annotation(annotation: Any) -> Any:
    """An annotation under the name it is written with, arrays as ``ArrayLike`` and ``NDArray``."""
    if annotation is inspect.Parameter.empty:
        return annotation
    if isinstance(annotation, ForwardRef):
        return _Named(annotation.__forward_arg__)
    text = inspect.formatannotation(annotation)
    array_like = inspect.formatannotation(ArrayLike)
    text = text.replace(f"{array_like[:-1]}, NoneType]", "ArrayLike | None")
    text = text.replace(array_like, "ArrayLike")
    return _Named(_NDARRAY.sub(r"NDArray[\1]", text))


def _short(signature: inspect.Signature) -> inspect.Signature:
    return signature.replace(
        parameters=[
            each.replace(annotation=short_annotation(each.annotation))
            for each in signature.parameters.values()
        ],
        return_annotation=short_annotation(signature.return_annotation),
    )


def write_reference(folder: str | Path) -> None:
    """Write the reference in place of an older one; needs pdoc, see ``environment.txt``."""
    import pdoc

    folder = Path(folder)
    shutil.rmtree(folder / PACKAGE, ignore_errors=True)
    pdoc.render.configure(docformat="numpy", show_source=False)
    show = pdoc.render_helpers.format_signature
    package = import_module(PACKAGE)
    names = package.__all__
    pdoc.render.env.filters["format_signature"] = lambda signature, colon: show(
        _short(signature), colon
    )
    with warnings.catch_warnings():
        # Classes of settings that are made at import have no source that tells of their fields.
        warnings.filterwarnings(
            "ignore", rf"Cannot determine where {PACKAGE}\.campaign\.settings\."
        )
        # Nor has what makes a named tuple a module in which its annotations have a meaning.
        warnings.filterwarnings("ignore", rf"Error parsing type annotation ForwardRef.*{PACKAGE}")
        # Of a package with `__all__` pdoc shows nothing else: the rooms have to be among them.
        package.__all__ = [*names, *(each.name for each in iter_modules(package.__path__))]
        try:
            pdoc.pdoc(PACKAGE, output_directory=folder)
        finally:
            package.__all__ = names


def main(arguments: list[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m cislunar.campaign.documents.reference",
        description="Write the reference of the library as HTML.",
    )
    parser.add_argument("--output", default="docs/api", help="folder (default: docs/api)")
    chosen = parser.parse_args(arguments)
    write_reference(chosen.output)
    print(Path(chosen.output) / "index.html")
    return 0


if __name__ == "__main__":
    sys.exit(main())
