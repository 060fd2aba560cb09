"""A transformer for scikit-learn: rows are samples in the order of time, columns are signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from algdiff._differentiator import Differentiator
from algdiff._suggest.choice import suggest
from algdiff._suggest.suggestion import Suggestion

try:
    from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin
    from sklearn.utils.validation import check_is_fitted, validate_data
except ImportError as _error:
    raise ImportError(f"algdiff.compat.sklearn needs scikit-learn: pip install scikit-learn ({_error})") from _error

__all__ = ["DerivativeTransformer"]


class DerivativeTransformer(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Replace every column by its derivative along the rows, which must be even in time and in their order.

    Splits that shuffle rows make nonsense of it: take `sklearn.model_selection.TimeSeriesSplit`, whose parts are runs.

    Parameters
    ----------
    window_length : int, optional
        Number of rows in the window. Without it `fit` chooses window and degree, one for all columns that hold samples;
        `transform` chooses anew if it gets fewer rows than that window has.
    deriv : int or sequence of int
        Order of the derivative; 0 smooths. Of several, all columns of the first come first.
    degree, kappa, mu, delta, mode, nan_policy
        As in `algdiff.differentiate`, of which ``mode="valid"`` is refused: rows stay. With ``nan_policy="omit"`` NaN
        are missing samples, else they are refused.

    Attributes
    ----------
    differentiator_ : Differentiator
        The design, given or chosen.
    suggestion_ : Suggestion or None
        What `algdiff.suggest` says of the choice, if there was one.
    n_features_in_, feature_names_in_
        The columns seen by `fit`.

    Raises
    ------
    ValueError, TypeError
        In `fit` or `transform`, as `algdiff.Differentiator`.

    Examples
    --------
    >>> import numpy as np
    >>> from algdiff.compat.sklearn import DerivativeTransformer
    >>> t = np.linspace(0, 1, 101)
    >>> both = DerivativeTransformer(11, deriv=(0, 1), delta=0.01).fit(np.stack([t, t**2], axis=1))
    >>> both.get_feature_names_out().tolist()
    ['x0_deriv0', 'x1_deriv0', 'x0_deriv1', 'x1_deriv1']
    >>> both.transform(np.stack([t, t**2], axis=1))[50].round(9).tolist()
    [0.5, 0.25, 1.0, 1.0]
    """

    def __init__(
        self,
        window_length: SupportsIndex | None = None,
        deriv: SupportsIndex | Sequence[SupportsIndex] = 1,
        *,
        degree: SupportsIndex | None = None,
        kappa: float = 1.0,
        mu: float = 1.0,
        delta: float = 1.0,
        mode: str = "fit",
        nan_policy: str = "propagate",
    ) -> None:
        self.window_length = window_length
        self.deriv = deriv
        self.degree = degree
        self.kappa = kappa
        self.mu = mu
        self.delta = delta
        self.mode = mode
        self.nan_policy = nan_policy

    def fit(self, X: ArrayLike, y: object = None) -> DerivativeTransformer:  # noqa: ARG002, N803
        """Make the design, of `X` if there is no window."""
        if self.mode == "valid":
            raise ValueError("mode must be one that keeps the number of rows, got 'valid'")
        samples = self._checked(X, ensure_min_samples=2)
        self.suggestion_: Suggestion | None = None
        if self.window_length is None:
            self.suggestion_ = suggest(samples, self.deriv, axis=0, **self._words())
            self.differentiator_ = self.suggestion_.differentiator
        else:
            self.differentiator_ = Differentiator(self.window_length, self.deriv, **self._words())
        return self

    def transform(self, X: ArrayLike) -> NDArray[Any]:  # noqa: N803
        """Return the derivatives of the columns of `X`."""
        check_is_fitted(self)
        samples = self._checked(X, reset=False)
        chosen = self.suggestion_
        if chosen is not None and len(samples) < self.differentiator_.window_length:
            chosen = suggest(samples, self.deriv, axis=0, **self._words())
        run = chosen or self.differentiator_
        estimates = run(samples, axis=0, mode=self.mode, nan_policy=self.nan_policy)
        return np.hstack(estimates) if estimates.ndim == 3 else np.asarray(estimates)

    def get_feature_names_out(self, input_features: ArrayLike | None = None) -> NDArray[np.object_]:
        """Return the names of the columns; of several orders, with the order at their end."""
        names = super().get_feature_names_out(input_features)
        orders = self.differentiator_.deriv
        if isinstance(orders, tuple):
            names = np.array([f"{name}_deriv{order}" for order in orders for name in names], object)
        return np.asarray(names)

    def _words(self) -> dict[str, Any]:
        return {"degree": self.degree, "kappa": self.kappa, "mu": self.mu, "delta": self.delta}

    def _checked(self, X: ArrayLike, **words: Any) -> NDArray[Any]:  # noqa: N803
        finite = "allow-nan" if self.nan_policy == "omit" else True
        dtypes = [np.float64, np.float32]
        return np.asarray(validate_data(self, X, dtype=dtypes, ensure_all_finite=finite, **words))

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = self.nan_policy == "omit"
        tags.transformer_tags.preserves_dtype = ["float64", "float32"]
        return tags
