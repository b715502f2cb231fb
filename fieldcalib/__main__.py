"""`python -m fieldcalib`: the command line."""

import sys

from fieldcalib.cli.main import main

sys.exit(main())
