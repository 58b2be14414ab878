"""Which Mitsuba variant this machine can run, found before Mitsuba is imported.

Dr.Jit takes whatever libLLVM it finds, and with LLVM 14 to 16 the *process aborts* at the first render. So candidates are
opened here, their version is read, and only one that is 17 or newer is passed on; without one, the scalar variant renders.
"""

from __future__ import annotations

import ctypes
import glob
import os
import re
import sys
from dataclasses import dataclass
from functools import cache
from types import ModuleType

from intaglio.render.arguments import shown

_OLDEST_LLVM = 17
_PLACES = (
    "/usr/lib/*-linux-gnu/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/lib/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
    "/usr/local/opt/llvm*/lib/libLLVM*.dylib",
    "C:/Program Files/LLVM/bin/LLVM-C.dll",
)


@dataclass(frozen=True)
class Variant:
    """Variant of Mitsuba in use.

    Attributes
    ----------
    name : str
        One of ``cuda_ad_rgb``, ``llvm_ad_rgb`` and ``scalar_rgb``.
    reason : str
        Why it was chosen, as a phrase for the user.
    llvm : str or None
        Path of the LLVM library in use; None unless the variant is ``llvm_ad_rgb``.

    Raises
    ------
    ValueError
        If a field is no text.

    See Also
    --------
    intaglio.render.variant : Chooses it.

    Examples
    --------
    >>> from intaglio.render import variant
    >>> variant().name in ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")
    True
    """

    name: str
    reason: str
    llvm: str | None = None

    def __post_init__(self) -> None:
        for name, value in (("name", self.name), ("reason", self.reason), ("llvm", self.llvm)):
            if not isinstance(value, str) and not (name == "llvm" and value is None):
                raise ValueError(f"{name} must be text, not {shown(value)}")

    @property
    def vectorized(self) -> bool:
        """Whether arrays of rays can be traced at once.

        Returns
        -------
        bool
            False for the scalar variant, which traces one ray at a time.

        Examples
        --------
        >>> from intaglio.render import Variant
        >>> Variant("scalar_rgb", "runs everywhere, slowly").vectorized
        False
        """
        return not self.name.startswith("scalar")


def llvm_version(path: str) -> int | None:
    """Return the major version of an LLVM library, or None if it is not known.

    ``LLVMGetVersion`` exists from LLVM 16 on. A library without it is older, or another library.
    """
    try:
        library = ctypes.CDLL(path)
        get = library.LLVMGetVersion
    except (OSError, AttributeError):
        return None
    major = ctypes.c_uint()
    get.restype = None
    get(ctypes.byref(major), None, None)
    return int(major.value)


def _named_version(path: str) -> int | None:
    """Return the version in the file's name, since opening several LLVM libraries in one process may make them clash."""
    found = re.search(r"LLVM(?:-C)?[-.]?(?:so\.)?(\d+)", os.path.basename(os.path.realpath(path)))
    return int(found.group(1)) if found else None


@cache
def usable_llvm() -> tuple[str | None, str]:
    """Find an LLVM library that Mitsuba can use.

    The environment variable ``DRJIT_LIBLLVM_PATH`` names one; without it the usual places are searched. The search is made
    once per process.

    Returns
    -------
    path : str or None
        The newest library of version 17 or later; None if there is none.
    found : str
        What was found, as a phrase for the user.

    Examples
    --------
    >>> from intaglio.render import usable_llvm
    >>> path, found = usable_llvm()
    >>> found.startswith("LLVM") if path else "LLVM" in found
    True
    """
    given = os.environ.get("DRJIT_LIBLLVM_PATH")
    paths = [given] if given else sorted({os.path.realpath(p) for place in _PLACES for p in glob.glob(place)})
    candidates = []
    for path in paths:
        named = _named_version(path)
        if named is not None and named < _OLDEST_LLVM:
            candidates.append((named, path))
            continue
        version = llvm_version(path)
        if version is not None:
            candidates.append((version, path))
    good = [c for c in candidates if c[0] >= _OLDEST_LLVM]
    if good:
        version, path = max(good)
        return path, f"LLVM {version} at {path}"
    if given:
        return None, f"DRJIT_LIBLLVM_PATH={given} is not an LLVM {_OLDEST_LLVM} or newer"
    if candidates:
        versions = ", ".join(str(v) for v in sorted({v for v, _ in candidates}))
        return None, f"only LLVM {versions} found; {_OLDEST_LLVM} or newer is needed (on Debian: libllvm19)"
    return None, f"no LLVM library found ({_OLDEST_LLVM} or newer, on Debian: libllvm19)"


def _cuda_answers() -> bool:
    """Whether an NVIDIA driver with at least one GPU answers."""
    name = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
    try:
        driver = ctypes.CDLL(name)
        count = ctypes.c_int()
        return driver.cuInit(0) == 0 and driver.cuDeviceGetCount(ctypes.byref(count)) == 0 and count.value > 0
    except (OSError, AttributeError):
        return False


@cache
def variant() -> Variant:
    """Choose the Mitsuba variant: CUDA if a GPU answers, LLVM if a library works, else scalar.

    The environment variable ``INTAGLIO_VARIANT`` chooses another one of those that run on this machine. The choice is made
    once per process.

    Returns
    -------
    Variant
        The variant's name, and why it was chosen.

    Raises
    ------
    ValueError
        If ``INTAGLIO_VARIANT`` names a variant that does not run here.

    Examples
    --------
    >>> from intaglio.render import variant
    >>> chosen = variant()
    >>> chosen.vectorized == (chosen.name != "scalar_rgb")
    True
    """
    asked = os.environ.get("INTAGLIO_VARIANT")
    path, found = usable_llvm()
    if path is not None:
        os.environ["DRJIT_LIBLLVM_PATH"] = path
    possible = {"scalar_rgb": "runs everywhere, slowly"}
    if path is not None:
        possible = {"llvm_ad_rgb": found, **possible}
    if _cuda_answers():
        possible = {"cuda_ad_rgb": "an NVIDIA GPU answers", **possible}
    if asked and asked not in possible:
        raise ValueError(f"INTAGLIO_VARIANT={asked} does not run here; possible: {', '.join(possible)} ({found})")
    name = asked or next(iter(possible))
    reason = "asked for by INTAGLIO_VARIANT" if asked else possible[name]
    if name == "scalar_rgb" and not asked:
        reason = found
    return Variant(name, reason, path if name == "llvm_ad_rgb" else None)


def mitsuba() -> ModuleType:
    """Import Mitsuba with the variant set that `variant` chooses.

    Returns
    -------
    module
        The module ``mitsuba``.

    Raises
    ------
    ValueError
        If the environment variable ``INTAGLIO_VARIANT`` names a variant that does not run here.

    Examples
    --------
    >>> from intaglio.render import mitsuba, variant
    >>> mi = mitsuba()
    >>> mi.variant() == variant().name
    True
    """
    chosen = variant()
    import mitsuba as mi

    if mi.variant() != chosen.name:
        mi.set_variant(chosen.name)
    if mi.log_level() == mi.LogLevel.Warn:
        # Warnings go to the standard output, where results are; errors are raised as well. Other levels were set by the user.
        mi.set_log_level(mi.LogLevel.Error)
    return mi
