"""`python -m mbdae` is the command `mbdae`."""

import contextlib
import os
import sys

if __name__ == "__main__":
    with contextlib.suppress(OSError):  # where the working directory was removed
        if sys.path[:1] in ([""], [os.getcwd()]):  # a random.py there must not replace the module of that name
            sys.path.append(sys.path.pop(0))

    from mbdae.cli import main

    sys.exit(main())
