from __future__ import annotations

import json
from typing import Any

import numpy as np
from tests.vectors.page.make_page_vectors import FILE, make


def same(found: Any, expected: Any) -> None:
    """Compare two documents, numbers up to rounding."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key, value in expected.items():
            same(found[key], value)
    elif isinstance(expected, str):
        assert found == expected
    elif isinstance(expected, list) and expected and isinstance(expected[0], dict):
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    else:
        np.testing.assert_allclose(np.array(found), np.array(expected), rtol=1e-6, atol=1e-9)


def test_the_vectors_of_the_page_are_what_python_says_today() -> None:
    expected = json.loads(FILE.read_text(encoding="utf-8"))
    same(json.loads(json.dumps(make())), expected)
