"""The dictionary that GLBs are deflated with (spec/world.md, Dictionary): what nearly all of them say.

Heads, JSON and what compressed data begin with differ in a few numbers from file to file; the rest costs a reference
each. Bytes of values as they were deflated without a dictionary, of GLBs that were not made for one (members in the
order of their making, numbers with all digits), as they are with it, and what of these is the GLB's head and JSON:

| | without | with | of that head and JSON |
|---|---|---|---|
| statue of 1,982 triangles | 5,501 | 4,866 | 86 |
| its levels of 494, 122 and 30 | 2,278, 1,303, 887 | 1,680, 692, 292 | 86, 89, 82 |
| textured square of 32 | 831 | 262 | 90 |
| leaf of textured ground of 2 triangles | 810 | 105 | 76 |
| the same with two placed meshes | 998 | 222 | 118 |
"""

from __future__ import annotations

import re
from importlib.resources import files


def parsed(text: str) -> bytes:
    r"""The bytes of a dictionary as text: lines but for those that begin with #, without their ends; \xNN is a byte."""
    joined = "".join(line for line in text.splitlines() if not line.startswith("#"))
    return re.sub(r"\\x(..)", lambda escape: chr(int(escape[1], 16)), joined).encode("latin-1")


DICTIONARY = parsed(files(__package__).joinpath("dictionary.txt").read_text("ascii"))
"""Never changed: what is packed with it is unpacked with no other. Another needs another version of packed values."""
