"""Every archive of arrays that camnet reads: any change of content is refused by name, none of form changes a bit."""

from __future__ import annotations

import io
import json
import os
import stat
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import artefacts
import numpy as np
import pytest
from artefacts import pack, rewritten, unpack
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camnet.agents.policy_file import load_policy
from camnet.errors import DataError
from camnet.estimation.persistence import load_models
from camnet.experiments.learned_model import load_model
from camnet.experiments.motion_learning_runs import read_trace
from camnet.storage.archive import LIMIT_BYTES, read_archive, write_archive


def trace(path: Path) -> Path:
    write_archive(path, "camnet traces", 1, {}, {"t_s": np.arange(4.0), "seen": np.arange(4) > 1})
    return path


KINDS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], object]]] = {
    "policy": (artefacts.policy, load_policy),
    "models": (artefacts.learned_models, load_models),
    "motion": (artefacts.learned_motion, load_model),
    "trace": (trace, read_trace),
}
FLOAT_KINDS = ["policy", "models", "motion"]


def leaves(value: object) -> list[np.ndarray]:
    """All arrays that a loaded thing holds."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, dict):
        return [leaf for _, part in sorted(value.items()) for leaf in leaves(part)]
    if isinstance(value, list | tuple):
        return [leaf for part in value for leaf in leaves(part)]
    fields = getattr(value, "__dataclass_fields__", {})
    return [leaf for name in fields for leaf in leaves(getattr(value, name))]


def members_of(kind: str, tmp_path: Path) -> tuple[Path, dict[str, Any], dict[str, np.ndarray]]:
    path = KINDS[kind][0](tmp_path / "file.npz")
    return path, *unpack(path)


def refused(kind: str, path: Path, match: str) -> None:
    with pytest.raises(DataError, match=match) as caught:
        KINDS[kind][1](path)
    assert str(path) in str(caught.value)


WRONG: dict[str, Callable[[np.ndarray], Any]] = {
    "shorter": lambda a: a[:-1],
    "longer": lambda a: np.concatenate([a, a[:1]]),
    "deeper": lambda a: a[None],
    "flat": lambda a: a.reshape(-1)[: a.size - 1],
    "integers": lambda a: a.astype(np.int64),
    "single": lambda a: a.astype(np.float32),
    "complex": lambda a: a.astype(complex),
    "text": lambda a: a.astype(str),
    "cut to whole numbers": lambda a: np.trunc(a + 0.25),
    "scaled": lambda a: a * 1.001 + 1e-9,
    "reversed": lambda a: a[::-1] if not np.array_equal(a, a[::-1]) else a + 1.0,
    "nan": lambda a: np.where(np.arange(a.size).reshape(a.shape) == a.size - 1, np.nan, a),
    "infinite": lambda a: np.where(np.arange(a.size).reshape(a.shape) == 0, np.inf, a),
    "huge": lambda a: np.where(np.arange(a.size).reshape(a.shape) == 0, 1e300, a),
    "empty": lambda a: a[:0],
    "scalar": lambda a: np.float64(1.0),
}


@pytest.mark.parametrize("change", WRONG)
@pytest.mark.parametrize("kind", KINDS)
def test_any_change_of_any_member_is_refused(kind: str, change: str, tmp_path: Path) -> None:
    path, header, arrays = members_of(kind, tmp_path)
    for name in arrays:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the change itself
            wrong = WRONG[change](arrays[name])
        if (
            isinstance(wrong, np.ndarray)
            and wrong.dtype == arrays[name].dtype
            and np.array_equal(wrong, arrays[name])
        ):
            continue  # an empty stack stays one
        pack(path, header, {**arrays, name: wrong})
        refused(kind, path, "file.npz")


@pytest.mark.parametrize(
    "change", ["shorter", "deeper", "integers", "single", "complex", "nan", "infinite", "scalar"]
)
@pytest.mark.parametrize("kind", FLOAT_KINDS)
def test_members_are_checked_though_the_seal_fits(kind: str, change: str, tmp_path: Path) -> None:
    path, header, arrays = members_of(kind, tmp_path)
    for name in arrays:
        if not arrays[name].size:
            continue
        if kind == "motion" and name in ("path", "gaps") and change == "shorter":
            continue  # a shorter record is a record
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            wrong = WRONG[change](arrays[name])
        pack(path, header, arrays)
        rewritten(path, lambda _, a, name=name, wrong=wrong: a.update({name: wrong}), seal=True)
        refused(kind, path, "array|basis|complex")


@pytest.mark.parametrize("kind", KINDS)
def test_missing_and_added_members_are_refused(kind: str, tmp_path: Path) -> None:
    path, header, arrays = members_of(kind, tmp_path)
    for name in arrays:
        pack(path, header, {k: v for k, v in arrays.items() if k != name})
        refused(kind, path, "seal")
    pack(path, header, {**arrays, "extra": np.zeros(2)})
    refused(kind, path, "seal")
    if kind in FLOAT_KINDS:
        pack(path, header, arrays)
        rewritten(path, lambda _, a: a.update(extra=np.zeros(2)), seal=True)
        refused(kind, path, "'extra' does not belong")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"format": "other"}, "format 'other'"),
        ({"format": None}, "format None"),
        ({"version": 99}, "version 99"),
        ({"version": True}, "version True"),
        ({"version": "1"}, "version '1'"),
        ({"version": 1.0}, "version"),
        ({"seal": None}, "seal"),
        ({"seal": "0" * 64}, "seal"),
        ({"more": 1}, "seal"),
    ],
)
def test_wrong_headers_are_refused(kind: str, tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    path, header, arrays = members_of(kind, tmp_path)
    pack(path, {**header, **changes}, arrays)
    refused(kind, path, match)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (b"", "not valid JSON"),
        (b"\xff\xfe", "not valid JSON"),
        (b"[1, 2]", "format"),
        (b"null", "format"),
        (b'{"format": NaN}', "no number of JSON"),
        (b'{"version": 1e999}', "range of numbers"),
        (b'{"version": %s}' % (b"9" * 5000), "digits"),
        (b"[" * 100_000, "nested too deeply|not valid JSON"),
        (b"[" * 300 + b"]" * 300, "nested"),
        (b'{"version": 1, "version": 2}', "twice"),
    ],
)
def test_headers_that_are_no_json_are_refused(tmp_path: Path, text: bytes, match: str) -> None:
    path, _, arrays = members_of("policy", tmp_path)
    pack(path, text, arrays)
    refused("policy", path, match)


@pytest.mark.parametrize("kind", KINDS)
def test_form_changes_nothing(kind: str, tmp_path: Path) -> None:
    path, header, arrays = members_of(kind, tmp_path)
    load = KINDS[kind][1]
    before = leaves(load(path))
    assert before
    turned = dict(reversed(header.items()))
    for compression in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        pack(path, json.dumps(turned, indent=3).encode(), arrays, compression, reverse=True)
        assert all(np.array_equal(a, b) for a, b in zip(leaves(load(path)), before, strict=True))
    pack(path, header, {k: np.asfortranarray(v.astype(v.dtype.newbyteorder(">"))) for k, v in arrays.items()})
    again = leaves(load(path))
    assert all(np.array_equal(a, b) and a.dtype == b.dtype for a, b in zip(again, before, strict=True))
    os.utime(path, (0, 0))
    (tmp_path / "link.npz").symlink_to(path)
    assert all(np.array_equal(a, b) for a, b in zip(leaves(load(tmp_path / "link.npz")), before, strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_other_things_under_the_name_are_refused(kind: str, tmp_path: Path) -> None:
    load = KINDS[kind][1]
    path = tmp_path / "file.npz"
    for make in (
        lambda: None,
        lambda: path.mkdir(),
        lambda: (path.rmdir(), path.write_bytes(b"")),
        lambda: path.write_bytes(b"PK\x03\x04"),
        lambda: np.save(path.open("wb"), np.zeros(3)),
        lambda: (path.unlink(), os.mkfifo(path)),
        lambda: (path.unlink(), path.symlink_to("nowhere")),
    ):
        make()
        with pytest.raises(DataError, match=r"file\.npz"):
            load(path)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_files_that_may_not_be_read_are_named(kind: str, tmp_path: Path) -> None:
    path = KINDS[kind][0](tmp_path / "file.npz")
    path.chmod(stat.S_IWUSR)
    refused(kind, path, "Permission denied")


def bomb(path: Path, header: bytes, content: bytes, claimed: int | None = None) -> None:
    """Write an archive with one large member; the size that its directory claims can be another."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("mean.npy", header + content)
        if claimed is not None:
            file.infolist()[0].file_size = claimed


def npy_header(shape: str, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}"
    text += " " * (-(len(text) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def test_archives_that_would_swell_are_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    bomb(path, npy_header("(40000000,)"), bytes(320_000_000))
    assert path.stat().st_size < 1_000_000
    assert LIMIT_BYTES < 320_000_000
    for kind in KINDS:
        refused(kind, path, "would unpack to 320000|is not a readable archive")


@pytest.mark.parametrize(
    ("shape", "descr", "match"),
    [
        ("(10**12,)", "'<f8'", "mean"),
        ("(1000000000000,)", "'<f8'", "needs 8000000000000 bytes"),
        ("(-2, -2)", "'<f8'", "mean"),
        ("(3,)", "'<f8'", "needs 24 bytes"),
        ("(4,)", "'|O'", "should hold numbers"),
        ("(4,)", "'<U2'", "should hold numbers"),
        ("(4,)", "[('a', '<f8')]", "should hold numbers"),
        ("(4,)", "'<M8[s]'", "should hold numbers"),
        ("(" * 2000, "'<f8'", "mean"),
        ("4", "'<f8'", "mean"),
        ("(True, 4)", "'<f8'", "mean"),
    ],
)
def test_shapes_and_types_are_checked_before_memory_is_taken(
    tmp_path: Path, shape: str, descr: str, match: str
) -> None:
    path = tmp_path / "file.npz"
    bomb(path, npy_header(shape, descr), bytes(32))
    refused("policy", path, match)


def test_doubled_members_and_other_members_are_refused(tmp_path: Path) -> None:
    path, _, _ = members_of("policy", tmp_path)
    content = io.BytesIO()
    np.save(content, np.zeros(3))
    with warnings.catch_warnings(), zipfile.ZipFile(path, "a") as file:
        warnings.simplefilter("ignore")  # the standard library warns of it
        file.writestr("mean.npy", content.getvalue())
    refused("policy", path, "doubled")
    path, _, _ = members_of("policy", tmp_path)
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("notes.txt", "hello")
    refused("policy", path, "no array")
    with zipfile.ZipFile(path, "w") as file:
        for k in range(5000):
            file.writestr(f"a{k}.npy", "")
    refused("policy", path, "5000 members")


def test_the_cut_path_of_a_learned_motion_is_refused_sealed_or_not(tmp_path: Path) -> None:
    path = artefacts.learned_motion(tmp_path / "model.npz")
    for cut in (lambda a: np.trunc(a), lambda a: a.astype(np.int64)):
        for seal in (False, True):
            artefacts.learned_motion(path)
            rewritten(path, lambda _, a, cut=cut: a.update(path=cut(a["path"])), seal=seal)
            with pytest.raises(DataError, match=r"seal|increase|int64"):
                load_model(path)


@pytest.mark.parametrize(
    ("name", "change", "match"),
    [
        ("path", lambda a: a[::-1], "increase"),
        ("path", lambda a: np.add(a, [0, 0, 0, 7]), "cameras"),
        ("path", lambda a: np.add(a, [0, 0, 0, 0.5]), "cameras"),
        ("gaps", lambda a: a * [1, 1, -1, 1, 1] + [0, 0, 9, 0, 0], "gap ends before"),
        ("gaps", lambda a: a * [1, 1, 1, 1, -1], "negative error"),
        ("gaps", lambda a: np.add(a, [9, 0, 0, 0, 0]), "cameras"),
        ("precision", lambda a: -a, "symmetric and positive"),
        ("precision", lambda a: np.add(a, [[0, 1], [0, 0]]), "symmetric and positive"),
        ("weights", lambda a: a[:0], "cameras"),
    ],
)
def test_records_of_a_learned_motion_must_be_possible(
    tmp_path: Path, name: str, change: Callable[[np.ndarray], np.ndarray], match: str
) -> None:
    path = artefacts.learned_motion(tmp_path / "model.npz")
    rewritten(path, lambda _, a: a.update({name: change(a[name])}), seal=True)
    with pytest.raises(DataError, match=match):
        load_model(path)


def test_equal_content_gives_equal_bytes(tmp_path: Path) -> None:
    for kind, (build, _) in KINDS.items():
        assert build(tmp_path / "a.npz").read_bytes() == build(tmp_path / "b.npz").read_bytes(), kind


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.data())
def test_flipped_bytes_give_the_same_content_or_an_error(tmp_path: Path, data: st.DataObject) -> None:
    path = trace(tmp_path / "good.npz")
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    (tmp_path / "bad.npz").write_bytes(bytes(content[: data.draw(st.integers(1, len(content)))]))
    good = read_archive(path, "camnet traces", 1)
    try:
        found = read_archive(tmp_path / "bad.npz", "camnet traces", 1)
    except DataError:
        return
    assert all(np.array_equal(found.arrays[name], good.arrays[name]) for name in good.arrays)
