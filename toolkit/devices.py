"""The device a user asks for."""

from __future__ import annotations

from intaglio.errors import InputError
from intaglio.kernels.launch import choose_device


def device_or_error(device: str | None) -> str:
    """Return the device's alias; `InputError` lists what there is where ``device`` is not."""
    try:
        return choose_device(device)
    except ValueError as problem:
        raise InputError(str(problem)) from problem
