"""Writers of the formats that cases change part by part."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

__all__ = ["archive", "arrays_of", "write_gpx", "write_krtd", "write_network"]


def _element(name: str, attributes: Mapping[str, Any], body: str = "") -> str:
    words = "".join(f" {key}={quoteattr(str(value))}" for key, value in attributes.items())
    return f"<{name}{words}>{body}</{name}>" if body else f"<{name}{words}/>"


def write_network(net: Mapping[str, Sequence[Mapping[str, Any]]], head: str = "", between: str = "\n") -> str:
    """Write a SUMO network; ``head`` comes first inside the outermost element."""
    parts = [head] if head else []
    for edge in net["edges"]:
        own = {key: value for key, value in edge.items() if key != "lanes"}
        parts.append(_element("edge", own, "".join(_element("lane", lane) for lane in edge["lanes"])))
    parts += [_element("junction", junction) for junction in net["junctions"]]
    parts += [_element("connection", connection) for connection in net["connections"]]
    return f'<net version="1.20">{between}{between.join(parts)}{between}</net>\n'


def write_gpx(points: Sequence[tuple[str, str, str | None]], name: str = "a", more: str = "") -> str:
    """Write latitudes, longitudes and times as a GPX track; ``more`` goes into every point."""
    rows = "\n".join(
        f'<trkpt lat="{lat}" lon="{lon}">{more}{"" if t is None else f"<time>{t}</time>"}</trkpt>'
        for lat, lon, t in points
    )
    head = '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">'
    return f"{head}<trk><name>{name}</name><trkseg>\n{rows}\n</trkseg></trk></gpx>\n"


def write_krtd(k: Any, r: Any, t: Any, d: Sequence[float]) -> str:
    """Write a KRTD camera file in full precision."""
    rows = [" ".join(repr(float(x)) for x in row) for row in [*np.asarray(k)]]
    turned = [" ".join(repr(float(x)) for x in row) for row in [*np.asarray(r)]]
    moved = " ".join(repr(float(x)) for x in np.asarray(t))
    return "\n".join([*rows, "", *turned, "", moved, "", " ".join(repr(float(x)) for x in d)]) + "\n"


def arrays_of(content: bytes) -> dict[str, np.ndarray]:
    """Return the members of a NumPy archive."""
    with np.load(io.BytesIO(content), allow_pickle=False) as data:
        return {name: data[name] for name in data.files}


def archive(
    arrays: Mapping[str, Any],
    compressed: bool = True,
    order: Sequence[str] | None = None,
    pickled: bool = False,
) -> bytes:
    """Write a NumPy archive, member by member."""
    stream = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(stream, "w", kind) as file:
        for name in order or list(arrays):
            member = io.BytesIO()
            np.save(member, arrays[name], allow_pickle=pickled)
            file.writestr(f"{name}.npy", member.getvalue())
    return stream.getvalue()
