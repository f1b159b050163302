"""`python -m groundstation`."""

import sys

from groundstation.cli_start import main

sys.exit(main())
