"""`python -m lumpwatch.service.cli` is the `lumpwatch` command."""

import sys

from lumpwatch.service.cli import main

if __name__ == "__main__":
    sys.exit(main())
