"""The matches of a canvas' patches in a sample, which launches the kernels of `patch_match`."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy import ndimage

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.patch_match import (
    SIDE,
    STRIDE,
    Layout,
    Picture,
    Starts,
    Sweep,
    copy_kernel,
    match_kernel,
    settle_kernel,
    vec8,
    vote_kernel,
)


def _upload_picture(planes: np.ndarray, device: str) -> Picture:
    """Return (n, H, W) planes on the device, pixel by pixel."""
    picture = Picture()
    flat = np.zeros(planes.size + SIDE, np.float32)
    flat[: planes.size] = np.moveaxis(planes, 0, 2).ravel()
    picture.numbers = upload(flat, wp.float32, device)
    picture.lanes = wp.array(ptr=picture.numbers.ptr, dtype=vec8, shape=(planes.size,), strides=(4,), device=device)
    picture.maps, picture.width = planes.shape[0], planes.shape[2]
    return picture


class PatchField:
    """The matches of a canvas' patches in a sample.

    Parameters
    ----------
    sample : (n, h, w) float32 array
        What is compared, weighted.
    usable : (h, w) bool array
        Pixels that may be copied.
    starts : (h - 7, w - 7) bool array
        Where a patch may begin; none elsewhere than where all of its pixels are usable.
    canvas : (n, H, W) float32 array
        The canvas' first values.
    source : (H, W, 2) int array
        Where each canvas pixel is copied from.
    open_ : (H, W) bool array
        Pixels that may change.
    active : (K,) int array
        Patches that are matched, by number on the grid; all others stay what ``source`` says.
    wrap : bool
        The canvas is a torus; its sides are then even.
    device : str
        From `choose_device`.
    voting : int
        The first so many maps are voted; the others are given, such as guides, and stay.
    """

    def __init__(
        self,
        sample: np.ndarray,
        usable: np.ndarray,
        starts: np.ndarray,
        canvas: np.ndarray,
        source: np.ndarray,
        open_: np.ndarray,
        active: np.ndarray,
        wrap: bool,
        device: str,
        voting: int,
    ) -> None:
        self.device = device
        self.shape = (source.shape[0], source.shape[1])
        self.grid = patch_grid(self.shape, wrap)
        self._layout = Layout()
        self._layout.shape, self._layout.grid, self._layout.wrap = wp.vec2i(*self.shape), wp.vec2i(*self.grid), int(wrap)
        self._voting = voting
        self._sample = _upload_picture(sample, device)
        pad = SIDE if wrap else 0
        self._canvas = _upload_picture(np.pad(canvas, ((0, 0), (0, pad), (0, pad)), mode="wrap") if wrap else canvas, device)
        self._usable = upload(usable, wp.int32, device)
        self._starts = Starts()
        self._starts.usable = upload(starts, wp.int32, device)
        self._starts.excess = wp.zeros(starts.shape, dtype=wp.float32, device=device)
        self._pixels = upload(np.flatnonzero(open_), wp.int32, device)
        row, column = np.nonzero(open_)
        color = 2 * (row % 2) + column % 2
        # Of a torus of odd sides the last row and column would meet neighbours of their own colour.
        color = color + 4 * ((row == self.shape[0] - 1) & (self.shape[0] % 2 == 1))
        color = color + 8 * ((column == self.shape[1] - 1) & (self.shape[1] % 2 == 1))
        flat = np.flatnonzero(open_)
        self._colors = [upload(flat[color == c], wp.int32, device) for c in np.unique(color)]
        self._active = upload(active, wp.int32, device)
        self._source = upload(source, wp.vec2i, device)
        self._before = wp.clone(self._source)
        self._field = upload(_matches_of(source, starts, self.grid), wp.vec2i, device)
        self._found = wp.clone(self._field)
        self._cost = wp.zeros(self.grid[0] * self.grid[1], dtype=wp.float32, device=device)
        self._falloff = upload(np.hanning(SIDE + 2)[1:-1], wp.float32, device)

    @property
    def field(self) -> np.ndarray:
        """(K, 2) int32: where the match of each patch begins."""
        return np.asarray(self._field.numpy())

    @property
    def cost(self) -> np.ndarray:
        """(K,) float32: what the match of each patch costs, 0 for those that are not searched."""
        return np.asarray(self._cost.numpy())

    @property
    def source(self) -> np.ndarray:
        """(H, W, 2) int32: where each pixel is copied from."""
        return np.asarray(self._source.numpy())

    @property
    def canvas(self) -> np.ndarray:
        """(n, H, W) float32: the values that patches are compared with."""
        width, maps = self._canvas.width, self._canvas.maps
        numbers = self._canvas.numbers.numpy()[:-SIDE].reshape(-1, width, maps)
        return np.moveaxis(numbers[: self.shape[0], : self.shape[1]], 2, 0)

    def set_excess(self, excess: np.ndarray) -> None:
        """Say how much more than evenly the pixels from each start on are used: (h - 7, w - 7), 0 where not more."""
        self._starts.excess = upload(excess, wp.float32, self.device)

    def sweep(self, *, jump: int, chances: int, radius: int, evenness: float, seed: int) -> None:
        """Let every active patch look for a better match once; see `Sweep`."""
        sweep = Sweep()
        sweep.jump, sweep.chances, sweep.radius, sweep.evenness = jump, chances, radius, evenness
        sweep.seed = int(seed) & 0x7FFFFFFF
        launch(
            match_kernel,
            len(self._active),
            inputs=[
                self._active,
                self._layout,
                self._canvas,
                self._sample,
                self._starts,
                sweep,
                self._field,
            ],
            outputs=[self._found, self._cost],
            device=self.device,
            work=400.0 * self._sample.maps,
        )
        self._field, self._found = self._found, self._field
        # Patches that are not searched stay the same in both.

    def vote(self, weight: np.ndarray) -> None:
        """Give open pixels the mean of what the patches over them say, each weighted (K,)."""
        launch(
            vote_kernel,
            len(self._pixels),
            inputs=[
                self._pixels,
                self._layout,
                self._sample,
                self._field,
                upload(weight, wp.float32, self.device),
                self._falloff,
                self._voting,
            ],
            outputs=[self._canvas],
            device=self.device,
            work=100.0 * self._voting,
        )

    def copy(self, rounds: int, faith: float, price: float) -> None:
        """Copy open pixels from where patches point, then move the borders of pieces to where they cost least.

        Parameters
        ----------
        rounds : int
            How often each pixel may join a neighbour's piece.
        faith : float
            Weight of a pixel's distance from the vote against the cost of seams.
        price : float
            What a border between two pixels costs however well it fits.
        """
        self._before, self._source = self._source, self._before
        self._source.assign(self._before)
        launch(
            copy_kernel,
            len(self._pixels),
            inputs=[
                self._pixels,
                self._layout,
                self._canvas,
                self._sample,
                self._usable,
                self._field,
                self._before,
            ],
            outputs=[self._source],
            device=self.device,
            work=500.0 * self._sample.maps,
        )
        for _ in range(rounds):
            for pixels in self._colors:
                launch(
                    settle_kernel,
                    len(pixels),
                    inputs=[pixels, self._layout.wrap, self._canvas, self._sample, self._usable, faith, price],
                    outputs=[self._source],
                    device=self.device,
                    work=200.0 * self._sample.maps,
                )


def patch_grid(shape: tuple[int, int], wrap: bool) -> tuple[int, int]:
    """Return rows and columns of the patches of a canvas."""
    if wrap:
        return shape[0] // STRIDE, shape[1] // STRIDE
    return (shape[0] - SIDE) // STRIDE + 1, (shape[1] - SIDE) // STRIDE + 1


def _matches_of(source: np.ndarray, starts: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """Return (K, 2): matches that continue what is copied to the middle of each patch, or the usable ones next to them."""
    middle = SIDE // 2
    rows = (STRIDE * np.arange(grid[0]) + middle) % source.shape[0]
    columns = (STRIDE * np.arange(grid[1]) + middle) % source.shape[1]
    place = source[rows[:, None], columns[None, :]].reshape(-1, 2) - middle
    place = np.clip(place, 0, np.array(starts.shape) - 1)
    if not starts.all():
        nearest = ndimage.distance_transform_edt(~starts, return_distances=False, return_indices=True)
        place = nearest[:, place[:, 0], place[:, 1]].T
    return np.asarray(place)
