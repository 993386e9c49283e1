"""The parser of the ``rodgym`` program and what happens to errors."""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import sys
from collections.abc import Sequence
from typing import Protocol

from rodgym.cli import commands
from rodgym.cli.arguments import UsageError
from rodgym.extras import missing

DESCRIPTION = "Elastic rods as reinforcement-learning environments."
EPILOG = """\
start here:
  rodgym demo                    train an agent, compare it with the LQR, write a report
  rodgym list                    the environments
  rodgym COMMAND --help          what a command takes, with examples
"""


class Command(Protocol):
    """What a module in `rodgym.cli.commands` holds."""

    SUMMARY: str
    EXAMPLES: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Adds the command's arguments."""

    def run(self, args: argparse.Namespace) -> int:
        """Does the work; returns the exit code."""


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Keeps line breaks of examples; lines no wider than 100 characters."""

    def __init__(self, prog: str) -> None:
        columns = int(os.environ.get("COLUMNS", "100"))
        super().__init__(prog, max_help_position=30, width=min(columns, 100))


def command_names() -> list[str]:
    """The subcommands there are, sorted."""
    modules = pkgutil.iter_modules(commands.__path__)
    return sorted(module.name.replace("_", "-") for module in modules)


def load_command(name: str) -> Command:
    """The module of a subcommand."""
    module = importlib.import_module(f"{commands.__name__}.{name.replace('-', '_')}")
    return module  # type: ignore[return-value]


def build_parser() -> argparse.ArgumentParser:
    """The whole parser; every command's module is imported, none does work yet."""
    from rodgym import __version__

    parser = argparse.ArgumentParser(
        prog="rodgym", description=DESCRIPTION, epilog=EPILOG, formatter_class=Formatter
    )
    parser.add_argument("--version", action="version", version=f"rodgym {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    for name in command_names():
        command = load_command(name)
        examples = "".join(f"  {line.strip()}\n" for line in command.EXAMPLES.strip().splitlines())
        subparser = subparsers.add_parser(
            name,
            help=command.SUMMARY,
            description=command.__doc__,
            epilog=f"examples:\n{examples}",
            formatter_class=Formatter,
        )
        command.add_arguments(subparser)
        subparser.set_defaults(run=command.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the program; returns its exit code: 0 done, 2 wrong input, 130 interrupted."""
    from rodgym import RodgymError

    parser = build_parser()
    args = parser.parse_args(argv)
    if args.command is None:
        parser.print_help()
        return 0
    try:
        return int(args.run(args))
    except (UsageError, RodgymError) as error:
        return refuse(args.command, str(error))
    except ImportError as error:
        # Our own modules may say it in their words; the cause then names the module.
        name = error.name or getattr(error.__cause__, "name", None) or ""
        said = missing([name.partition(".")[0]])
        if said is None or "pip install" not in said:
            raise
        return refuse(args.command, said)
    except BrokenPipeError:
        # The reader has gone (`rodgym list | head`): nothing is left to say, not even at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        # A folder that cannot be made, a file that cannot be written.
        if error.filename is None:
            raise
        return refuse(args.command, f"{error.filename}: {error.strerror}")
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def refuse(command: str, message: str) -> int:
    """Says what was wrong with the input, in one sentence."""
    print(f"rodgym {command}: error: {' '.join(message.split())}", file=sys.stderr)
    return 2
