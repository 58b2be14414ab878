"""Comparing two images: how much they differ, in figures that agree with the eye and in a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.kernels.transfer import encode_srgb
from intaglio.render.arguments import number, real_array, shaped


@dataclass(frozen=True)
class Comparison:
    """Differences between an image and its reference.

    Attributes
    ----------
    rmse : float
        Root mean square difference of the linear values.
    psnr : float
        Peak signal-to-noise ratio of the display (sRGB) values in decibels, with peak 1; infinite for equal images.
    ssim : float
        Mean structural similarity of the display values, with a Gaussian window; 1 for equal images.
    flip : float
        Mean FLIP difference as seen on a display at 67 pixels per degree; 0 for equal images.
    difference : (H, W, 3) float32 array
        FLIP's error map in false colour, display values in [0, 1].

    See Also
    --------
    intaglio.render.compare : Computes it.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import compare
    >>> compare(np.full((16, 16), 0.5), np.full((16, 16), 0.25)).rmse
    0.25
    """

    rmse: float
    psnr: float
    ssim: float
    flip: float
    difference: np.ndarray

    def __post_init__(self) -> None:
        for name in ("rmse", "psnr", "ssim", "flip"):
            number(-np.inf, np.inf)(name, getattr(self, name), {})
        object.__setattr__(self, "difference", shaped(None, None, 3)("difference", self.difference, {}).astype(np.float32))


def compare(image: np.ndarray, reference: np.ndarray) -> Comparison:
    """Compare two linear images.

    Parameters
    ----------
    image, reference : (H, W, 3) or (H, W) arrays
        Linear Rec.709 values; for all figures but ``rmse`` they are clipped to [0, 1] and encoded as sRGB.

    Returns
    -------
    Comparison
        Figures, and a picture of the differences.

    Raises
    ------
    ValueError
        If the shapes differ, images are smaller than 11 x 11, or values are not finite.

    References
    ----------
    Wang, Bovik, Sheikh & Simoncelli, "Image Quality Assessment: From Error Visibility to Structural Similarity", IEEE Trans.
    Image Processing 13(4), 2004.

    Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström & Fairchild, "FLIP: A Difference Evaluator for Alternating Images",
    Proc. ACM Computer Graphics and Interactive Techniques 3(2), 2020.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import compare
    >>> image = np.linspace(0, 1, 256).reshape(16, 16)
    >>> same = compare(image, image)
    >>> same.rmse, same.psnr, round(same.ssim, 6), same.flip
    (0.0, inf, 1.0, 0.0)
    """
    from flip_evaluator import evaluate
    from skimage.metrics import structural_similarity

    image, reference = (_single(name, a) for name, a in (("image", image), ("reference", reference)))
    if image.shape != reference.shape:
        raise ValueError(f"images differ in shape: image {image.shape} against reference {reference.shape}")
    if image.ndim == 2:
        image, reference = (np.repeat(a[:, :, None], 3, axis=2) for a in (image, reference))
    if image.ndim != 3 or image.shape[2] != 3 or min(image.shape[:2]) < 11:
        raise ValueError(f"image and reference must be (H, W, 3) or (H, W) with at least 11 pixels a side, not {image.shape}")
    rmse = float(np.sqrt(np.mean((image.astype(np.float64) - reference) ** 2)))
    shown, wanted = encode_srgb(image), encode_srgb(reference)
    mse = float(np.mean((shown.astype(np.float64) - wanted) ** 2))
    ssim = structural_similarity(
        wanted, shown, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    difference, flip, _ = evaluate(wanted, shown, "LDR")
    return Comparison(
        rmse=rmse,
        psnr=float("inf") if mse == 0 else float(-10 * np.log10(mse)),
        ssim=float(ssim),
        flip=float(flip),
        difference=np.asarray(difference, np.float32),
    )


def _single(name: str, value: np.ndarray) -> np.ndarray:
    array = real_array(name, value)
    if array.size and np.abs(array).max() > np.finfo(np.float32).max:
        raise ValueError(f"{name} has values that are not finite in single precision")
    return array.astype(np.float32)
