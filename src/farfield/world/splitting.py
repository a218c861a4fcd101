"""Splitting a world over servers: a folder for each, to be put there as it is (spec/world.md, Servers)."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from farfield.errors import NotAWorldError, OptionError
from farfield.progress import Progress
from farfield.store import Place, Store
from farfield.store.opening import is_archive, is_url
from farfield.world.copying import Copied, copy_world
from farfield.world.manifest import KEY, read_manifest
from farfield.world.servers import MAXIMUM_SERVERS, RULE, ServersRecord, is_address, level_for
from farfield.world.targets import SplitTarget

_OPTION = "--servers"


class Part(NamedTuple):
    """One server of a world that is to be split."""

    address: str
    """As the manifest has it."""
    place: str
    """Folder or URL that is to hold what the server will."""


class Share(NamedTuple):
    """What one server has of a world."""

    keys: int
    bytes: int


def parts_of(target: Place, servers: Sequence[str]) -> tuple[Part, ...]:
    """The parts of a world that is split into folders of `target`, one for each of `servers`: http(s) addresses, or
    names of folders that stay beside each other (all on one web server, say).

    Raises OptionError: an address cannot be used, or is there twice. NotAWorldError: `target` is a world or a file.
    """
    if is_archive(target):
        raise OptionError("an archive is one file for one server", _OPTION, "name a folder as TARGET")
    if not is_url(target) and (Path(target) / KEY).exists():
        raise NotAWorldError("there is a world; its parts would lie in it", str(target), "choose an empty folder")
    if len(servers) > MAXIMUM_SERVERS:
        raise OptionError(f"{len(servers)} servers", _OPTION, f"at most {MAXIMUM_SERVERS}")
    parts = tuple(_part(os.fspath(target), server.strip()) for server in servers)
    for names in (sorted(part.address for part in parts), sorted(part.place for part in parts)):
        for name, again in pairwise(names):
            if name == again:
                raise OptionError(f"{name} is there twice", _OPTION, "name each server once")
    return parts


def split_world(
    world: Store, stores: Sequence[Store], addresses: Sequence[str], progress: Progress | None = None
) -> tuple[Copied, list[Share]]:
    """Copies `world` into `stores`, one for each address; gives what it came to, and each one's share of it.

    What is above the level of the rule is in each of them, and counts in each share. Raises as `copy_world`.
    """
    manifest = read_manifest(world)
    level = level_for(manifest.octree, manifest.bounds, len(addresses))
    target = SplitTarget(stores, ServersRecord(RULE, level, tuple(addresses)), manifest.octree)
    copied = copy_world(world, target, progress)
    return copied, [Share(keys, size) for keys, size in zip(target.keys, target.bytes, strict=True)]


def _part(target: str, server: str) -> Part:
    if "://" in server:
        address = server if server.endswith("/") else f"{server}/"
        name = re.sub(r"[^A-Za-z0-9._-]+", "-", server.partition("://")[2]).strip("-.")
    else:
        name = server.removesuffix("/")
        address = f"../{name}/"
    if not is_address(address):
        what = f"{server[:200]!r} is no address of a server"
        raise OptionError(what, _OPTION, "https://HOST/FOLDER/ without a password, or the name of a folder")
    return Part(address, f"{target.rstrip('/')}/{name}")
