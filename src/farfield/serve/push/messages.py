"""What a viewer and the server say to each other in a session (spec/stream.md)."""

from __future__ import annotations

import struct
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from farfield.errors import ProtocolError
from farfield.world.limits import DAMAGE, Count, Vector

VERSION = 1
PATH = "/stream"
MAX_MESSAGE = 256 << 10
"""Bytes of a message of a viewer: some 3,000 keys."""
PIECE = 16 << 10
"""Bytes of a value in one message at most: a piece that is on its way cannot be called back."""

_PIECE_HEADER = struct.Struct("<II")

_Key = Annotated[
    str, Meta(max_length=160, pattern=r"^(orthoview|geometry|blockmap|mesh|texture|impostor)/[0-9a-f/-]+\Z")
]
_Keys = Annotated[tuple[_Key, ...], Meta(max_length=4096)]
_Unit = Annotated[float, Meta(ge=-1.001, le=1.001)]
_Speed = Annotated[float, Meta(ge=-1e7, le=1e7)]
_Pixels = Annotated[int, Meta(ge=1, le=16384)]


class Hello(msgspec.Struct, frozen=True, tag="hello"):
    """The first message of a viewer."""

    version: Literal[1]
    generation: Count = 0
    """Of the world that it shows; 0: any."""
    token: Annotated[str, Meta(max_length=200)] = ""
    holds: _Keys = ()
    """What it has of that."""


class View(msgspec.Struct, frozen=True, tag="view", rename="camel"):
    """Where a viewer is, and how it moves."""

    eye: Vector
    forward: tuple[_Unit, _Unit, _Unit]
    fov: Annotated[float, Meta(ge=0.1, le=179)]
    size: tuple[_Pixels, _Pixels]
    velocity: tuple[_Speed, _Speed, _Speed] = (0.0, 0.0, 0.0)
    turning: Annotated[float, Meta(ge=-100, le=100)] = 0.0
    acceleration: tuple[_Speed, _Speed, _Speed] = (0.0, 0.0, 0.0)
    near_radius: Annotated[float, Meta(ge=0, le=1e12)] | None = None
    bias: Annotated[float, Meta(ge=-4, le=8)] = 0.0
    least_gain: Annotated[float, Meta(ge=0, le=1e6)] = 10.0
    far_geometry: bool = False
    dynamic_impostors: bool = False


class Ack(msgspec.Struct, frozen=True, tag="ack"):
    """How many pieces have come since the session began."""

    pieces: Count


class Drop(msgspec.Struct, frozen=True, tag="drop"):
    """What a viewer has no longer."""

    keys: _Keys


class Add(msgspec.Struct, frozen=True, tag="add"):
    """What a viewer has got elsewhere; `holds` of the first message goes on here when it is long."""

    keys: _Keys


FromViewer = Hello | View | Ack | Drop | Add


class Welcome(msgspec.Struct, frozen=True, tag="welcome"):
    """The session begins."""

    generation: int
    version: int = VERSION
    piece: int = PIECE


class Value(msgspec.Struct, frozen=True, tag="value"):
    """A value follows, in pieces."""

    number: int
    key: str
    bytes: int


class Cancelled(msgspec.Struct, frozen=True, tag="cancelled"):
    """The rest of a value does not come: it would be of no use any more."""

    number: int


class Missing(msgspec.Struct, frozen=True, tag="missing"):
    """A value that the index names cannot be had."""

    key: str


class Idle(msgspec.Struct, frozen=True, tag="idle"):
    """Nothing more adds anything to what is seen, as far as the server knows."""


FromServer = Welcome | Value | Cancelled | Missing | Idle

_decoder = msgspec.json.Decoder(FromViewer)


def read(text: str | bytes) -> FromViewer:
    """A message of a viewer. Raises ProtocolError."""
    if len(text) > MAX_MESSAGE:
        raise ProtocolError(f"a message of more than {MAX_MESSAGE} bytes")
    try:
        found: FromViewer = _decoder.decode(text)
    except DAMAGE as error:
        raise ProtocolError(f"not a message: {str(error)[:200]}") from None
    return found


def write(message: FromServer) -> str:
    """A message of the server."""
    return msgspec.json.encode(message).decode()


def piece(number: int, offset: int, part: bytes) -> bytes:
    """A part of value `number`, which begins at `offset`."""
    return _PIECE_HEADER.pack(number, offset) + part
