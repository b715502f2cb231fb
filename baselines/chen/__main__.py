"""Command line, see `baselines.chen.command`."""

from baselines.chen.command import main

if __name__ == "__main__":
    raise SystemExit(main())
