"""The program `blendcap`: its commands, and what becomes of an error.

Exit codes: 0 done, 1 the input is at fault (one plain sentence on standard error), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

import blendcap
from blendcap.cli.convert import convert
from blendcap.cli.demo import demo
from blendcap.cli.doctor import doctor
from blendcap.cli.evaluate import evaluate
from blendcap.cli.facs import facs
from blendcap.cli.info import info
from blendcap.cli.rig import rig
from blendcap.cli.solve import solve
from blendcap.cli.view import view

app = App(
    name="blendcap",
    help="Captured facial performances to blendshape animation.",
    version=blendcap.__version__,
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
for command in (demo, doctor, info, solve, facs, view, convert, evaluate, rig):
    app.command(command)


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    debug: Annotated[bool, Parameter(negative=(), show_default=False)] = False,
) -> int:
    """Run one command and turn its errors into sentences.

    Parameters
    ----------
    debug
        Show tracebacks and everything that the library logs.
    """
    with _listening(debug):
        try:
            return app(tokens, exit_on_error=False) or 0
        except CycloptsError:
            return 2  # it has explained itself
        except KeyboardInterrupt:
            return _fail("stopped; no file was left half-written.", 130)
        except BrokenPipeError:  # the reader of our output has gone, as in `blendcap info take.c3d | head -1`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        except Exception as error:
            if debug:
                raise
            return _fail(_sentence(error), 1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `blendcap` with these arguments (the process's own if None) and return the exit code."""
    try:
        return app.meta(arguments, exit_on_error=False) or 0
    except CycloptsError:
        return 2


def _sentence(error: Exception) -> str:
    if isinstance(error, blendcap.InputError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}." if error.filename else f"{error}."
    if isinstance(error, MemoryError):
        return f"There is not enough memory for this ({error}); use a shorter take or a smaller rig."
    return f"This should not have happened ({type(error).__name__}: {error}); run it again with --debug and report it."


def _fail(sentence: str, code: int) -> int:
    print(f"blendcap: {' '.join(sentence.split())}", file=sys.stderr)
    return code


@contextmanager
def _listening(debug: bool) -> Iterator[None]:
    """Bring the library's warnings to standard error, one line each; with `debug`, all that it logs."""
    logger, handler = logging.getLogger("blendcap"), logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s" if debug else "blendcap: warning: %(message)s"))
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG if debug else logging.WARNING)
    try:
        with warnings.catch_warnings():
            if not debug:
                warnings.simplefilter("ignore")  # numerical chatter of other packages
                warnings.simplefilter("default", UserWarning)
                warnings.showwarning = lambda message, *_, **__: logger.warning(str(message))
            yield
    finally:
        logger.removeHandler(handler)
