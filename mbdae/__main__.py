"""`python -m mbdae` is the command `mbdae`."""

import os
import sys

if __name__ == "__main__":
    # Python puts the working directory first: a random.py there would replace the module of that name
    if not sys.flags.safe_path:
        here = sys.path.pop(0)
        if os.path.dirname(os.path.dirname(os.path.abspath(__file__))) == here:  # mbdae itself comes from there
            sys.path.append(here)

    from mbdae.cli import main

    sys.exit(main())
