"""`python -m fieldcalib`: the command line."""

import sys

from fieldcalib.cli import main

sys.exit(main())
