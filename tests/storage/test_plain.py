"""Records in plain form: what comes back is what went in, and only classes that were named are made."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest

from camnet.errors import DataError
from camnet.storage.plain import from_plain, to_plain


class Pair(NamedTuple):
    first: Any
    second: Any


@dataclass(frozen=True, slots=True)
class Record:
    name: str
    values: Any
    parts: Any


def there_and_back(value: object, classes: list[type]) -> Any:
    arrays: dict[str, Any] = {}
    form = json.loads(json.dumps(to_plain(value, arrays), allow_nan=False))
    return from_plain(form, arrays, classes)


def test_records_come_back_as_they_were():
    numbers = np.array([[1.0, np.nan], [-0.0, 1e-300]])
    value = Record("a", {30.0: None, "x": numbers}, [Pair((1, True), math.inf), Pair([], np.float64(0.1))])
    again = there_and_back(value, [Record, Pair])
    assert type(again) is Record
    assert again.name == "a"
    assert list(again.values) == [30.0, "x"]
    np.testing.assert_array_equal(again.values["x"], numbers)
    assert again.parts == [Pair((1, True), math.inf), Pair([], 0.1)]
    assert type(again.parts[0]) is Pair
    assert type(again.parts[0].first) is tuple


def test_classes_that_nobody_named_are_not_made():
    with pytest.raises(DataError, match="Record"):
        there_and_back(Record("a", 1, 2), [Pair])
    for form in ({"is": "dict"}, {"is": "Pair", "of": {"other": 1}}, [1], {"is": "array", "of": "a7"}):
        with pytest.raises(DataError):
            from_plain(form, {}, [Pair])


def test_what_has_no_plain_form_is_refused():
    with pytest.raises(TypeError, match="set"):
        to_plain({1, 2}, {})
