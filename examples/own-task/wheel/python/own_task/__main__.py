"""`python -m own_task evaluate ...`: rodgym's commands, which know this package's environment."""

import own_task  # noqa: F401, I001
from rodgym.cli import main

raise SystemExit(main())
