"""Many cases in a process of its own, so that one that kills it, or takes its memory, is found and named.

    python -m fuzz.run CASES [SEED]

with `tests` and `src` on the path. Prints one JSON object: cases, how many of each decoder's were read (the others
were refused), the largest share of its bound of memory that each took, seconds, and faults. Case `n` of a seed is the
same on every machine with the same versions of zlib and libwebp.
"""

from __future__ import annotations

import json
import resource
import sys
import time
import warnings
from collections import Counter
from random import Random

from fuzz.decoders import decoders
from fuzz.judge import Fault, case, judge, watched

MEMORY = 4 << 30
"""Bytes of address space that a run may take beyond what it starts with: what the largest bounds allow, twice. Compiled
libraries allocate where nobody traces."""
MOST_FAULTS = 20
"""After which a run ends."""


def _limit_memory() -> None:
    with open("/proc/self/statm", encoding="ascii") as file:
        in_use = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY, in_use + MEMORY))


def run(cases: int, seed: int) -> dict[str, object]:
    """So many cases, each decoder's in turn."""
    table = list(decoders().values())
    read: Counter[str] = Counter()
    share: dict[str, float] = dict.fromkeys(decoders(), 0.0)
    faults: list[Fault] = []
    began = time.monotonic()
    with watched():
        for number in range(cases):
            decoder = table[number % len(table)]
            # Said before it is tried: the last line tells of the case that killed the process.
            print(number, decoder.name, file=sys.stderr)
            found = judge(decoder, case(decoder, Random(f"{seed} {number}")))
            if isinstance(found, Fault):
                faults.append(found)
                if len(faults) == MOST_FAULTS:
                    break
            else:
                read[decoder.name] += found.read
                share[decoder.name] = max(share[decoder.name], round(found.share, 3))
    return {
        "cases": cases,
        "read": dict(read),
        "share": share,
        "seconds": round(time.monotonic() - began, 1),
        "faults": [str(fault) for fault in faults],
    }


if __name__ == "__main__":
    _limit_memory()
    # As in the other tests: an overflow in numpy is a number that should have been refused.
    warnings.simplefilter("error")
    print(json.dumps(run(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1)))
