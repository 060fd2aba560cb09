"""
Arrays larger than memory, with Dask
====================================

Give ``differentiate`` a Dask array, and a Dask array comes back: lazy, in the same chunks, each computed with the
samples of its neighbours that its windows reach. With ``engine="direct"`` the result has the same bits as that of the
whole array in memory.
"""

import dask.array as da
import matplotlib.pyplot as plt
import numpy as np

import algdiff
from algdiff.dask import overlap_depth

plt.style.use("tableau-colorblind10")
delta = 1e-3  # s

# %%
# Four channels of a recording, in chunks of whole channels by stretches of time. In earnest they would come from Zarr,
# HDF5 or whatever else Dask reads.

t = delta * np.arange(200_000)
frequencies = np.array([[1.0], [2.0], [3.0], [5.0]])  # Hz
noise = 0.01 * np.random.default_rng(0).standard_normal((4, t.size))
recording = np.sin(2 * np.pi * frequencies * t) + noise  # V
x = da.from_array(recording, chunks=(4, 30_000))

# %%
# Nothing is computed by the call. The design says how far a window reaches; that much of its neighbours a chunk is
# computed with.

d = algdiff.Differentiator(101, delta=delta, engine="direct")
velocity = d(x)
print(velocity)
print(f"samples before and after its own that an estimate reads: {overlap_depth(d)}")

# %%
# Results that are reduced never exist as a whole: here the root mean square of the velocity of every channel, beside
# what the frequencies say.

rms = da.sqrt((velocity**2).mean(axis=1)).compute(scheduler="threads")
print(
    "computed:", rms.round(2), "V/s;  from the frequencies:", (2 * np.pi * frequencies[:, 0] / 2**0.5).round(2), "V/s"
)

# %%
# The same bits as in memory, whatever the chunks: "direct" guarantees that. The engines for long windows agree with the
# whole to rounding; if any bits differ, they are the last.

for engine in ("direct", "moments", "fft"):
    long = algdiff.Differentiator(1001, delta=delta, engine=engine)
    whole, chunked = long(recording), long(x).compute(scheduler="threads")
    apart = np.abs(whole - chunked).max() / np.abs(whole).max()
    print(
        f"{engine:8} same bits: {np.array_equal(whole, chunked)!s:6} at most {apart:.0e} of the largest estimate apart"
    )

# %%
# What goes wrong without the neighbours' samples: ``map_blocks`` differentiates every chunk as if it were a recording
# of its own, and each seam gets two ends, with all their noise.

alone = x.map_blocks(d, dtype=x.dtype).compute(scheduler="threads")
together = velocity.compute(scheduler="threads")
border = int(np.cumsum(x.chunks[1])[0])
seam = slice(border - 150, border + 150)
figure, axes = plt.subplots(figsize=(7, 3.8), layout="constrained")
axes.plot(t[seam], alone[0, seam], "C1", linewidth=1.2, label="every chunk alone (map_blocks)")
axes.plot(t[seam], together[0, seam], "C0", label="algdiff.differentiate")
axes.axvline(t[border], color="k", linewidth=0.8, linestyle=":")
axes.set(xlabel="time, s (dotted: where chunks meet)", ylabel="velocity, V/s", title="The seam between two chunks")
axes.legend(loc="lower left")
plt.show()

# %%
# The keywords of a call work on lazy arrays as well: missing samples, error bars (which need a known ``sigma``),
# several orders at once.

gaps = da.where(da.from_array(np.random.default_rng(1).random(recording.shape) < 0.01, chunks=x.chunks), np.nan, x)
found = d(gaps, nan_policy="omit", return_std=True, sigma=0.01)
first = found.std[:, :30_000].compute(scheduler="threads")
print(f"error bars of the first chunk: {np.nanmin(first):.3f} to {np.nanmax(first):.3f} V/s")
print("two orders:", algdiff.differentiate(x, 101, deriv=(1, 2), delta=delta).shape)
