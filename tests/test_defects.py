"""What becomes of a defect inside: an exception that says so, and a process that goes on."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import numpy as np
import pytest

import algdiff
from algdiff import _core

ROOT = Path(__file__).resolve().parent.parent


def test_a_panic_is_an_internal_error(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(algdiff.InternalError, match="failed inside; please report"):
        _core.fail_inside()
    assert issubclass(algdiff.InternalError, RuntimeError)
    # Where it happened is on standard error, for the report.
    assert "asked to fail inside" in capfd.readouterr().err
    t = np.arange(50.0)
    np.testing.assert_allclose(algdiff.differentiate(t**2, 7), 2 * t, rtol=0, atol=1e-10)


def test_panics_in_many_threads_end_in_each() -> None:
    seen: list[type[BaseException]] = []

    def fail() -> None:
        for _ in range(20):
            try:
                _core.fail_inside()
            except algdiff.InternalError as error:
                seen.append(type(error))

    threads = [threading.Thread(target=fail) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert seen == [algdiff.InternalError] * 80


def test_a_stream_that_failed_inside_is_refused_and_others_go_on() -> None:
    design = algdiff.Differentiator(5)
    broken, whole = design.stream(), design.stream()
    with pytest.raises(algdiff.InternalError):
        broken._fail_inside()  # type: ignore[attr-defined]
    # What it holds may be half of a sample: no estimate is better than a wrong one.
    for call in (lambda: broken.push(1.0), lambda: broken.count, broken.reset):
        with pytest.raises(ValueError, match="stream must be another one, got 'one that failed inside'"):
            call()
    assert [whole.push(value) for value in (0.0, 1.0, 2.0, 3.0, 4.0)][-1] == pytest.approx(1.0)


def test_the_core_holds_no_way_to_stop_the_interpreter() -> None:
    """The lints that say so are set to what no module can undo, or must argue for."""
    lints = (ROOT / "Cargo.toml").read_text()
    assert 'unsafe_code = "forbid"' in lints
    for lint in ("unwrap_used", "expect_used", "panic", "unreachable", "todo", "unimplemented", "indexing_slicing"):
        assert f'{lint} = "deny"' in lints
    sources = {path: path.read_text() for path in (ROOT / "rust").glob("*/src/**/*.rs")}
    assert len(sources) > 50
    for path, source in sources.items():
        assert not re.search(r"\bunsafe\b", source), path
        assert "allow(clippy" not in source, path
        for attribute in re.findall(r"expect\(\s*clippy::[^)]*\)", source):
            assert "reason" in attribute, path
    for crate in ("core", "fft", "py"):
        assert "[lints]\nworkspace = true" in (ROOT / "rust" / crate / "Cargo.toml").read_text()
    assert 'panic = "abort"' not in lints
