"""`python -m framework` is `crossing`."""

from framework.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
