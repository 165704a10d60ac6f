"""A saved state as the bytes of a file: numpy's .npz with a digest of all of it. Opens nothing.

The file is a zip of one .npy per array, not compressed, nothing pickled. Its comment, the last
bytes of the file, is the SHA-256 of every byte before: whatever was changed or cut is seen before
anything of it is read. `numpy.load` reads it as well. The same arrays give the same bytes.
Source: NumPy Enhancement Proposal 1 (.npy format); PKWARE APPNOTE 6.3, section 4.3.16 (comment).
"""

import hashlib
import io
import math
import tokenize
import zipfile
from typing import Any

import numpy as np
import numpy.lib.format as npy
import numpy.typing as npt

Arrays = dict[str, npt.NDArray[Any]]

MARK = b"mapod sha256 "
COMMENT_BYTES = len(MARK) + 2 * hashlib.sha256().digest_size
SUFFIX = ".npy"
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the zip format's first instant: no clock is read
MAX_DIMENSIONS = 4
MOST_LETTERS = 500  # of a reason
# what zipfile and numpy raise on bytes that are none of theirs
BROKEN = zipfile.BadZipFile, ValueError, TypeError, RuntimeError, EOFError, tokenize.TokenError


class StateError(Exception):
    """A saved state that can't be used, or made; the text says why, and steers no terminal."""

    def __init__(self, why: str) -> None:
        """`why` may quote the file: its letters are shown as far as they can be."""
        shown = "".join(letter if letter.isprintable() else " " for letter in why)
        super().__init__(shown if len(shown) <= MOST_LETTERS else f"{shown[:MOST_LETTERS]}...")


def bytes_from_arrays(arrays: Arrays) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(arrays):
            member = io.BytesIO()
            npy.write_array(member, np.asarray(arrays[name], order="C"), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(name + SUFFIX, LONG_AGO), member.getvalue())
        archive.comment = bytes(COMMENT_BYTES)
    body = content.getvalue()[:-COMMENT_BYTES]
    return body + MARK + hashlib.sha256(body).hexdigest().encode("ascii")


def arrays_from_bytes(data: bytes) -> Arrays:
    """The arrays in a file; StateError where it is no such file, or was damaged."""
    body, comment = data[:-COMMENT_BYTES], data[-COMMENT_BYTES:]
    if not data:
        raise StateError("it is empty")
    if not comment.startswith(MARK):
        raise StateError("its end is missing, or it is no saved map")
    if comment[len(MARK) :] != hashlib.sha256(body).hexdigest().encode("ascii"):
        raise StateError("it is damaged: its content does not fit its checksum")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            if any(member.compress_type != zipfile.ZIP_STORED for member in members):
                raise StateError("it is packed in a way that no saved map is")
            if sum(member.file_size for member in members) > len(data):
                raise StateError("its arrays are longer than itself")  # one and the same, again
            return {
                member.filename.removesuffix(SUFFIX): _array_from(archive.read(member))
                for member in members
            }
    except BROKEN as error:
        raise StateError(f"it can't be read: {error}") from None


def _array_from(data: bytes) -> npt.NDArray[Any]:
    """One array of the .npy format, copied; ValueError where it is none, or of Python objects."""
    stream = io.BytesIO(data)
    if npy.read_magic(stream) != (1, 0):
        raise ValueError("an array is of another version of the .npy format")
    shape, is_fortran, dtype = npy.read_array_header_1_0(stream)
    content = data[stream.tell() :]
    if dtype.hasobject or is_fortran or len(shape) > MAX_DIMENSIONS or min(shape, default=0) < 0:
        raise ValueError("an array is of a kind that no saved map has")
    if math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError("an array is shorter or longer than it says")
    return np.frombuffer(content, dtype).reshape(shape).copy()
