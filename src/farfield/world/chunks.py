"""Notes of the bake that name scene chunks: what no note names is garbage."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import msgspec
from msgspec import Meta

from farfield.errors import CorruptTileError, MissingKeyError
from farfield.store.contract import Store
from farfield.world.keys import chunk_key
from farfield.world.limits import DAMAGE, Count, Hash

NOTES = ("record/split",)
"""Folders of such notes."""
SCENE = "record/scene.json"
"""Keys of all that the scene of the world is made of, in a list."""

_SceneKey = Annotated[str, Meta(pattern=r"^(attributes|record/chunk)/[0-9a-f]{16}\Z")]


class ChunkNote(msgspec.Struct, frozen=True):
    """What every such note says; it may say more."""

    chunks: tuple[tuple[Hash, Count], ...]
    """Hash and bytes of each chunk."""


def named_chunks(store: Store) -> set[str]:
    """Keys of all chunks that a note names; a note of pieces that cannot be read names none: they are made anew.

    Raises CorruptTileError: what the scene is made of cannot be told.
    """
    try:
        named = set(read_scene_values(store))
    except MissingKeyError:
        named = set()
    for folder in NOTES:
        for key in store.list(folder):
            try:
                note = msgspec.json.decode(store.get(key), type=ChunkNote)
            except DAMAGE:
                continue
            named.update(chunk_key(name) for name, _ in note.chunks)
    return named


def put_scene_values(store: Store, keys: Iterable[str]) -> None:
    """Notes what the scene is made of; without a note where that is nothing."""
    listed = sorted(set(keys))
    if listed:
        store.put(SCENE, msgspec.json.encode(listed))
    else:
        store.delete(SCENE)


def scene_values(store: Store) -> list[str]:
    """What was noted; nothing where there is no note, or one that is damaged. Raises StoreError."""
    try:
        return read_scene_values(store)
    except (MissingKeyError, CorruptTileError):
        return []


def read_scene_values(store: Store) -> list[str]:
    """Keys of what was noted. Raises CorruptTileError and StoreError (MissingKeyError: there is no note)."""
    try:
        return msgspec.json.decode(store.get(SCENE), type=list[_SceneKey])
    except DAMAGE as error:
        raise CorruptTileError(f"note of what the scene is made of is damaged: {error}", SCENE) from None
