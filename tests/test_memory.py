"""Memory beyond input and output: at most 8 MiB, however long the data."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

CODE = """
    import resource
    import numpy as np
    import algdiff

    def peak():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    x = np.ones({shape}, np.float32)
    out = np.empty_like(x)
    out.fill(0)
    design = algdiff.Differentiator({length})
    # Code and tables are not the array's: what even a small run needs, before the peak is taken.
    design(x.reshape(-1)[: 2 * {length}], mode="{mode}", threads=1)
    before = peak()
    design(x, axis={axis}, mode="{mode}", threads={threads}, out=out)
    after = peak()
    assert not np.nan_to_num(out).any()
    print((after - before) / 1024)
"""


def run_peak(**case: object) -> float:
    command = [sys.executable, "-c", textwrap.dedent(CODE.format(**case))]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, result.stderr
    return float(result.stdout)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("shape", "axis", "mode", "length"),
    [
        ("30_000_000", 0, "fit", 61),
        ("(300_000, 100)", 0, "fit", 61),
        ("(300_000, 100)", 1, "wrap", 61),
        ("(100, 300_000)", 0, "mirror", 31),
        ("(1000, 30_000)", 0, "fit", 101),
        ("(50_000, 200)", 0, "nan", 4001),
        # The direct engine takes long for such windows: fewer samples show the same buffers.
        ("(110_000, 4)", 0, "nearest", 100_001),
    ],
)
def test_memory_does_not_grow_with_the_data(shape: str, axis: int, mode: str, length: int, threads: int) -> None:
    assert run_peak(shape=shape, axis=axis, mode=mode, length=length, threads=threads) <= 8
