"""Notes of the bake that name scene chunks: what no note names is garbage."""

from __future__ import annotations

import msgspec

from farfield.store.contract import Store
from farfield.world.keys import chunk_key
from farfield.world.limits import DAMAGE, Count, Hash

NOTES = ("record/split",)
"""Folders of such notes."""


class ChunkNote(msgspec.Struct, frozen=True):
    """What every such note says; it may say more."""

    chunks: tuple[tuple[Hash, Count], ...]
    """Hash and bytes of each chunk."""


def named_chunks(store: Store) -> set[str]:
    """Keys of all chunks that a note names; a note that cannot be read names none, for nobody else can read it."""
    named: set[str] = set()
    for folder in NOTES:
        for key in store.list(folder):
            try:
                note = msgspec.json.decode(store.get(key), type=ChunkNote)
            except DAMAGE:
                continue
            named.update(chunk_key(name) for name, _ in note.chunks)
    return named
