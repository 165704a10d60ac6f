"""`python -m mapod` is the command `mapod`."""

import signal
import sys


def main() -> int:
    """Exit status; Ctrl-C while it is still being loaded ends it without a word, too."""
    try:
        from tools.cli.command import main as run_command

        return run_command()
    except KeyboardInterrupt:
        return 128 + signal.SIGINT


if __name__ == "__main__":
    sys.exit(main())
