"""The subcommands of ``rodgym``: one module each, found by its name.

A module ``foo.py`` here (``foo_bar.py`` becomes ``foo-bar``) is the subcommand ``rodgym foo``. It
has

* ``SUMMARY``: one line for ``rodgym --help``;
* ``EXAMPLES``: command lines for ``rodgym foo --help``, one per line;
* ``add_arguments(parser)``: its arguments;
* ``run(args) -> int``: the work, and the exit code.

Importing such a module must be cheap: heavy packages (torch, matplotlib) are imported inside
``run``. A wrong argument that argparse cannot see raises `rodgym.cli.UsageError`.
"""
