"""NVIDIA Warp kernels: arrays in, arrays out.

Warp greets with a banner and reports every module that it loads. Where Intaglio is imported, it is as quiet as NumPy instead:
only warnings and errors are shown. The environment variable ``INTAGLIO_VERBOSE=1`` asks for the reports, and a level that was
set before (``warp.config.log_level``, other than Warp's own default) stays as it is.
"""

from __future__ import annotations

import os

import warp as wp

if wp.config.log_level == wp.LOG_INFO and os.environ.get("INTAGLIO_VERBOSE", "") in ("", "0"):
    wp.config.log_level = wp.LOG_WARNING
