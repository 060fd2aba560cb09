"""Every promise of the documentation names a test that exists."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "guarantees.md").read_text()
ROWS = [row for row in re.findall(r"^\|(.*)\|$", PAGE, re.MULTILINE) if not re.fullmatch(r"[-|]+", row)]
TITLE = "test"  # of the last column


@cache
def text(name: str) -> str:
    """Return a file of tests, by its name alone."""
    (path,) = [*(ROOT / "tests").glob(name), *(ROOT / "rust").glob(f"*/tests/{name}")]
    return path.read_text()


def proofs() -> list[str]:
    """Return the last column of every row, without the titles."""
    cells = [row.split("|")[-1].strip() for row in ROWS]
    return [cell for cell in cells if cell != TITLE]


def test_there_are_promises() -> None:
    assert len(proofs()) > 40
    assert all(named for named in proofs())


@pytest.mark.parametrize("proof", sorted({name for proof in proofs() for name in re.findall("`([^`]+)`", proof)}))
def test_every_promise_names_what_holds_it(proof: str) -> None:
    if proof.startswith("make "):
        assert re.search(rf"^{proof.removeprefix('make ')}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
        return
    if "/" in proof:
        assert (ROOT / proof).is_file()
        return
    file, _, test = proof.partition("::")
    assert re.search(rf"\b(def|fn) {test}\(" if test else r"\bdef test_", text(file)), proof


def test_every_row_has_proof() -> None:
    for row in proofs():
        assert re.fullmatch(r"`[^`]+`(, `[^`]+`)*", row), row


def test_tests_named_in_the_text_exist_too() -> None:
    rows = {name for proof in proofs() for name in re.findall("`([^`]+)`", proof)}
    for name in re.findall(r"`(\w+\.(?:py|rs)::\w+)`", PAGE):
        if name not in rows:
            file, _, test = name.partition("::")
            assert re.search(rf"\b(def|fn) {test}\(", text(file)), name
