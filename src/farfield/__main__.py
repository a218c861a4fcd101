"""`python -m farfield` is the command `farfield`."""

import sys

from farfield.cli import main

sys.exit(main())
