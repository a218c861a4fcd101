"""One line and an exit code, whatever happens; help at once."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from typing import Never

import pytest
import typer

from farfield import __version__
from farfield.cli import app, main
from farfield.cli.output import in_bytes, in_time, plain
from farfield.errors import FarfieldError, InputError, OptionError


def raising(error: BaseException) -> Callable[[], None]:
    def command() -> Never:
        raise error

    return command


@pytest.fixture
def with_command(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], None]], None]:
    """Puts a function in the place of all commands, as `farfield fake`; a second keeps the command's name needed."""

    def install(function: Callable[[], None]) -> None:
        fake = typer.Typer(rich_markup_mode=None, pretty_exceptions_enable=False)
        fake.command("fake")(function)
        fake.command("other")(lambda: None)
        monkeypatch.setattr("farfield.cli.entry.build_app", lambda: fake)

    return install


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (InputError("is cut short", "a.glb", "export it again"), 1, "farfield: a.glb: is cut short (export it again)"),
        (FarfieldError("one\nline\n\tonly"), 1, "farfield: one line only"),
        (OptionError("no such preset", "--directions"), 2, "farfield: --directions: no such preset"),
        (KeyboardInterrupt(), 130, "farfield: interrupted"),
        (
            PermissionError(13, "Permission denied", "/x"),
            1,
            "farfield: /x: Permission denied (--traceback shows where)",
        ),
        (MemoryError(), 1, "farfield: out of memory (try fewer --workers or a smaller --leaf-size)"),
    ],
)
def test_errors_become_one_line_and_a_code(
    with_command: Callable[[Callable[[], None]], None],
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    code: int,
    line: str,
) -> None:
    with_command(raising(error))
    assert main(["fake"]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == line + "\n"


def test_traceback_lets_the_error_through(with_command: Callable[[Callable[[], None]], None]) -> None:
    with_command(raising(InputError("is cut short")))
    with pytest.raises(InputError):
        main(["fake", "--traceback"])


def test_a_command_that_says_failed_fails(with_command: Callable[[Callable[[], None]], None]) -> None:
    with_command(raising(typer.Exit(1)))
    assert main(["fake"]) == 1
    with_command(lambda: None)
    assert main(["fake"]) == 0


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nonsense"], "nonsense"),
        (["serve"], "WORLD"),
        (["serve", "x", "--port", "x"], "--port"),
        (["--nope"], "--nope"),
    ],
)
def test_wrong_calls(capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("farfield: ")
    assert captured.err.count("\n") == 1
    assert complaint in captured.err
    assert "--help" in captured.err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--resolution", "0"], "--resolution: 0 is not a resolution"),
        (["--leaf-size", "0"], "--leaf-size: 0.0 is not a leaf size"),
        (["--blockmap", "64:256"], "--blockmap: no BlockMaps are asked for"),
        (["--blockmap", "", "--represent", "blockmap"], "--blockmap: '' is not a size of BlockMaps"),
        (["--represent", "geometry"], "--represent: cannot represent by nothing for what is far"),
    ],
)
def test_bakes_that_cannot_be(capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str) -> None:
    assert main(["bake", "city.glb", "-o", "city", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"farfield: {complaint}")
    assert captured.err.count("\n") == 1


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"farfield {__version__}\n"
    assert main([]) == 0
    assert "Usage: farfield" in capsys.readouterr().out


@pytest.mark.parametrize("name", [command.name for command in app.build_app().registered_commands])
def test_every_command_explains_itself(capsys: pytest.CaptureFixture[str], name: str) -> None:
    assert main([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"Usage: farfield {name}" in text
    assert "--json" in text


def test_help_is_there_at_once() -> None:
    """0.1 s on an idle machine: what takes longer to import is not imported."""
    code = "import sys; from farfield.cli import main; main(['--help']); print(*sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = set(ended.stdout.splitlines()[-1].split())
    assert "farfield.cli.entry" in loaded
    assert loaded.isdisjoint({"numpy", "numba", "pyogrio", "shapely", "PIL", "dask", "asyncio", "msgspec", "obstore"})


def test_whoever_stops_reading_is_left_in_peace() -> None:
    code = "import sys; from farfield.cli import main; sys.exit(main(['--help']))"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
    assert process.returncode in (0, 1)


@pytest.mark.parametrize("signalled", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_are_one_line(signalled: signal.Signals) -> None:
    # A shell's background jobs, and what they start, begin with the signal ignored.
    code = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import sys, time, typer; from farfield.cli import main as m, entry;\n"
        "fake = typer.Typer(); fake.command('a')(lambda: print('go', flush=True) or time.sleep(30));\n"
        "fake.command('b')(lambda: None); entry.build_app = lambda: fake\n"
        "sys.exit(m(['a']))"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signalled)
        assert process.stderr is not None
        assert process.stderr.read() == b"farfield: interrupted\n"
    assert process.returncode == 130


def test_json_holds_only_what_json_knows() -> None:
    import numpy as np

    facts = {"a": np.float32(0.5), "b": np.arange(3), "c": float("inf"), "d": {1: {2}}, "e": np.float64("nan")}
    assert json.loads(json.dumps(plain(facts), allow_nan=False)) == {
        "a": 0.5,
        "b": [0, 1, 2],
        "c": None,
        "d": {"1": [2]},
        "e": None,
    }
    with pytest.raises(TypeError, match="object"):
        plain(object())


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 B"), (999, "999 B"), (1000, "1.0 kB"), (3.44e6, "3.4 MB"), (2e12, "2.0 TB"), (5e16, "50000.0 TB")],
)
def test_bytes_for_people(count: float, text: str) -> None:
    assert in_bytes(count) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.44, "0.4 s"), (59.4, "59 s"), (59.7, "1 min 0 s"), (185, "3 min 5 s"), (7800, "2 h 10 min")],
)
def test_times_for_people(seconds: float, text: str) -> None:
    assert in_time(seconds) == text
