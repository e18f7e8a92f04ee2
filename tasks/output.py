"""What every command does with its answer: lines on the terminal, files, or one line on why a file cannot be."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from ..errors import InputError


def say(line: str) -> None:
    """Print a line of the answer."""
    sys.stdout.write(line + "\n")


def write_file(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file.

    Raises:
        InputError: The file cannot be written.
    """
    try:
        write(path)
    except OSError as error:
        raise InputError(
            path, f"cannot be written ({error.strerror})", "name a folder that exists and is yours"
        ) from error
