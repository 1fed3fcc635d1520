"""The command line: one thin typed function per command."""

from blendcap.cli.app import main

__all__ = ["main"]
