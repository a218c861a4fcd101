"""`farfield warmup`: compiles the kernels ahead, so that the first bake does not wait for it."""

from __future__ import annotations

from farfield.cli.options import JsonOption
from farfield.cli.output import in_time, report
from farfield.cli.progress import shown_progress


def command(as_json: JsonOption = False) -> None:
    """Compile the kernels and keep the result; later runs load it."""
    import importlib
    import pkgutil
    import time

    from farfield import kernels

    begun = time.monotonic()
    names = [module.name for module in pkgutil.iter_modules(kernels.__path__)]
    with shown_progress() as progress:
        progress.start(len(names), "modules of kernels")
        for name in names:
            # Kernels have fixed signatures: importing one compiles it, or loads what was compiled before.
            importlib.import_module(f"farfield.kernels.{name}")
            progress.advance()
    seconds = time.monotonic() - begun
    report(
        {"modules": len(names), "seconds": round(seconds, 3)},
        as_json=as_json,
        text=f"{len(names)} modules of kernels are ready after {in_time(seconds)}",
    )
