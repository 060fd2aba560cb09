"""Interfaces of other packages to this library, each in a module of its own that is imported when it is asked for.

======================== ========================================================= ==========================
`algdiff.compat.` module what is in it                                             needs
======================== ========================================================= ==========================
`toolbox`                `AlgebraicDifferentiator`, the class of the AlgDiff       NumPy only
                         toolbox; also ``algdiff.compat.AlgebraicDifferentiator``
`scipy`                  `firdiff`, FIR taps for SciPy's filters                   NumPy only
`derivative`             the kind "algebraic" of ``derivative.dxdt``               ``pip install derivative``
`pysindy`                a differentiation method for SINDy                        ``pip install pysindy``
`pynumdiff`              a method for PyNumDiff and its tuner                      ``pip install pynumdiff``
`sklearn`                a transformer for pipelines                               ``pip install scikit-learn``
======================== ========================================================= ==========================

>>> from algdiff.compat import AlgebraicDifferentiator
>>> AlgebraicDifferentiator(ts=0.01, alpha=2, beta=2, N=1, T=0.2, display=False).get_degreeExactness(1)
3
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from algdiff.compat.toolbox import AlgebraicDifferentiator

__all__ = ["AlgebraicDifferentiator"]


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name != "AlgebraicDifferentiator":
            raise AttributeError(f"module 'algdiff.compat' has no attribute {name!r}")
        from algdiff.compat.toolbox import AlgebraicDifferentiator

        globals()[name] = AlgebraicDifferentiator
        return AlgebraicDifferentiator


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
