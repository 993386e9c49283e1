"""Serves environments over ZeroMQ, or makes keys for it (docs/deploy/README.md)."""

from __future__ import annotations

import argparse

SUMMARY = "run a server: environments for other processes and machines"
EXAMPLES = """
rodgym serve
rodgym serve keygen server-keys
rodgym serve --bind tcp://0.0.0.0:5555 --keys server-keys --http 127.0.0.1:9555 --live
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    # All words, options and --help too, are read by the server itself.
    parser.prefix_chars = "\0"
    parser.add_argument("words", nargs="*")


def run(args: argparse.Namespace) -> int:
    from rodgym._native import serve

    return serve(args.words)
