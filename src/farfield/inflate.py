"""Raw deflate streams of strangers, whose size is known before: never more is inflated."""

from __future__ import annotations

import zlib


def inflate(packed: bytes, size: int, dictionary: bytes = b"") -> bytes:
    """The `size` bytes of a stream without header. Raises zlib.error unless it holds and ends with exactly these.

    dictionary: what the stream may refer to before its begin.
    """
    stream = zlib.decompressobj(-15, zdict=dictionary)
    # One byte more than it should be shows a longer one; and 0 would mean without a limit.
    content = stream.decompress(packed, size + 1)
    if len(content) != size or not stream.eof or stream.unused_data:
        raise zlib.error(f"it does not hold the {size} bytes it should")
    return content
