"""``python -m rodgym`` is the ``rodgym`` program."""

import sys

from rodgym.cli import main

if __name__ == "__main__":
    sys.exit(main())
