"""The continuous kernel."""

from __future__ import annotations

from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff import _arguments as arguments
from algdiff import _core


class Kernel:
    r"""Continuous kernel of an algebraic differentiator, for a window of length T = 1.

    The estimate of the derivative of order `deriv` at the point `tau` of the window `[t0, t0 + T]` is

    .. math:: T^{-n} \int_0^1 k(s)\, x(t_0 + T s)\, ds, \qquad
              k(s) = \rho(s) \sum_{m=n}^{N} p_m^{(n)}(\tau)\, p_m(s),

    with n = `deriv`, N = `degree`, the density :math:`\rho \propto s^\kappa (1 - s)^\mu` and its orthonormal
    polynomials :math:`p_m`: the derivative at `tau` of the weighted least-squares polynomial of degree N (Mboup,
    Join and Fliess 2007, section II).

    Parameters
    ----------
    deriv : int
        Order of the derivative, at least 0.
    degree : int, optional
        Degree of the local polynomial, from `deriv` to 500; default ``deriv + 2``.
    kappa, mu : float
        Exponents of the weight at the oldest (0) and the newest (1) end, greater than -1.
    tau : {"center", "root", "newest"} or float
        Point of estimation: 0 is the oldest, 1 the newest end. "root" is the largest of `roots`. A number within
        1e-12 of a root counts as the root.

    Attributes
    ----------
    deriv, degree, kappa, mu, tau
        The arguments, `tau` as a number.
    exactness : int
        Polynomials up to this degree are differentiated exactly: `degree`, or one more if `tau` is a root.
    bias_constant, bias_order : float, int
        On a smooth signal the estimate errs by ``bias_constant * T**p * x^(deriv + p)`` to leading order, p =
        `bias_order`.
    norm2 : float
        Integral of k squared. White noise of variance s**2, sampled every delta, gives the estimate the variance
        ``s**2 * delta * norm2 / T**(2 * deriv + 1)``. Infinite if an exponent is -1/2 or less.
    roots : ndarray of shape (degree - deriv + 1,)
        The points at which one more degree is reproduced, ascending.

    Raises
    ------
    ValueError
        An argument is outside of what it may be.
    TypeError
        An argument is of the wrong type.

    Examples
    --------
    >>> from algdiff import Kernel
    >>> k = Kernel(1, 1, kappa=0, mu=0)
    >>> k([0.0, 0.25, 1.0])
    array([-6., -3.,  6.])
    >>> round(k.norm2, 9), k.exactness
    (12.0, 2)
    """

    __slots__ = ("_kernel", "degree", "deriv", "kappa", "mu", "tau")

    _kernel: _core.Kernel
    deriv: int
    degree: int
    kappa: float
    mu: float
    tau: float

    def __init__(
        self,
        deriv: SupportsIndex,
        degree: SupportsIndex | None = None,
        kappa: float = 1.0,
        mu: float = 1.0,
        tau: float | str = "center",
    ) -> None:
        order = arguments.integer("deriv", deriv, 0)
        size = order + 2 if degree is None else arguments.integer("degree", degree, 0)
        kappa, mu = arguments.real("kappa", kappa), arguments.real("mu", mu)
        kernel = _core.Kernel(order, size, kappa, mu, arguments.word_or_real("tau", tau))
        for name, value in zip(self.__slots__, (kernel, size, order, kappa, mu, kernel.tau), strict=True):
            object.__setattr__(self, name, value)

    def __call__(self, points: ArrayLike) -> Any:
        """Return the kernel at `points` of [0, 1], in their shape; it is zero outside.

        Parameters
        ----------
        points : array_like of float
            Points of the window.

        Returns
        -------
        float or ndarray of float64, in the shape of `points`
        """
        places = np.asarray(points)
        if places.dtype.kind not in "fiub":
            raise TypeError(f"points must be real numbers, got dtype {places.dtype}")
        flat = arguments.contiguous(places.astype(np.float64, copy=False))
        values = np.empty(flat.shape)
        self._kernel.values(flat, values)
        return values.reshape(places.shape)[()]

    @property
    def exactness(self) -> int:
        """Polynomials up to this degree are differentiated exactly."""
        return self._kernel.exactness

    @property
    def bias_order(self) -> int:
        """Power of T in the leading error."""
        return self._kernel.bias[0]

    @property
    def bias_constant(self) -> float:
        """Factor of the leading error."""
        return self._kernel.bias[1]

    @property
    def norm2(self) -> float:
        """Integral of the squared kernel."""
        return self._kernel.norm2

    @property
    def roots(self) -> NDArray[np.float64]:
        """Points at which one more degree is reproduced, ascending."""
        return self._kernel.roots()

    @property
    def _key(self) -> tuple[int, int, float, float, float]:
        return self.deriv, self.degree, self.kappa, self.mu, self.tau

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Kernel does not change: cannot set {name}")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Kernel does not change: cannot delete {name}")

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if isinstance(other, Kernel) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[type, tuple[int, int, float, float, float]]:
        return Kernel, self._key

    def __repr__(self) -> str:
        return f"Kernel(deriv={self.deriv}, degree={self.degree}, kappa={self.kappa}, mu={self.mu}, tau={self.tau})"
