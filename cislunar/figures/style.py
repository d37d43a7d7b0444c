"""Style of every figure: type, colors, line styles and markers; and how a figure is saved.

The colors are those of Okabe and Ito, which color-blind readers can distinguish. Line styles and
markers repeat what colors say, so that figures can be printed in gray.
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

from cislunar.errors import ConfigurationError
from cislunar.figures import labels
from cislunar.runtime import each, whole_file

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
"""Factors that give markers about the same area."""


class SeriesStyle(NamedTuple):
    """Label, color, line and marker of a series."""

    label: str
    color: str
    line: str | tuple
    marker: str
    filled: bool = True

    def marker_kwargs(self, size: float = 4.0) -> dict:
        """Keywords of the markers for ``plot``."""
        return {
            "marker": self.marker,
            "markersize": size * _MARKER_SCALE.get(self.marker, 1.0),
            "markerfacecolor": self.color if self.filled else "none",
            "markeredgecolor": "black" if self.filled else self.color,
            "markeredgewidth": 0.3 if self.filled else 0.8,
        }

    def point_kwargs(self, size: float = 4.0) -> dict:
        """Keywords of markers without a line for ``plot``."""
        return {"linestyle": "none", "color": self.color} | self.marker_kwargs(size)

    def line_kwargs(self) -> dict:
        """Keywords of the line for ``plot``."""
        return {"color": self.color, "linestyle": self.line}

    def legend_handle(self, label: str | None = None, *, line: bool = True) -> Line2D:
        """Entry of the series in a legend."""
        drawn = self.line_kwargs() if line else self.point_kwargs()
        label = self.label if label is None else label
        return Line2D([], [], label=label, **drawn | self.marker_kwargs())


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
    """A tone of the same hue: darker towards -1, lighter towards 1."""
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
    name: SeriesStyle(labels.ARCHITECTURES[name], *drawn)
    for name, drawn in {
        "tpe": (BLUE, SOLID, "o"),
        "random": (VERMILION, DASHED, "s"),
        "atpe": (SKY, DASH_DOT, "P"),
        "exact": (GREEN, DASH_DOT, "*"),
        "published": (PURPLE, DOTTED, "D"),
        "J": (GREEN, SOLID, "X"),
        "coverage": (ORANGE, DASHED, "^"),
        "information": (SKY, DASH_DOT, "v"),
        "stable": (SKY, DOTTED, "v", False),
        "attitude": (BLACK, DOTTED, "P"),
    }.items()
}
"""Styles of architectures, by optimizer or by design without its number of satellites."""

ESTIMATOR_STYLE: Mapping[str, SeriesStyle] = {
    "mukf": SeriesStyle(labels.ESTIMATORS["mukf"], VERMILION, DASHED, "s", filled=False),
    "batch": SeriesStyle(labels.ESTIMATORS["batch"], BLUE, SOLID, "o"),
}
"""Styles of the estimators."""


def family_style(family: str) -> SeriesStyle:
    """Style of an orbit family; a `ConfigurationError` if it has none."""
    try:
        return FAMILY_STYLE[family]
    except KeyError:
        raise ConfigurationError(
            f"orbit family {family!r} has no style: add it to FAMILY_STYLE; the families with one "
            f"are {', '.join(FAMILY_STYLE)}"
        ) from None


def style_or_gray(styles: Mapping[str, SeriesStyle], name: str, label: str) -> SeriesStyle:
    """Style of a series with its label; a series without one is gray."""
    return styles.get(name, SeriesStyle(label, GRAY, SOLID, "v"))._replace(label=label)


def optimizer_style(architecture: str) -> SeriesStyle:
    """Style of an architecture."""
    label = labels.architecture_label(architecture)
    return style_or_gray(OPTIMIZER_STYLE, labels.without_number(architecture), label)


def estimator_style(estimator: str) -> SeriesStyle:
    """Style of an estimator."""
    return style_or_gray(ESTIMATOR_STYLE, estimator, labels.estimator_label(estimator))


_SPARE_MARKERS = "ovsD^P*X<>hp"


def distinct(styles: Mapping[str, SeriesStyle]) -> dict[str, SeriesStyle]:
    """Styles of the series of one figure, with other markers where two would look alike."""
    found: dict[str, SeriesStyle] = {}
    for name, series in styles.items():
        taken = {(each.color, each.marker) for each in found.values()}
        spare = (marker for marker in _SPARE_MARKERS if (series.color, marker) not in taken)
        alike = (series.color, series.marker) in taken
        found[name] = series._replace(marker=next(spare, series.marker)) if alike else series
    return found


@contextmanager
def house_style() -> Iterator[None]:
    """Set the parameters of matplotlib for the time in which a figure is made or saved."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def new_figure(height_in: float, width_in: float = PAGE_WIDTH_IN) -> Figure:
    """An empty figure, not registered with pyplot; size in inches."""
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
    """Write a figure as PNG and PDF, each completely or not at all; create their folders.

    The same figure gives the same bytes: no dates and no versions are stored. The PNG has at most
    256 colors, which reduces its size to a third.
    """
    plain = {"Creator": None, "Producer": None, "CreationDate": None}
    files = ((path_png, "png", {"Software": None}), (path_pdf, "pdf", plain))
    for path, kind, metadata in each(files, "files of the figure"):
        drawn = io.BytesIO()
        with house_style():
            figure.savefig(drawn, format=kind, dpi=RASTER_DPI, metadata=metadata)
        if kind == "png":
            drawn = _with_palette(drawn)
        with whole_file(path) as temporary:
            temporary.write_bytes(drawn.getvalue())


def _with_palette(drawn: io.BytesIO) -> io.BytesIO:
    """A PNG with its colors in a palette, without dithering.

    The palette covers all hues of the figure, so that color bars have no steps.
    """
    smaller = io.BytesIO()
    method = {"method": Image.Quantize.MAXCOVERAGE, "kmeans": 1, "dither": Image.Dither.NONE}
    colors = Image.open(drawn).convert("RGB").quantize(256, **method)
    colors.save(smaller, "PNG", optimize=True, dpi=(RASTER_DPI, RASTER_DPI))
    return smaller
