"""`python -m mbdae` is the command `mbdae`."""

import os
import sys

if __name__ == "__main__":
    # `python -m` searches the working directory first: a file random.py there would replace Python's module random
    if not sys.flags.safe_path:
        here = sys.path.pop(0)
        # mbdae is in the working directory: search that last
        if os.path.dirname(os.path.dirname(os.path.abspath(__file__))) == here:
            sys.path.append(here)

    from mbdae.cli import main

    sys.exit(main())
