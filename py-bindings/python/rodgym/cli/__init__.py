"""The ``rodgym`` program.

One file in `rodgym.cli.commands` is one subcommand; `rodgym.cli.app` finds them, builds
the parser and turns errors of the user into one sentence and exit code 2.
"""

from rodgym.cli.app import main
from rodgym.cli.arguments import UsageError

__all__ = ["UsageError", "main"]
