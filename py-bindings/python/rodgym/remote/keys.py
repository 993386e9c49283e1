"""CURVE keys on disk, as `rodgym serve keygen DIR` writes them."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from rodgym.errors import ParameterError


def read_words(path: Path) -> dict[str, str]:
    """Lines `word = value` of a key file; lines that begin with # are comments."""
    try:
        lines = path.read_text().splitlines()
    except OSError as error:
        raise ParameterError(f"the key file {path} cannot be read: {error}") from error
    pairs = (line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))
    return {word.strip(): value.strip() for word, value in pairs}


def key_pair(directory: str | os.PathLike[str]) -> tuple[bytes, bytes]:
    """Our public and secret key.

    Raises:
        ParameterError: no keys there, or a secret that others can read.
    """
    path = Path(directory) / "secret.key"
    words = read_words(path)
    mode = stat.S_IMODE(path.stat().st_mode)
    if os.name == "posix" and mode & 0o077:
        raise ParameterError(f"{path} has mode {mode:o}: others can read it; chmod 600 {path}")
    return _key(words, "public", path), _key(words, "secret", path)


def public_key(key: str | os.PathLike[str]) -> bytes:
    """A server's public key: 40 characters, or the path of its `public.key`."""
    if isinstance(key, str) and len(key) == 40 and not os.path.exists(key):
        return key.encode("ascii")
    path = Path(key)
    return _key(read_words(path), "public", path)


def _key(words: dict[str, str], word: str, path: Path) -> bytes:
    key = words.get(word, "")
    if len(key) != 40:
        raise ParameterError(f"{path} has no line '{word} = ' with 40 characters")
    return key.encode("ascii")
