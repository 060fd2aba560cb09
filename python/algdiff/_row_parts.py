"""Blocks of lazy arrays and of files: what is computed of the samples of a block and of their halo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from algdiff import _arguments as arguments
from algdiff import _threads as threads_of
from algdiff._arguments import Samples
from algdiff._blocks import Row, run_part
from algdiff._data import Data
from algdiff._estimates import _Job
from algdiff._layout import like
from algdiff._run import run
from algdiff._wish import Call, Windows, Wish, limits

if TYPE_CHECKING:
    from algdiff._differentiator import Differentiator


class Blocks:
    """What all blocks of a call have in common: small, for it goes with every task.

    Attributes
    ----------
    design : Differentiator
        For the step of even times.
    samples : int
        Of a whole row.
    axis : int
        The axis of time in a block.
    halo : tuple of int
        Samples before and after a block that come with it.
    windows : Windows
        Without the times.
    call, wish : Call, Wish
        Without what comes with every sample.
    names : list of str
        What of that comes with a block: times, weights, levels of the noise.
    masked : bool
        Whether samples may be masked.
    alone : bool
        Whether there is one block in a row.
    """

    alone = True

    def __init__(
        self,
        design: Differentiator,
        samples: int,
        axis: int,
        halo: tuple[int, int],
        windows: Windows,
        call: Call,
        wish: Wish,
        names: list[str],
        masked: bool,
        dtype: np.dtype[Any],
    ) -> None:
        self.design, self.samples, self.axis, self.halo, self.names = design, samples, axis, halo, names
        self.windows, self.call = windows._replace(times=None), call._replace(axis=axis)
        beside: dict[str, Any] = dict.fromkeys(("t", "window_duration", "weights", *names))
        self.wish = wish._replace(**beside)
        self.masked, self.dtype = masked, arguments.working_dtype(dtype)

    @property
    def more(self) -> bool:
        """Whether more than the estimates is asked for."""
        return self.wish.return_std or self.wish.return_support or self.wish.return_bias

    @property
    def orders(self) -> int:
        """Orders of the design."""
        return len(self.design._plans)

    @property
    def leading(self) -> bool:
        """Whether results have a leading axis: over the orders, or over all that is asked for."""
        return self.more or self.design._leading is not None

    @property
    def rows(self) -> int:
        """Length of that axis."""
        return self.orders * (1 + self.wish.return_std + self.wish.return_bias) + self.wish.return_support

    @property
    def outputs(self) -> int:
        """Estimates of a row."""
        return self.samples + 1 - self.design._plan.span if self.call.mode == "valid" else self.samples

    @property
    def fits(self) -> bool:
        """Whether sliding weights alone do not do."""
        wish = self.wish
        words = wish.nan_policy != "propagate" or wish.edge_window != "full"
        noise = wish.sigma is not None or wish.autocovariance is not None
        return bool(self.more or words or noise or self.masked or self.names)

    def start(self, first: int) -> int:
        """Return the first sample of the block whose outputs begin with `first`, with its halo."""
        around = self.call.mode == "wrap" and not self.alone
        return first - self.halo[0] if around else max(first - self.halo[0], 0)

    def slid(self, x: Samples, first: int, last: int) -> Samples:
        """Return the estimates by sliding weights: the bits of the whole row."""
        bank, plan, call = self.design._bank, self.design._plan, self.call
        if self.alone:
            options: dict[str, Any] = {"mode": call.mode, "cval": call.cval, "threads": call.threads}
            return run(bank, plan, x, orders=self.design._leading, axis=self.axis, **options)
        samples = arguments.signal("x", x)
        grid = bank.grid(single=self.dtype in (np.float32, np.complex64))
        row = Row.of(plan, call.mode, self.samples, grid)
        start, end = row.reads(first, last)
        held = samples[self.along(start - self.start(first), end - self.start(first))]
        shape = (self.orders, *x.shape[: self.axis], last - first, *x.shape[self.axis + 1 :])
        result = like(held, shape, self.dtype)
        options = {"start": start, "first": first, "threads": threads_of.count(call.threads)}
        run_part(bank, row, held, result, self.axis, call.cval, **options)
        return result if self.leading else result[0]

    def along(self, start: int, end: int) -> tuple[slice, ...]:
        return (*(slice(None),) * self.axis, slice(start, end))

    def fitted(self, x: Samples, beside: dict[str, NDArray[Any]], first: int, last: int, start: int) -> Samples:
        """Return all that is asked for as rows of one array: estimates, standard deviations, biases, support.

        `x` holds the samples from `start` on.
        """
        call = self.call
        data = _Rows(x, beside, self, call)
        found = data.restored(
            [_Job(data, constant, call, data.wish).run(values) for values, constant in data.parts], call
        )
        offset = 0 if data.valid else first - start
        place = (slice(None), *self.along(offset, offset + last - first))
        parts = [part for part in (found.estimate, found.std, found.bias, found.support) if part is not None]
        rows = [(part[np.newaxis] if part.ndim == x.ndim else part)[place] for part in parts]
        return np.concatenate(rows, dtype=self.dtype) if self.leading else rows[0][0]


class _Rows(Data):
    """The samples of a block, whose windows are those of the whole row: uneven if that is, ascending times or none."""

    def __init__(self, x: Samples, beside: dict[str, NDArray[Any]], blocks: Blocks, call: Call) -> None:
        given = arguments.unmasked("x", x)
        self.masked, self.stamps, self.offsets = False, None, None
        self.shape, self.axis, self.dtype = given.shape, blocks.axis, blocks.dtype
        self.samples, self.valid = given.shape[blocks.axis], call.mode == "valid"
        row: dict[str, Any] = {
            name: np.ascontiguousarray(part.reshape(-1) if part.size == self.samples else part)
            for name, part in beside.items()
        }
        self.design, self.windows = blocks.design, blocks.windows._replace(times=row.pop("t", None))
        self.wish = blocks.wish._replace(**row)
        self.limits = limits(self.design, self.windows, self.samples, call, self.wish)
        values = self._floats(given, self.wish)
        real = values.dtype.kind == "f"
        cval = complex(call.cval)
        parts = [(values, cval.real)] if real else [(values.real, cval.real), (values.imag, cval.imag)]
        self.parts = [
            (np.require(np.moveaxis(part, 0, self.axis), requirements=["C", "A"]), constant) for part, constant in parts
        ]
        self._weigh(self.wish, len(parts))
        if self.missing and self.wish.nan_policy == "raise":
            self._refuse_missing(values)


def estimated(x: Samples, *beside: Samples, blocks: Blocks, block_info: Any = None) -> Samples:
    """Return the outputs of one block; `beside` its samples come their times, weights or levels of noise."""
    first, last = (int(place) for place in block_info[None]["array-location"][blocks.axis + blocks.leading])
    if blocks.fits:
        return blocks.fitted(x, dict(zip(blocks.names, beside, strict=True)), first, last, blocks.start(first))
    return blocks.slid(x, first, last)
