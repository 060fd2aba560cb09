"""``python -m algdiff``: the same as the command ``algdiff``."""

import sys

from algdiff._cli import main

if __name__ == "__main__":
    sys.exit(main())
