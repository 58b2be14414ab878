"""Types that signatures share."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np

Array = np.ndarray

# What a file is named by.
PathLike = str | os.PathLike[str]

# Called with (done, total) while work goes on.
Progress = Callable[[int, int], None]
