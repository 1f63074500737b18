"""`python -m crease` is the command `crease`."""

import sys

from crease.cli import main

sys.exit(main())
