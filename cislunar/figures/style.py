"""Look of every figure: type, colors, line styles and markers, and how a figure is saved.

Colors are those of Okabe and Ito, told apart by color-blind readers. What a color says is said
again by a line style or a marker, so that the figures survive a print in gray.
"""

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from cislunar.campaign.data.netcdf import whole_file
from cislunar.campaign.data.progress import progress_log
from cislunar.errors import ConfigurationError

ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
YELLOW = "#F0E442"
BLACK = "#000000"
GRAY = "#8A8A8A"

EARTH_COLOR = BLUE
MOON_COLOR = BLACK

PAGE_WIDTH_IN = 7.2
"""Width of a figure across both columns of a journal page, inches."""

RASTER_DPI = 300
"""Resolution of the PNG, and of dense layers within the PDF, dots per inch."""

_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "mathtext.fontset": "dejavusans",
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.4,
    "lines.linewidth": 1.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "pdf.fonttype": 42,
    "pdf.compression": 6,
    "savefig.dpi": RASTER_DPI,
    "figure.dpi": 100,
}


_MARKER_SCALE = {"*": 1.6, "P": 1.2, "X": 1.2, "^": 1.1, "h": 1.15, "D": 0.9}
"""Markers of equal size differ in area; this evens them out."""


class SeriesStyle(NamedTuple):
    """How one family or optimizer is drawn."""

    label: str
    color: str
    line: str | tuple
    marker: str
    filled: bool = True

    def marker_kwargs(self, size: float = 4.0) -> dict:
        """Keywords of its markers for ``plot``."""
        return {
            "marker": self.marker,
            "markersize": size * _MARKER_SCALE.get(self.marker, 1.0),
            "markerfacecolor": self.color if self.filled else "none",
            "markeredgecolor": "black" if self.filled else self.color,
            "markeredgewidth": 0.3 if self.filled else 0.8,
        }

    def legend_handle(self, label: str | None = None, *, line: bool = True) -> Line2D:
        """Its entry in a legend."""
        return Line2D(
            [],
            [],
            color=self.color,
            linestyle=self.line if line else "none",
            label=self.label if label is None else label,
            **self.marker_kwargs(),
        )


SOLID = "-"
DASHED = (0, (4.0, 1.6))
DASH_DOT = (0, (6.0, 1.5, 1.2, 1.5))
DOTTED = (0, (1.2, 1.2))

_ROOTS = {
    "Butterfly": ("Butterfly", PURPLE, "D"),
    "Dragonfly": ("Dragonfly", SKY, "P"),
    "Halo_L1": ("L1 halo", ORANGE, "o"),
    "Halo_L2": ("L2 halo", GREEN, "s"),
    "Halo_L3": ("L3 halo", VERMILION, "^"),
}
_PLANAR = {
    "Lyap_L1": ("L1 Lyapunov", ORANGE, "*"),
    "Lyap_L2": ("L2 Lyapunov", GREEN, "h"),
    "Lyap_L3": ("L3 Lyapunov", VERMILION, "X"),
}


def _tone(color: str, light: float) -> str:
    """The same hue, darker towards -1 and lighter towards 1."""
    return to_hex([(1.0 - abs(light)) * share + max(light, 0.0) for share in to_rgb(color)])


def _family_styles() -> dict[str, SeriesStyle]:
    styles = {}
    for root, (label, color, marker) in _ROOTS.items():
        styles[f"{root}_N"] = SeriesStyle(f"{label} N", color, SOLID, marker)
        dark = _tone(color, -0.5)
        styles[f"{root}_S"] = SeriesStyle(f"{label} S", dark, DASHED, marker, filled=False)
    for name, (label, color, marker) in _PLANAR.items():
        styles[name] = SeriesStyle(label, _tone(color, 0.4), DASH_DOT, marker)
    return styles


FAMILY_STYLE: Mapping[str, SeriesStyle] = _family_styles()
"""Hue by libration point, tone and line style by kind (north, south, planar), marker by branch."""

OPTIMIZER_STYLE: Mapping[str, SeriesStyle] = {
    "tpe": SeriesStyle("TPE", BLUE, SOLID, "o"),
    "random": SeriesStyle("random search", VERMILION, DASHED, "s"),
    "atpe": SeriesStyle("adaptive TPE", SKY, DASH_DOT, "P"),
    "exact": SeriesStyle("exact search", GREEN, DASH_DOT, "*"),
    "published": SeriesStyle("paper's families, our members", PURPLE, DOTTED, "D"),
}
"""How each optimizer is drawn."""

ESTIMATOR_STYLE: Mapping[str, SeriesStyle] = {
    "mukf": SeriesStyle("MUKF", VERMILION, DASHED, "s", filled=False),
    "batch": SeriesStyle("batch", BLUE, SOLID, "o"),
}
"""How each estimator is drawn."""


def family_style(family: str) -> SeriesStyle:
    """How a family is drawn; a `ConfigurationError` if it has no style."""
    try:
        return FAMILY_STYLE[family]
    except KeyError:
        raise ConfigurationError(
            f"orbit family {family!r} has no style: add it to FAMILY_STYLE; the families with one "
            f"are {', '.join(FAMILY_STYLE)}"
        ) from None


def style_or_gray(styles: Mapping[str, SeriesStyle], name: str) -> SeriesStyle:
    """How a series is drawn; one without a style of its own is gray."""
    return styles.get(name, SeriesStyle(name, GRAY, SOLID, "v"))


def optimizer_style(optimizer: str) -> SeriesStyle:
    """How an optimizer is drawn."""
    return style_or_gray(OPTIMIZER_STYLE, optimizer)


def estimator_style(estimator: str) -> SeriesStyle:
    """How an estimator is drawn."""
    return style_or_gray(ESTIMATOR_STYLE, estimator)


@contextmanager
def house_style() -> Iterator[None]:
    """The rc parameters of every figure, for the time of its making and saving."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def new_figure(height_in: float, width_in: float = PAGE_WIDTH_IN) -> Figure:
    """An empty figure outside pyplot's registry, its size in inches."""
    figure = Figure(figsize=(width_in, height_in), facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def panel_letter(index: int) -> str:
    """(a), (b), ... (z), (aa), ... for a panel's title."""
    letters = ""
    index += 1
    while index > 0:
        index, rest = divmod(index - 1, 26)
        letters = chr(ord("a") + rest) + letters
    return f"({letters})"


def save_figure(figure: Figure, path_png: str | Path, path_pdf: str | Path) -> None:
    """Write a figure as PNG and PDF, each whole or not at all; creates their folders.

    The same figure gives the same bytes: no dates and no versions are stored. The PNG has at most
    256 colors, which makes it a third as large.
    """
    plain = {"Creator": None, "Producer": None, "CreationDate": None}
    files = ((path_png, "png", {"Software": None}), (path_pdf, "pdf", plain))
    progress = progress_log("files of the figure")
    for done, (path, kind, metadata) in enumerate(files, start=1):
        drawn = io.BytesIO()
        with house_style():
            figure.savefig(drawn, format=kind, dpi=RASTER_DPI, metadata=metadata)
        if kind == "png":
            drawn = _with_palette(drawn)
        with whole_file(Path(path)) as temporary:
            temporary.write_bytes(drawn.getvalue())
        progress(done, len(files))


def _with_palette(drawn: io.BytesIO) -> io.BytesIO:
    """A PNG with its colors in a palette; no dots that would feign further ones."""
    smaller = io.BytesIO()
    colors = Image.open(drawn).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    colors.save(smaller, "PNG", optimize=True, dpi=(RASTER_DPI, RASTER_DPI))
    return smaller
