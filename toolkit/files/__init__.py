"""Files that appear whole: images, EXR, pages of HTML."""

from intaglio.files.exr import read_exr, read_exr_header, write_exr
from intaglio.files.guard import guard_inputs, note_input, tell_unfinished
from intaglio.files.image_kinds import IMAGE_SUFFIXES, READABLE_SUFFIXES
from intaglio.files.images import read_image, read_image_with_type, read_samples, write_image, write_samples
from intaglio.files.limits import check_memory, limit_memory, memory_limit
from intaglio.files.pages import inline_image, listing, picture_row, table, write_page
from intaglio.files.paths import check_folder, check_readable, check_writable, whole_file, whole_folder
from intaglio.files.quiet import hushed, hushed_streams

__all__ = [
    "IMAGE_SUFFIXES",
    "READABLE_SUFFIXES",
    "check_folder",
    "check_memory",
    "check_readable",
    "check_writable",
    "guard_inputs",
    "hushed",
    "hushed_streams",
    "inline_image",
    "limit_memory",
    "listing",
    "memory_limit",
    "note_input",
    "picture_row",
    "read_exr",
    "read_exr_header",
    "read_image",
    "read_image_with_type",
    "read_samples",
    "table",
    "tell_unfinished",
    "whole_file",
    "whole_folder",
    "write_exr",
    "write_image",
    "write_page",
    "write_samples",
]
