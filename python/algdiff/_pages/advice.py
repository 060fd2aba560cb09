"""What a report on a recording warns of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from algdiff._pages.of_recording import shortened
from algdiff._refusals import listed

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from algdiff import Suggestion
    from algdiff._pages.of_recording import Column


def advice(
    options: argparse.Namespace, columns: Sequence[Column], suggestion: Suggestion | None, *, known: bool
) -> list[str]:
    """Return what the user should know of a recording, whose step is known or not."""
    alive = [one for one in columns if not one.dead]
    said = []
    if not known:
        said.append("The step is neither in the file nor given: times are in samples. --fs or --delta says it.")
    missing, infinite = sum(one.missing for one in alive), sum(one.infinite for one in alive)
    if missing and options.nan_policy == "propagate":
        said.append(
            f"{_are(missing, 'missing')}, and windows that hold one give no estimate; "
            "--nan-policy omit fits the samples that are there."
        )
    if infinite:
        said.append(f"{_are(infinite, 'infinite')}; no policy omits them, and windows that hold one give no estimate.")
    dead = [shortened(one.name) for one in columns if one.dead]
    if dead:
        said.append(f"{listed(dead)}: no sample is finite, so that nothing is estimated.")
    still = [shortened(one.name) for one in alive if one.constant is not None]
    if still:
        said.append(f"{listed(still)}: constant, without noise or a derivative to be estimated.")
    coloured = suggestion is not None and (suggestion.correlation or suggestion.colour > 1 or suggestion.quantum)
    if coloured and len(still) < len(alive):
        how = "given" if options.sigma is not None else "found from sample to sample"
        said.append(
            "The noise is coloured, or the samples are rounded: the error band, which takes noise for white and of the "
            f"level {how}, may be too narrow. The expected error counts it."
        )
    return said


def _are(count: int, what: str) -> str:
    return f"{count} sample{' is' if count == 1 else 's are'} {what}"
