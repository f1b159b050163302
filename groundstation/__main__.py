"""`python -m groundstation`."""

import sys

from groundstation.cli.start import main

sys.exit(main())
