"""
Edges, blobs and ridges of an image
===================================

The same windows, along one axis after the other, differentiate arrays of any number of dimensions. ``gradient`` finds
edges, ``laplacian`` where they turn, ``hessian`` thin lines, in an image whose noise hides them from differences of
neighbours.
"""

import matplotlib.pyplot as plt
import numpy as np

import algdiff

plt.style.use("tableau-colorblind10")

# %%
# A bright disk with a dim one beside it, and a thin bright line, blurred a little by the optics. One pixel is 0.1 mm.

spacing = 0.1  # mm
y, x = spacing * np.mgrid[0:240, 0:320]


def disk(row, column, radius, blur=0.2):
    """Return 1 inside and 0 outside."""
    return 0.5 - 0.5 * np.tanh((np.hypot(y - row, x - column) - radius) / blur)


line = np.exp(-(((y - 0.45 * x - 8) / 0.35) ** 2))
clean = disk(9, 20, 6) + 0.5 * disk(16, 6, 4) + 0.8 * line
image = clean + 0.15 * np.random.default_rng(0).standard_normal(clean.shape)

# %%
# The size of the gradient is large at edges. With ``smooth=True`` every derivative is smoothed along the other axis as
# well: estimates are those of a polynomial in both variables, fitted to a box of samples.

window = 13
down, right = algdiff.gradient(image, spacing, window_length=window, degree=2, smooth=True)
edges = np.hypot(down, right)
naive = np.hypot(*np.gradient(image, spacing))
truth = np.hypot(*np.gradient(clean, spacing))
for name, one in (("np.gradient", naive), ("algdiff.gradient", edges)):
    print(f"{name:17} RMSE {np.sqrt(np.mean((one - truth) ** 2)):.3f} per mm, of at most {truth.max():.2f}")

extent = (0, spacing * image.shape[1], spacing * image.shape[0], 0)
words = {"extent": extent, "interpolation": "nearest"}
figure, axes = plt.subplots(1, 3, sharey=True, figsize=(9, 2.7), layout="constrained")
axes[0].imshow(image, cmap="gray", **words)
axes[0].set(title="image", ylabel="y, mm")
axes[1].imshow(naive, cmap="viridis", vmin=0, vmax=2.5, **words)
axes[1].set_title("np.gradient")
shown = axes[2].imshow(edges, cmap="viridis", vmin=0, vmax=2.5, **words)
axes[2].set_title("algdiff.gradient")
figure.colorbar(shown, ax=axes, label="size of the gradient, 1/mm")
for ax in axes:
    ax.set_xlabel("x, mm")

plt.show()

# %%
# The Laplacian changes its sign at edges: drawn where the gradient is large, its zeros outline what is
# there. Of the Hessian the lowest eigenvalue is far below zero along bright lines, whatever their direction, and
# somewhat below it just inside edges. At the ends of the image windows lie to one side, and the noise is larger.

curvature = algdiff.laplacian(image, window, spacing=spacing, degree=3)
second = algdiff.hessian(image, window, spacing=spacing, degree=3)
lowest = np.linalg.eigvalsh(np.moveaxis(second, (0, 1), (-2, -1)))[..., 0]
outline = np.where(edges > 0.6, curvature, np.nan)

figure, (left, right) = plt.subplots(1, 2, sharey=True, figsize=(9, 3.4), layout="constrained")
left.imshow(image, cmap="gray", **words)
left.contour(x, y, outline, levels=[0], colors="C1", linewidths=1.5)
left.set(title="zeros of the Laplacian", xlabel="x, mm", ylabel="y, mm")
shown = right.imshow(-lowest, cmap="viridis", vmin=0, vmax=np.percentile(-lowest, 99.5), **words)
right.set(title="ridges by the Hessian", xlabel="x, mm")
figure.colorbar(shown, ax=right, label="- lowest eigenvalue, 1/mm²")
# sphinx_gallery_thumbnail_number = 2
plt.show()

# %%
# ``partial`` takes any orders along any axes, and leaves alone the axes that it is not told of. Here it differentiates
# down the columns, each for itself; what smoothing along the rows is worth is the difference.

columns = algdiff.partial(image, (1,), window, axes=0, spacing=spacing, degree=2)
slope = np.gradient(clean, spacing, axis=0)
for name, one in (("columns alone", columns), ("smoothed along rows", down)):
    print(f"{name:20} RMSE {np.sqrt(np.mean((one - slope) ** 2)):.3f} per mm")
