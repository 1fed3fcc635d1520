"""`python -m blendcap` is the program `blendcap`."""

import sys

from blendcap.cli import main

sys.exit(main())
