"""How long work says how far it is, without knowing who listens (the command line, a test, nobody)."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """What the bake and other long work report to. One thing is counted at a time."""

    def start(self, total: int | None, what: str) -> None:
        """Begin counting `total` steps (None: not known yet) of `what`, a short noun or clause: "leaf cells"."""
        ...

    def advance(self, count: int = 1) -> None:
        """`count` more steps are done."""
        ...

    def note(self, text: str) -> None:
        """Something worth a line of its own: a warning, a choice made."""
        ...

    def finish(self) -> None:
        """The count begun last is over, whether or not it reached its total."""
        ...


class NoProgress:
    """A Progress that says nothing."""

    def start(self, total: int | None, what: str) -> None:
        """See `Progress.start`."""

    def advance(self, count: int = 1) -> None:
        """See `Progress.advance`."""

    def note(self, text: str) -> None:
        """See `Progress.note`."""

    def finish(self) -> None:
        """See `Progress.finish`."""
