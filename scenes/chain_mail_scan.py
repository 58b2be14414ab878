"""The visible side of real chain mail, points without normals, extended."""

from __future__ import annotations

from intaglio.geometry import GeometryTexture, read_geometry_texture
from intaglio.scenes.common import options, real_data
from intaglio.scenes.extension import run_extension


def swatch() -> GeometryTexture:
    """Return the swatch; its normals are estimated."""
    path = real_data("geotex/chainmail004_points/chainmail004_points.ply")
    return read_geometry_texture(path, axis="z", spacing=0.0035)


def main() -> None:
    """Run the scene."""
    args = options(__doc__ or "")
    run_extension("chain_mail_scan", "Scanned chain mail", swatch(), (1.6, 1.6), 0.3, args)


if __name__ == "__main__":
    main()
