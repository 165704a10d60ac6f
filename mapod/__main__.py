"""`python -m mapod` is the command `mapod`."""

import sys

from tools.cli.command import main

if __name__ == "__main__":
    sys.exit(main())
