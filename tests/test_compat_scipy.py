"""Taps for SciPy's filters: errors in the words of `firdiff`. test_recipes.py tests the taps."""

from __future__ import annotations

from typing import Any

import pytest

from algdiff.compat.scipy import firdiff


@pytest.mark.parametrize(
    ("numtaps", "error", "message"),
    [
        (31.0, TypeError, "^numtaps must be an integer, got 31.0$"),
        ("x", TypeError, "^numtaps must be an integer, got 'x'$"),
        (0, ValueError, "^numtaps must be an integer of at least 1, got 0$"),
        (3, ValueError, r"^numtaps must be at least degree \+ 1 = 4, got 3$"),
    ],
)
def test_errors_name_numtaps(numtaps: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        firdiff(numtaps)


def test_other_errors_keep_their_names() -> None:
    with pytest.raises(ValueError, match=r"^kappa must"):
        firdiff(31, kappa=-2)
