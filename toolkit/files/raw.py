"""Photographs as a camera's sensor saw them (DNG, NEF, CR2, ARW, …): developed without a tone curve."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from intaglio.errors import FileError, InputError
from intaglio.files.pixels import Pixels, check_image_memory
from intaglio.files.quiet import hushed_streams, reason

# LibRaw's codes of how the camera was held, as EXIF's.
_ORIENTATIONS = {0: 1, 3: 3, 5: 8, 6: 6}


def read_raw(path: Path) -> Pixels:
    """Read a raw photograph as linear 16-bit colour.

    Black is subtracted, the mosaic is interpolated, white balance is the camera's, colours are brought to Rec.709; there is
    no tone curve, and no brightening that would differ from photograph to photograph.
    """
    try:
        import rawpy
    except ImportError as error:
        raise FileError(f"{path}: raw photographs need rawpy; pip install 'intaglio[raw]'") from error
    try:
        with hushed_streams() as heard, rawpy.imread(str(path)) as raw:
            check_image_memory(path, int(raw.sizes.width), int(raw.sizes.height), 4, 4)
            orientation = _ORIENTATIONS.get(int(raw.sizes.flip), 1)
            values = raw.postprocess(
                gamma=(1, 1),
                no_auto_bright=True,
                use_camera_wb=True,
                output_bps=16,
                # White is what the file says, not the photograph's own brightest value.
                adjust_maximum_thr=0.0,
                user_flip=0,
                output_color=rawpy.ColorSpace.sRGB,
            )
    except InputError:
        raise
    except Exception as error:
        raise FileError(f"{path}: can't be read as a raw photograph ({reason(error, path)})") from error
    # LibRaw fills up what is missing with black, and says so on the error stream only.
    if any(word in heard[0].lower() for word in ("end of file", "corrupt", "error")):
        raise FileError(f"{path}: is cut short or damaged")
    return Pixels(np.asarray(values), orientation)
