"""A range map of a statue's face with holes and a ragged border: two holes filled where a simple base can carry them.

No plane, cylinder or sphere carries a face. Around each hole a piece is cut out that one does carry, and completed.
"""

from __future__ import annotations

import argparse

import numpy as np

from intaglio.mesh import read_surface
from intaglio.scenes.common import Result, cut_out, main, real_data, run_scene

# Centre of the hole and radius of its surroundings in millimetres, and the base that carries them.
PLACES = {
    "temple": ((-54.65, -25.62, -798.33), 10.0, "plane"),
    "cheek": ((-55.49, 2.87, -791.14), 9.0, "cylinder"),
}


def run(args: argparse.Namespace) -> list[Result]:
    """Run the scene."""
    scan = read_surface(real_data("meshes/face000_rangemap/face000.ply"))
    results = []
    for name, (center, radius, base) in PLACES.items():
        piece = cut_out(scan, np.array(center), radius)
        results.append(
            run_scene(
                f"face_{name}", f"Statue's face, {name}", piece, args,
                base=base, extent="holes", window=4, rotations=12, refine=4,
            )
        )  # fmt: skip
    return results


if __name__ == "__main__":
    main(run, __doc__)
