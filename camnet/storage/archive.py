"""Archives of arrays (``.npz``): a JSON header and plain arrays, sealed, with limits that are checked before reading.

Member ``header`` holds UTF-8 JSON as bytes: ``format``, ``version``, ``seal`` and the fields of the format. The other
members are arrays of numbers. Refused: pickled and structured arrays, archives that would unpack to more than a limit,
members whose size is not that of their shape, another format or version, and any content that the seal is not of.
"""

from __future__ import annotations

import json
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from camnet.errors import DataError
from camnet.storage.json_file import parse_json
from camnet.storage.reading import open_bounded
from camnet.storage.seal import seal_of
from camnet.storage.whole_file import whole_file
from camnet.types import Array

__all__ = ["LIMIT_BYTES", "Archive", "read_archive", "write_archive"]

#: no archive of camnet unpacks to more
LIMIT_BYTES = 256_000_000
_MOST_MEMBERS = 4096
_HEADER = "header"
#: what readers of zip archives and of arrays raise on files that are damaged or made to do harm
_BROKEN = (
    ValueError,
    KeyError,
    EOFError,
    OSError,
    MemoryError,
    OverflowError,
    RecursionError,
    SyntaxError,
    TypeError,
    NotImplementedError,
    RuntimeError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


@dataclass(frozen=True, eq=False, slots=True)
class Archive:
    """What an archive holds.

    Attributes
    ----------
    path : where it was read
    header : the format's own fields
    arrays : by name, in the machine's byte order
    """

    path: Path
    header: dict[str, Any]
    arrays: dict[str, NDArray[Any]]

    def floats(self, name: str, shape: tuple[int | None, ...]) -> Array:
        """Return an array that must be of 64-bit floats, finite and of this shape (None: any length).

        Raises
        ------
        DataError
            It is missing or something else: integers are refused, as they may be floats that were cut.
        """
        array = self.arrays.get(name)
        if array is None:
            raise DataError(f"{self.path}: array {name!r} is missing")
        fits = array.ndim == len(shape) and all(
            w is None or w == h for h, w in zip(array.shape, shape, strict=True)
        )
        if not fits or array.dtype != np.float64:
            wanted = ", ".join("any" if n is None else str(n) for n in shape)
            raise DataError(
                f"{self.path}: array {name!r} is {array.dtype} {array.shape}, expected float64 ({wanted})"
            )
        if not np.isfinite(array).all():
            raise DataError(f"{self.path}: array {name!r} holds numbers that are not finite")
        return array

    def only(self, names: set[str]) -> None:
        """See that there are no other arrays than these (DataError)."""
        unknown = sorted(set(self.arrays) - names)
        if unknown:
            raise DataError(f"{self.path}: array {unknown[0]!r} does not belong there")


def write_archive(
    path: Path, form: str, version: int, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write an archive, whole or not at all; equal content gives equal bytes."""
    fields = {**header, "format": form, "version": version}
    sealed = json.dumps({**fields, "seal": seal_of(fields, arrays)}, allow_nan=False).encode()
    members: dict[str, NDArray[Any]] = {_HEADER: np.frombuffer(sealed, dtype=np.uint8), **arrays}
    with whole_file(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in members.items():
            info = zipfile.ZipInfo(f"{name}.npy")  # without a date
            info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w", force_zip64=True) as member:
                npy.write_array(member, np.ascontiguousarray(array), allow_pickle=False)


def read_archive(path: Path, form: str, version: int, limit_bytes: int = LIMIT_BYTES) -> Archive:
    """Read an archive that `write_archive` wrote.

    Raises
    ------
    DataError
        The file is absent, too large, damaged, of another format or version, or was changed; names file and member.
    """
    with open_bounded(path, limit_bytes) as stream:
        try:
            arrays = _members(stream, limit_bytes)
        except _BROKEN as error:
            raise DataError(f"{path}: is not a readable archive of arrays ({error})") from error
    header = _parse_header(path, arrays, form, version)
    seal = header.pop("seal", None)
    if seal != seal_of(header, arrays):
        raise DataError(f"{path}: its content is not what was written (its seal does not fit); make it again")
    return Archive(path, {k: v for k, v in header.items() if k not in ("format", "version")}, arrays)


def _parse_header(path: Path, arrays: dict[str, NDArray[Any]], form: str, version: int) -> dict[str, Any]:
    member = arrays.pop(_HEADER, None)
    if member is None or member.dtype != np.uint8 or member.ndim != 1:
        raise DataError(f"{path}: has no header of bytes; a file of format {form!r} was expected")
    header = parse_json(member.tobytes(), f"{path}: member 'header'")
    if not isinstance(header, dict) or header.get("format") != form:
        found = header.get("format") if isinstance(header, dict) else header
        raise DataError(f"{path}: header: format {found!r}, expected {form!r}")
    if type(header.get("version")) is not int or header["version"] != version:
        raise DataError(f"{path}: header: version {header.get('version')!r}, this program reads {version}")
    return header


def _members(stream: IO[bytes], limit_bytes: int) -> dict[str, NDArray[Any]]:
    with zipfile.ZipFile(stream) as archive:
        infos = archive.infolist()
        if len(infos) > _MOST_MEMBERS:
            raise ValueError(f"it has {len(infos)} members, more than {_MOST_MEMBERS}")
        size = sum(info.file_size for info in infos)
        if size > limit_bytes:
            raise ValueError(f"it would unpack to {size} bytes, more than the limit of {limit_bytes}")
        arrays: dict[str, NDArray[Any]] = {}
        for info in infos:
            name = info.filename.removesuffix(".npy")
            if name in arrays or name == info.filename:
                raise ValueError(f"member {info.filename!r} is doubled, or no array")
            try:
                with archive.open(info) as member:
                    arrays[name] = _array(member, info.file_size)
            except _BROKEN as error:
                raise ValueError(f"member {info.filename!r}: {error}") from error
    return arrays


def _array(member: IO[bytes], size: int) -> NDArray[Any]:
    """Read one array of numbers whose size is that of its shape."""
    layout = npy.read_magic(member)
    if layout not in ((1, 0), (2, 0)):
        raise ValueError(f"layout {layout} of arrays is not known")
    read_header = npy.read_array_header_1_0 if layout == (1, 0) else npy.read_array_header_2_0
    shape, by_columns, dtype = read_header(member)
    if dtype.kind not in "fiub" or dtype.hasobject:
        raise ValueError(f"has type {dtype}, should hold numbers")
    wanted = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or wanted != size - member.tell():
        raise ValueError(f"shape {shape} of {dtype} needs {wanted} bytes, {size - member.tell()} are there")
    content = member.read(wanted)
    if len(content) != wanted or member.read(1):
        raise ValueError(f"has {len(content)} bytes, expected {wanted}")
    array = np.frombuffer(content, dtype).reshape(shape, order="F" if by_columns else "C")
    return np.array(array, dtype=dtype.newbyteorder("="), order="C")
