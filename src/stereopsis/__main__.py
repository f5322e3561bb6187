"""``python -m stereopsis``: the command line."""

import sys

from stereopsis.cli import main

if __name__ == "__main__":
    sys.exit(main())
