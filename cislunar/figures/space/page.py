"""Interactive pages in one file: plotly.js, plot, scripts and recorded arrays, compressed.

A page loads nothing. Its axes are in kilometers at equal scales, and Earth and Moon have their true
size.
"""

import base64
import gzip
import json
import re
from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.io import to_html
from plotly.offline import get_plotlyjs

from cislunar.constants import EARTH_RADIUS_KM, MOON_RADIUS_KM
from cislunar.figures.axes import Array
from cislunar.figures.space.earth_moon import thousands
from cislunar.figures.style import EARTH_COLOR, MOON_COLOR

_SCRIPT = re.compile(r"<script[^>]*>(.*?)</script>", re.DOTALL)
_UNPACK = """
<script>
const unpack = text => {
  const packed = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip")));
};
const recorded = unpack("%s").arrayBuffer();
const unpacked = (async () => {
  const script = document.createElement("script");
  script.textContent = await unpack("%s").text();
  document.body.append(script);
})();
</script>"""


def coordinates(positions_km: Array) -> dict[str, np.ndarray]:
    """Coordinates of points, rounded to 8 km: a power of two, so that they compress well."""
    coarse = (8.0 * np.round(positions_km / 8.0)).astype(np.float32)
    return {axis: coarse[..., k] for k, axis in enumerate("xyz")}


def joined(tracks: Sequence[Array]) -> Array:
    """Tracks in one array, with a gap after each."""
    gap = np.full((1, 3), np.nan)
    return np.concatenate([part for track in tracks for part in (track, gap)])


def bounds(traces: Sequence[go.Scatter3d | go.Surface]) -> Array:
    """Least and greatest coordinates of all traces, shape (3, 2), km."""
    every = [
        np.concatenate([np.asarray(trace[axis], dtype=float).ravel() for trace in traces])
        for axis in "xyz"
    ]
    return np.array([(np.nanmin(along), np.nanmax(along)) for along in every])


def body_traces(earth_km: Array, moon_km: Array) -> list[go.Surface | go.Scatter3d]:
    """Earth and Moon in true size, and their names.

    Parameters
    ----------
    earth_km, moon_km : ndarray, shape (3,)
        Positions of their centers, km.
    """
    across, down = np.linspace(0.0, 2.0 * np.pi, 41), np.linspace(0.0, np.pi, 21)
    planes = np.outer(np.cos(across), np.sin(down)), np.outer(np.sin(across), np.sin(down))
    sphere = np.stack((*planes, np.outer(np.ones_like(across), np.cos(down))), axis=-1)
    bodies = {
        "Earth": (np.asarray(earth_km), EARTH_RADIUS_KM, EARTH_COLOR),
        "Moon": (np.asarray(moon_km), MOON_RADIUS_KM, MOON_COLOR),
    }
    traces = [
        go.Surface(
            **coordinates(place + radius * sphere), name=name, showscale=False,
            colorscale=[(0.0, color), (1.0, color)],
            hovertemplate=f"{name}, radius {thousands(radius)} km<extra></extra>",
        )
        for name, (place, radius, color) in bodies.items()
    ]  # fmt: skip
    names = go.Scatter3d(
        **coordinates(np.array([place for place, *_ in bodies.values()])), mode="text",
        text=list(bodies), textposition="bottom center", textfont={"size": 13}, hoverinfo="skip",
        showlegend=False,
    )  # fmt: skip
    return [*traces, names]


def page_html(
    figure: go.Figure,
    title: str,
    name: str,
    *,
    height: str = "100vh",
    controls: str = "",
    script: str | None = None,
    arrays: Mapping[str, tuple[Array, float]] | None = None,
    facts: Mapping[str, object] | None = None,
) -> str:
    """HTML of a page with a plot. The same arguments give the same text.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
    title : str
        Title of the page.
    name : str
        Identifier of the plot's element.
    height : str
        Height of the plot, CSS.
    controls : str
        HTML beside the plot.
    script : str, optional
        JavaScript that runs once the plot is drawn.
    arrays : mapping of str to (array_like, float), optional
        Arrays that the script reads, see `packed_arrays`; the constant ``recorded`` of the page is
        a promise of them.
    facts : mapping, optional
        Further values for the script, as in JSON.
    """
    plot = to_html(
        figure, config={"responsive": True, "displaylogo": False, "scrollZoom": True},
        auto_play=False, include_plotlyjs=False, full_html=False, default_height=height,
        div_id=name, post_script=script,
    )  # fmt: skip
    scripts = "\n".join([get_plotlyjs(), *_SCRIPT.findall(plot)])
    data = packed_arrays(arrays or {}, facts or {})
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{title}</title>\n"
        "<style>html, body { margin: 0; font-family: sans-serif; }</style>\n</head>\n<body>\n"
        f"{controls}{_SCRIPT.sub('', plot)}{_UNPACK % (_packed(data), _packed(scripts.encode()))}"
        "\n</body>\n</html>\n"
    )


def _packed(content: bytes) -> str:
    # higher levels take minutes for arrays, and save three percent
    return base64.b64encode(gzip.compress(content, compresslevel=6, mtime=0)).decode()


def packed_arrays(
    arrays: Mapping[str, tuple[Array, float]], facts: Mapping[str, object] | None = None
) -> bytes:
    """Arrays as bytes that compress well.

    Every array is stored as whole multiples of its resolution, of which the second differences
    along the first axis are stored: they are small for smooth motion. The four bytes of each number
    are in planes. NaN repeats the value before it, and a plane of flags marks it.

    Parameters
    ----------
    arrays : mapping of str to (array_like, float)
        Values, shape (time, ...), and the resolution to which they are rounded, in their unit. They
        are limited to 2^31 - 1 times the resolution.
    facts : mapping, optional
        Further values, as in JSON.

    Returns
    -------
    bytes
        Length of the header (4 bytes, little endian), header in JSON (shape, resolution and whether
        there are flags, by the name of the array; ``facts``), planes.
    """
    header, parts = {}, []
    for name, (given, resolution) in arrays.items():
        values = np.atleast_1d(np.asarray(given, dtype=float))
        known = np.isfinite(values)
        flagged = not known.all()
        whole = np.rint(np.clip(np.where(known, values, 0.0) / resolution, -(2**31) + 1, 2**31 - 1))
        whole = _filled(whole.astype(np.int64), known) if flagged else whole.astype(np.int64)
        second = np.diff(whole, n=2, axis=0, prepend=np.zeros((2, *whole.shape[1:]), np.int64))
        # time is the fastest index; 32 bits suffice, since sums are modulo 2^32
        flat = len(whole), int(np.prod(whole.shape[1:]))
        along = second.reshape(flat).T.astype("<u4", casting="unsafe")
        planes = np.ascontiguousarray(along).view(np.uint8).reshape(-1, 4).T
        parts.append(np.ascontiguousarray(planes).tobytes())
        if flagged:
            flags = np.ascontiguousarray(~known.reshape(flat).T)
            parts.append(flags.astype(np.uint8).tobytes())
        header[name] = {"shape": values.shape, "resolution": resolution, "flagged": flagged}
    text = json.dumps({"arrays": header, "facts": facts or {}}, allow_nan=False).encode()
    return b"".join([len(text).to_bytes(4, "little"), text, *parts])


def _filled(whole: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Numbers with the last known one of their series in place of unknown ones."""
    along = np.arange(len(whole)).reshape(-1, *[1] * (whole.ndim - 1))
    last = np.maximum.accumulate(np.where(known, along, 0), axis=0)
    return np.take_along_axis(whole, last, axis=0)
