"""Run the command line in a process that ends with the server that started it.

``python -m lightwell_server.supervised`` takes the arguments of ``lightwell``. The server holds the other end of this
process's standard input and never writes to it. When the server ends, however it ends, the kernel closes the pipe; a
thread sees that and stops the process. So no worker outlives its server.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

GRACE_SECONDS = 3.0
"""Time to end in order before the process is ended at once."""


def _end_with_parent() -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_SECONDS)
    os._exit(1)


def main() -> None:
    """Watch the parent, then do what the arguments say."""
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    from lightwell_server.cli import main as run_command_line

    run_command_line()


if __name__ == "__main__":
    main()
