"""`python -m mbdae` is the command `mbdae`."""

import sys

from mbdae.cli import main

if __name__ == "__main__":
    sys.exit(main())
